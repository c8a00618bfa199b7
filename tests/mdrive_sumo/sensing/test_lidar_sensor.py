"""LiDAR: rays of the profiles, what is hit, the sensor's pose, noise, and options that are refused."""

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely
from testing.lidar_scans import (
    CAR,
    ELEVATION,
    OWN,
    Box,
    Option,
    height_of,
    make_briefing,
    ray_of,
    rotation,
    scan,
    scene,
    sensor,
    town,
)

from mdrive_sumo.contract import PointCloud, SensorSpec
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float, box_corners
from mdrive_sumo.core.state import Actors, EgoState, Frame, Kind
from mdrive_sumo.scenario.weather import WEATHERS
from mdrive_sumo.sensing.lidar_sensor import LidarSensor
from mdrive_sumo.sensing.observation_builder import ObservationBuilder, SensorContext, build_sensing_frame
from mdrive_sumo.sensing.sensing_frame import SensorPose, SensorSetup, derive_track_name


def test_the_default_profile_turns_every_tick_with_64_channels() -> None:
    wall = ((-20.0, -20.0), (20.0, -20.0), (20.0, -19.0), (-20.0, -19.0))
    around = [tuple((x * c - y * s, x * s + y * c) for x, y in wall) for c, s in ((1, 0), (0, 1), (-1, 0), (0, -1))]
    for tick in (0, 1, 2):
        cloud = scan(sensor(town(*around)), tick=tick)
        assert len(cloud.points) == 391 * 64, "closed in by walls, every ray hits something"
    assert sorted(set(ray_of(cloud.points).tolist())) == list(range(391 * 64))


def test_the_lmdrive_profile_turns_every_second_tick() -> None:
    of = sensor(profile="lmdrive")
    assert of.sense(scene(OWN, tick=1), SensorPose(0, 0, 0, 0)) is None
    cloud = scan(of, tick=2)
    azimuths = np.unique(np.round(np.degrees(np.arctan2(cloud.points[:, 1], cloud.points[:, 0])) / 360 * 938, 3))
    assert len(azimuths) == 938
    assert azimuths == pytest.approx(np.rint(azimuths), abs=1e-2)


@pytest.mark.parametrize(
    ("options", "ticks"),
    [
        ({"every_ticks": 4}, [0, 4, 8, 12]),
        ({"profile": "lmdrive", "every_ticks": 3}, [0, 6, 12]),
        ({"every_ticks": 2, "on_ticks": 4, "cycle_ticks": 6, "cycle_start": 6}, [0, 2, 6, 8, 12]),
    ],
    ids=["default", "both periods", "in turns"],
)
def test_scans_may_be_rarer_and_are_then_the_same(options: dict[str, Option], ticks: list[int]) -> None:
    rare, full = sensor(**options, noise_m=0.1), sensor(**{**options, "every_ticks": 1}, noise_m=0.1)
    scans = {tick: rare.sense(scene(OWN, tick=tick), SensorPose(0, 0, 0, 0)) for tick in range(13)}
    assert [tick for tick, cloud in scans.items() if cloud is not None] == ticks
    assert scans[12] is not None
    np.testing.assert_array_equal(scans[12].points, scan(full, tick=12).points)


def test_channels_lie_evenly_between_30_degrees_below_and_10_above() -> None:
    walls = ((30.0, -50.0), (31.0, -50.0), (31.0, 50.0), (30.0, 50.0))
    points = scan(sensor(town(walls))).points.astype(float)
    ahead = points[np.abs(points[:, 1]) < 1e-6]
    ahead = ahead[ahead[:, 0] > 0]
    found = np.sort(np.degrees(np.arctan2(ahead[:, 2], ahead[:, 0])))
    assert found == pytest.approx(np.linspace(-30, 10, 64), abs=1e-4)


def test_bare_ground_is_hit_within_85_metres_by_the_channels_that_reach_it() -> None:
    points = scan(sensor()).points.astype(float)
    distance = np.linalg.norm(points[:, :3], axis=1)
    assert points[:, 2] == pytest.approx(np.full(len(points), -2.5), abs=1e-4)
    assert 60 < distance.max() <= 85.0
    assert len(points) == 391 * np.count_nonzero(2.5 / np.maximum(-np.sin(ELEVATION), 1e-9) <= 85)


