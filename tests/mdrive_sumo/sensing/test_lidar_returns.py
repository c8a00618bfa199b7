"""What LiDAR intensities tell: of angle, part, distance and loss by hand, and nothing of the class."""

import math
from dataclasses import replace

import numpy as np
import pytest
from testing.lidar_scans import Box, bare_road, scan, sensor, town

from mdrive_sumo.contract import Objects
from mdrive_sumo.core.geometry import Float, Int
from mdrive_sumo.core.seeding import draw_uniforms
from mdrive_sumo.core.state import Kind
from mdrive_sumo.roads.network_file import Building, StopSignBox
from mdrive_sumo.sensing.lidar_reflectivity import ReflectivityDraws
from mdrive_sumo.sensing.lidar_returns import DRY, RAIN
from mdrive_sumo.sensing.sensing_frame import SensingFrame, SensorPose, derive_track_name
from mdrive_sumo.sensing.street_furniture import load_street_furniture

AHEAD = ((12.0, -40.0), (13.0, -40.0), (13.0, 40.0), (12.0, 40.0))
CAR: Box = (Kind.VEHICLE, 10.0, 0.0, 0.0, 4.5, 1.9)


# --- The class


KINDS, SIZES = 4, ((4.6, 1.85), (0.5, 0.5), (1.8, 0.6), (1.2, 0.8))
BIN_M = 15.0


def draw_crowd(seed: int) -> SensingFrame:
    """32 bodies of all kinds around the origin, with names of their own."""
    rng, count = np.random.default_rng(seed), 32
    kinds = (np.arange(count) % KINDS).astype(np.uint8)
    away, angle, yaw = rng.uniform(6.0, 45.0, count), rng.uniform(-3.1, 3.1, count), rng.uniform(-3.1, 3.1, count)
    length, width = np.array(SIZES)[kinds].T
    ids = ("me", *(f"{seed}:{i}" for i in range(count)))
    x, y, yaw = (np.append(0.0, values) for values in (away * np.cos(angle), away * np.sin(angle), yaw))
    sizes = np.append(4.9, length), np.append(2.1, width)
    return SensingFrame(0, Objects(ids, np.append(kinds[:1], kinds), x, y, yaw, 0 * x, *sizes), {})


def sample_intensities(first: int, scenes: int) -> tuple[Float, Int, Int, Float]:
    """Intensity, bin of distance, kind and weight of points; all points of a body in a bin weigh as much as one."""
    of, parts = sensor(optics=None, hit_ids=True), list[Float]()
    for seed in range(first, first + scenes):
        frame = draw_crowd(seed)
        cloud = of.sense(frame, SensorPose(0.0, 0.0, 0.0, 0))
        assert cloud is not None
        kind_by_name = {
            derive_track_name("a", name): kind for name, kind in zip(frame.boxes.ids, frame.boxes.kind, strict=True)
        }
        for i, name in enumerate(cloud.names):
            points = cloud.points[cloud.hit == i].astype(np.float64)
            bins = np.floor(np.linalg.norm(points[:, :3], axis=1) / BIN_M)
            each = 1.0 / np.bincount(bins.astype(int))[bins.astype(int)]
            parts.append(np.column_stack((points[:, 3], bins, np.full(len(points), kind_by_name[name]), each)))
    table = np.concatenate(parts)
    return table[:, 0], table[:, 1].astype(int), table[:, 2].astype(int), table[:, 3]


def build_histograms(light: Float, bins: Int, kinds: Int, weight: Float) -> Float:
    """Return (bins, kinds, levels): how the intensities of each kind are spread in each bin of distance."""
    counts = np.full((4, KINDS, 16), 1e-3)
    np.add.at(counts, (bins, kinds, np.minimum(light * 16, 15).astype(int)), weight)
    return counts / counts.sum(axis=2, keepdims=True)


def test_a_classifier_that_sees_intensity_alone_is_little_better_than_chance() -> None:
    """Chance is 1/4; intensities by class would give 1. A body's points fall on one side of the split only."""
    histograms = build_histograms(*sample_intensities(0, 24))
    light, bins, kinds, weight = sample_intensities(100, 24)
    guesses = histograms[bins, :, np.minimum(light * 16, 15).astype(int)].argmax(axis=1)
    for k in range(3):
        weights = [np.where((bins == k) & (kinds == kind), weight, 0.0) for kind in range(KINDS)]
        rates = [each[guesses == kind].sum() / each.sum() for kind, each in enumerate(weights)]
        assert np.mean(rates) < 0.34, (k, rates)