@pytest.mark.parametrize(("weather", "reach"), [("default", 85.0), ("rain", 68.0), ("night", 85.0)])
def test_nothing_is_hit_beyond_the_range_of_the_weather(weather: str, reach: float) -> None:
    def hits(x: float) -> int:
        wall = ((x, -5.0), (x + 1, -5.0), (x + 1, 5.0), (x, 5.0))
        return int((scan(sensor(town(wall), weather=weather, hit_ids=True)).hit >= 0).sum())

    assert hits(reach - 0.1) > 0
    assert hits(reach + 0.1) == 0


def test_the_observation_carries_the_scans_of_the_ticks_that_have_one() -> None:
    specs = (SensorSpec("lidar", "top"), SensorSpec("lidar", "slow", options={"profile": "lmdrive"}))
    senses = ObservationBuilder({"a": specs}, {"a": make_briefing()}, SensorContext(town(), WEATHERS["default"], 0))
    for tick, names in ((0, {"top", "slow"}), (1, {"top"})):
        frame = Frame(tick, {"a": EgoState(5.0, 0.0, 0.0, 0.0)}, Actors.empty(), {})
        seen = senses.build_observations(frame, build_sensing_frame(frame, {"a": (4.9, 2.1)}), {}, {"a": ()})["a"].lidar
        assert set(seen) == names
        assert len(seen["top"].points) > 10_000


# --- What is hit


def test_nothing_is_seen_behind_a_wall() -> None:
    wall = ((10.0, -30.0), (10.5, -30.0), (10.5, 30.0), (10.0, 30.0))
    points = scan(sensor(town(wall)), (Kind.VEHICLE, 20.0, 0.0, 0.0, 12.0, 2.5)).points
    ahead = points[(points[:, 0] > 0) & (abs(points[:, 1]) < points[:, 0])]
    assert ahead[:, 0].max() <= 10.0 + 1e-4


def test_a_car_hides_the_pedestrian_behind_it_and_a_low_obstacle_does_not() -> None:
    pedestrian: Box = (Kind.PEDESTRIAN, 12.0, 0.0, 0.0, 0.5, 0.5)
    for kind, length, sees in ((Kind.VEHICLE, 8.0, False), (Kind.STATIC, 2.0, True)):
        cloud = scan(sensor(z=2.0, hit_ids=True), (kind, 7.0, 0.0, 0.0, length, 3.0), pedestrian)
        assert (derive_track_name("a", "c") in cloud.names) == sees


@pytest.mark.parametrize(
    ("kind", "length", "height"),
    [
        (Kind.VEHICLE, 4.5, 1.5),
        (Kind.VEHICLE, 6.0, 2.2),
        (Kind.VEHICLE, 12.0, 3.4),
        (Kind.PEDESTRIAN, 0.5, 1.75),
        (Kind.CYCLIST, 1.8, 1.75),
        (Kind.STATIC, 1.0, 1.0),
    ],
)
def test_boxes_are_as_high_as_documented(kind: Kind, length: float, height: float) -> None:
    cloud = scan(sensor(hit_ids=True), (kind, 6.0 + length / 2, 0.0, 0.0, length, 2.0))
    top = float(cloud.points[cloud.hit == 0, 2].max()) + 2.5
    assert top <= height + 1e-4
    assert top > height - 0.1


def test_the_carrier_is_not_hit() -> None:
    cloud = scan(sensor(hit_ids=True))
    assert cloud.names == ()
    assert (cloud.hit == -1).all()


def test_every_point_lies_on_the_surface_of_what_it_names() -> None:
    yard = ((15.0, -30.0), (40.0, -30.0), (40.0, 30.0), (15.0, 30.0), (25.0, 0.0))
    boxes = [OWN, (Kind.VEHICLE, 8.0, 4.0, 0.4, 4.5, 1.9), (Kind.CYCLIST, -9.0, -3.0, 2.0, 1.8, 0.6)]
    cloud = scan(sensor(town(yard), hit_ids=True), *boxes[1:])
    names = {f"{derive_track_name('a', 'b')}": boxes[1], f"{derive_track_name('a', 'c')}": boxes[2]}
    assert set(cloud.names) == {*names, "building:h0"}
    points = cloud.points[:, :3].astype(float) + np.array((0.0, 0.0, 2.5))
    assert abs(points[cloud.hit < 0, 2]).max() < 1e-3
    for index, name in enumerate(cloud.names):
        on = points[cloud.hit == index]
        shape = shapely.Polygon(box_corners(*names[name][1:]) if name in names else yard)
        side = shapely.distance(shapely.points(on[:, :2]), shape.exterior)
        roof = abs(on[:, 2] - height_of(names[name])) if name in names else np.full(len(on), np.inf)
        assert np.minimum(side, roof).max() < 1e-3
        assert shapely.dwithin(shapely.points(on[:, :2]), shape, 1e-3).all()


def test_a_scan_without_hit_ids_has_the_same_points_and_no_names() -> None:
    other: Box = (Kind.VEHICLE, 10.0, 0.0, 0.0, 4.5, 1.9)
    plain, named = scan(sensor(), other), scan(sensor(hit_ids=True), other)
    assert (plain.points == named.points).all()
    assert (len(plain.hit), plain.names) == (0, ())
    assert len(named.hit) == len(named.points)
    assert plain.points.dtype == np.float32
    assert named.hit.dtype == np.int32


def test_intensity_falls_with_distance_and_depends_on_the_material() -> None:
    cloud = scan(
        sensor(hit_ids=True), (Kind.VEHICLE, 10.0, 0.0, 0.0, 4.5, 1.9), (Kind.STATIC, -9.0, 0.0, 0.0, 1.0, 3.0)
    )
    faded = np.exp(-0.004 * np.linalg.norm(cloud.points[:, :3], axis=1))
    material = np.array([{derive_track_name("a", "b"): 0.8}.get(name, 0.6) for name in cloud.names] + [0.2])[cloud.hit]
    assert cloud.points[:, 3] == pytest.approx(material * faded, abs=1e-5)


# --- Pose


def post_at(cloud: PointCloud) -> Float:
    """Mean of the points on the one thing that is there."""
    return cloud.points[cloud.hit == 0, :3].astype(float).mean(axis=0)


POST: Box = (Kind.PEDESTRIAN, 10.0, 0.0, 0.0, 0.4, 0.4)


def test_the_scan_is_in_the_frame_of_the_sensor_on_its_car() -> None:
    own: Box = (Kind.VEHICLE, 10.0, -10.0, math.pi / 2, 4.9, 2.1)
    assert post_at(scan(sensor(hit_ids=True), POST, own=own))[:2] == pytest.approx((9.8, 0.0), abs=0.05)
    moved = post_at(scan(sensor(hit_ids=True, x=2.0, y=1.0, z=3.0), POST, own=own))
    assert moved[:2] == pytest.approx((7.8, -1.0), abs=0.1)
    turned = post_at(scan(sensor(hit_ids=True, yaw_deg=90.0), POST, own=own))
    assert turned[:2] == pytest.approx((0.0, -9.8), abs=0.05)


@pytest.mark.slow
def test_roll_and_pitch_turn_right_handed() -> None:
    for option, turn in (
        ("pitch_deg", rotation(0, math.radians(10), 0)),
        ("roll_deg", rotation(math.radians(10), 0, 0)),
    ):
        cloud = scan(sensor(hit_ids=True, **{option: 10.0}), POST)
        level = cloud.points[:, :3].astype(float) @ turn.T
        assert level[cloud.hit < 0, 2] == pytest.approx(np.full((cloud.hit < 0).sum(), -2.5), abs=1e-3)
    down = scan(sensor(pitch_deg=90.0)).points
    assert down[:, 0].min() >= -1e-4, "with its nose on the ground it sees ground ahead only"


# --- Noise


WALLED = ((20.0, -80.0), (21.0, -80.0), (21.0, 80.0), (20.0, 80.0))