def test_a_thing_reflects_the_same_to_all_in_one_episode_and_something_else_in_the_next() -> None:
    def mean_light(seed: int, salt: int, *others: Box) -> float:
        cloud = scan(sensor(town(AHEAD), seed=seed, salt=salt, optics=DRY, hit_ids=True), *others)
        return float(cloud.points[cloud.hit == cloud.names.index("building:h0"), 3].mean())

    assert mean_light(1, 7) == pytest.approx(mean_light(2, 7), rel=0.02)
    assert mean_light(1, 7) == pytest.approx(mean_light(1, 7, (Kind.CYCLIST, -9.0, 0.0, 0.0, 1.8, 0.6)), rel=0.02)
    assert len({round(mean_light(1, salt), 1) for salt in range(9)}) > 3


def test_a_box_keeps_its_reflectivity_wherever_it_stands_in_the_list() -> None:
    draws = ReflectivityDraws(town(AHEAD), load_street_furniture(town()), 3, is_wet=False)
    boxes = draw_crowd(0).boxes
    table = draws.list_by_owner(boxes)
    turned = draws.list_by_owner(boxes.take(slice(None, None, -1)))
    n = len(boxes.ids)
    for part in ("lower", "upper", "split", "plate"):
        first, second = getattr(table, part), getattr(turned, part)
        assert (first[1 : n + 1] == second[1 : n + 1][::-1]).all()
        assert (first[0], first[n + 1]) == (second[0], second[n + 1])
    assert len(set(table.lower.tolist())) == n + 2, "every instance has one of its own"


# --- One return


def find_straight_ahead(points: Float) -> Float:
    """The row of the point that lies ahead, the nearest to level."""
    ahead = points[(abs(points[:, 1]) < 1e-6) & (points[:, 0] > 0)]
    return ahead[abs(ahead[:, 2]).argmin()].astype(np.float64)


@pytest.mark.parametrize("turn", [0.0, 0.7, 1.3])
def test_intensity_by_hand(turn: float) -> None:
    """Oren and Nayar's share of the draw for the upper floors, faded by CARLA's formula, in steps of 1/255."""
    cos, sin = math.cos(turn), math.sin(turn)
    ring = tuple((12.0 + x * cos - y * sin, x * sin + y * cos) for x, y in ((0, -60), (1, -60), (1, 60), (0, 60)))
    x, _, z, light = find_straight_ahead(scan(sensor(town(ring), z=4.0)).points)
    upper = 0.1 + 0.75 * draw_uniforms(0, "reflectivity", "building:h0")[1]
    distance = math.hypot(x, z)
    cosine = cos * x / distance
    expected = upper * (cosine + 0.42 * (1 - cosine**2)) * math.exp(-0.004 * distance)
    assert light == pytest.approx(expected, abs=0.5 / 255 + 0.005)  # the angle is kept in steps of 1/126
    assert light * 255 == pytest.approx(round(light * 255), abs=1e-4)


def test_a_car_has_paint_below_windows_above_and_a_plate_that_dazzles() -> None:
    cloud = scan(sensor(hit_ids=True, z=1.6), CAR)
    points = cloud.points[cloud.hit == 0].astype(np.float64)
    rear, height = points[abs(points[:, 0] - 7.75) < 1e-3], points[:, 2] + 1.6
    height = rear[:, 2] + 1.6
    is_plate = (height >= 0.45) & (height < 0.57) & (abs(rear[:, 1]) <= 0.26)
    assert is_plate.any()
    assert (rear[is_plate, 3] == 1.0).all()
    paint, glass = rear[~is_plate & (height < 0.92), 3], rear[height > 0.94, 3]
    assert max(paint.max(), glass.max()) < 1.0
    assert abs(np.median(paint) - np.median(glass)) > 3 * max(np.std(paint), np.std(glass))