def test_noise_is_along_the_ray_and_as_wide_as_asked() -> None:
    clean, noisy = scan(sensor(town(WALLED))), scan(sensor(town(WALLED), noise_m=0.05))
    assert len(clean.points) == len(noisy.points)
    error = np.linalg.norm(noisy.points[:, :3], axis=1) - np.linalg.norm(clean.points[:, :3], axis=1)
    assert abs(error.mean()) < 0.05 * 4 / math.sqrt(len(error))
    assert error.std() == pytest.approx(0.05, rel=0.03)
    assert (ray_of(clean.points) == ray_of(noisy.points)).all()


def test_dropout_loses_as_many_points_as_asked_and_changes_no_other() -> None:
    clean, thin = scan(sensor(town(WALLED))), scan(sensor(town(WALLED), dropout=0.3))
    share = 1 - len(thin.points) / len(clean.points)
    assert share == pytest.approx(0.3, abs=4 * math.sqrt(0.21 / len(clean.points)))
    assert {tuple(p) for p in thin.points.tolist()} < {tuple(p) for p in clean.points.tolist()}
    assert len(scan(sensor(dropout=1.0)).points) == 0


def test_noise_depends_on_the_seed_and_the_tick_only() -> None:
    def noisy(tick: int, seed: int = 5, before: int = 0) -> bytes:
        of = sensor(seed=seed, noise_m=0.05, dropout=0.2)
        for earlier in range(before):
            scan(of, tick=earlier)
        return scan(of, tick=tick).points.tobytes()

    assert noisy(7) == noisy(7, before=3)
    assert len({noisy(7), noisy(8), noisy(7, seed=6)}) == 3


@pytest.mark.slow
def test_noise_of_one_ray_does_not_depend_on_what_others_hit() -> None:
    other: Box = (Kind.VEHICLE, 10.0, 0.0, 0.0, 4.5, 1.9)
    alone, together = (scan(sensor(noise_m=0.05, dropout=0.2), *others).points for others in ((), (other,)))
    behind = {tuple(p) for p in alone.tolist() if p[0] < 0}
    assert behind == {tuple(p) for p in together.tolist() if p[0] < 0}


# --- Refusals


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"channels": 32.0}, "pose only"),
        ({"range": 100.0}, "pose only"),
        ({"points_per_second": 1e6}, "fixes by its profile"),
        ({"upper_fov": 15.0}, "'upper_fov'"),
        ({"colour": "red"}, "'colour'"),
        ({"every_ticks": 0}, "'every_ticks': expected a number in [1, 200], found 0"),
        ({"every_ticks": 1.5}, "'every_ticks': expected a whole number, found 1.5"),
        ({"profile": "fast"}, "expected one of default, lmdrive, found 'fast'"),
        ({"z": 1.2}, "inside it"),
        ({"x": 2.4, "y": -1.0, "z": 1.5}, "inside it"),
        ({"z": -1.0}, "'z'"),
        ({"z": 30.0}, "'z'"),
        ({"x": math.nan}, "'x'"),
        ({"yaw_deg": 400.0}, "'yaw_deg'"),
        ({"noise_m": -0.1}, "'noise_m'"),
        ({"dropout": 1.5}, "'dropout'"),
        ({"hit_ids": 1.0}, "expected true or false"),
        ({"noise_m": True}, "'noise_m'"),
    ],
)
def test_bad_options_are_refused(options: dict[str, Option], says: str) -> None:
    with pytest.raises(InputError, match=r"sensor 'lidar'") as caught:
        sensor(**options)
    assert says in str(caught.value)


def test_a_declared_range_is_refused() -> None:
    with pytest.raises(InputError, match="only the pose is honoured"):
        LidarSensor(
            SensorSpec("lidar", range_m=50.0), SensorSetup("a", 0, town(), WEATHERS["default"], make_briefing())
        )


def test_a_pose_beside_or_above_the_body_is_fine_and_a_bus_carries_its_sensor_higher() -> None:
    sensor(x=2.5, z=0.5)
    sensor(z=1.51)
    bus = SensorSetup("a", 0, town(), WEATHERS["default"], make_briefing(replace(CAR, length=12.0)))
    cloud = LidarSensor(SensorSpec("lidar"), bus).sense(
        scene((Kind.VEHICLE, 0, 0, 0, 12.0, 2.5)), SensorPose(0, 0, 0, 0)
    )
    assert cloud is not None
    assert cloud.points[:, 2].min() == pytest.approx(-4.4, abs=1e-4)