def test_returns_are_lost_the_more_the_weaker_and_the_farther() -> None:
    """A return of intensity i from d is lost with the probability w d² / (i + w d²), w = 0.1 / (50 m)²."""
    clean, seen = (scan(sensor(optics=optics)).points for optics in (replace(DRY, weak=0.0, noise=0.0), DRY))
    loss = DRY.weak * (clean[:, :3].astype(np.float64) ** 2).sum(axis=1)
    probability = loss / (clean[:, 3] + loss)
    for near, far in ((0.0, 10.0), (10.0, 25.0), (25.0, 45.0), (45.0, 85.0)):
        count, expected = (
            weights[(distance >= near) & (distance < far)].sum()
            for distance, weights in (
                (np.linalg.norm(seen[:, :3], axis=1), np.ones(len(seen))),
                (np.linalg.norm(clean[:, :3], axis=1), 1.0 - probability),
            )
        )
        assert count == pytest.approx(expected, abs=0.01 * expected + 4 * math.sqrt(expected))


def test_rain_gives_a_few_faint_points_nearby_which_belong_to_nothing() -> None:
    roads = town(((60.0, -1.0), (61.0, -1.0), (61.0, 1.0), (60.0, 1.0)))
    wet, dry = (scan(sensor(roads, weather, optics=None, hit_ids=True, z=6.0)) for weather in ("rain", "default"))
    hanging = wet.points[:, 2] > -4.0
    drops = hanging & (wet.hit == -1)
    away = np.linalg.norm(wet.points[drops, :3], axis=1)
    assert drops.sum() == pytest.approx(RAIN.drops / 256 * 391 * 64, rel=0.35)
    assert (away.min() >= 1.0, away.max() <= 10.0) == (True, True)
    assert np.median(away) < 2.5
    assert wet.points[drops, 3].max() <= 8 / 255
    assert not ((dry.points[:, 2] > -4.0) & (dry.hit == -1)).any()


# --- What stands beside the road


def test_a_stop_sign_hangs_on_its_pole_where_cameras_draw_it_and_dazzles() -> None:
    """The sign of a lane 3.5 m wide stands 2.2 m beside its line, which ends 0.2 m before the edge."""
    roads = replace(town(), stop_signs=(StopSignBox(id="s", lane="r_0", line_pos_m=12.0, length_m=3.0),))
    cloud = scan(sensor(roads, hit_ids=True))
    assert set(cloud.names) == {"pole:sign:0", "sign:0"}
    plate = cloud.points[cloud.hit == cloud.names.index("sign:0")]
    pole = cloud.points[cloud.hit == cloud.names.index("pole:sign:0")]
    assert plate[:, :2] == pytest.approx(np.tile((11.99, -3.75), (len(plate), 1)), abs=0.43)
    assert pole[:, :2] == pytest.approx(np.tile((11.94, -3.75), (len(pole), 1)), abs=0.13)
    assert (plate[:, 2].min() + 2.5, plate[:, 2].max() + 2.5) == pytest.approx((2.3 - 0.42, 2.3 + 0.42), abs=0.15)
    assert pole[:, 2].max() + 2.5 <= 2.3 - 0.42
    assert (plate[:, 3] == 1.0).all()


def test_traffic_lights_stand_right_of_their_lane() -> None:
    plain = bare_road(30.0)
    lane = replace(plain.lanes["r_0"], lights={"next": "tls:0"})
    roads = replace(plain, lanes={"r_0": lane})
    names = load_street_furniture(roads).names
    assert names == ("pole:signal:tls:0", "signal:tls:0")
    cloud = scan(sensor(roads, hit_ids=True), own=(Kind.VEHICLE, 15.0, 0.0, 0.0, 4.9, 2.1))
    light = cloud.points[cloud.hit == cloud.names.index("signal:tls:0"), :3].mean(axis=0)
    assert light == pytest.approx((15.0 - 0.15, -(1.75 + 0.9), 2.7 + 0.5 - 2.5), abs=0.2)


def test_trees_and_hedges_reflect_as_plants() -> None:
    rings = tuple(((i * 9.0, 9.0), (i * 9.0 + 1, 9.0), (i * 9.0, 10.0)) for i in range(20))
    green = tuple(Building(id=f"tree_{i}", polygon=ring) for i, ring in enumerate(rings))
    table = ReflectivityDraws(replace(town(), buildings=green), load_street_furniture(town()), 1, is_wet=False)
    lower = table.list_by_owner(Objects.empty()).lower[1:]
    assert (lower.min() >= 0.25, lower.max() <= 0.7) == (True, True)
