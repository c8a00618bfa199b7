"""LiDAR against a brute-force caster of our own: every ray against every face, one face at a time."""

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from testing.worlds import straight_road

from mdrive_sumo.contract import Briefing, Objects, PointCloud, SensorSpec, VehicleFacts
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float, box_corners
from mdrive_sumo.core.state import Actors, EgoState, Frame, Kind
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.roads.network_file import Building
from mdrive_sumo.scenario.weather import WEATHERS
from mdrive_sumo.sensing.lidar_sensor import LidarSensor
from mdrive_sumo.sensing.observation_builder import ObservationBuilder, SensorContext, build_sensing_frame
from mdrive_sumo.sensing.sensing_frame import SensingFrame, SensorPose, SensorSetup, derive_track_name

CAR = VehicleFacts(4.9, 2.1, 2.85, 1.4, 1700.0, 1.2, 50.0, 3.0, 8.0)
ELEVATION = np.radians(np.linspace(-30.0, 10.0, 64))
COLUMNS = 391
OWN = (Kind.VEHICLE, 0.0, 0.0, 0.0, 4.9, 2.1)

Box = tuple[Kind, float, float, float, float, float]
Ring = tuple[tuple[float, float], ...]
Option = float | str | bool


def height_of(box: Box) -> float:
    """As documented, in our own words."""
    kind, length = box[0], box[4]
    if kind == Kind.VEHICLE:
        return 1.5 if length < 5.5 else 2.2 if length < 7.5 else 3.4
    return 1.0 if kind == Kind.STATIC else 1.75


def town(*rings: Ring) -> RoadMap:
    return replace(straight_road(), buildings=tuple(Building(id=f"h{i}", polygon=r) for i, r in enumerate(rings)))


def told(vehicle: VehicleFacts = CAR) -> Briefing:
    xy = np.array([(0.0, 0.0), (1.0, 0.0)])
    zero = np.zeros(2)
    return Briefing("a", 0, 0.05, 30.0, vehicle, xy, zero, np.arange(2.0), zero + 3.5, zero + 10.0)


def sensor(roads: RoadMap | None = None, weather: str = "default", seed: int = 5, **options: Option) -> LidarSensor:
    fitting = SensorSetup("a", seed, roads or town(), WEATHERS[weather], told())  # type: ignore[index]
    return LidarSensor(SensorSpec("lidar", "top", options=options), fitting)


def scene(*boxes: Box, tick: int = 0) -> SensingFrame:
    table = np.array([box[1:] for box in boxes])
    kinds = np.array([box[0] for box in boxes], dtype=np.uint8)
    ids = tuple("abcdefghijklmnopqrstuvwxyz"[: len(boxes)])
    return SensingFrame(tick, Objects(ids, kinds, *table[:, :3].T, np.zeros(len(boxes)), *table[:, 3:].T), {})


def scan(of: LidarSensor, *others: Box, own: Box = OWN, tick: int = 0) -> PointCloud:
    cloud = of.sense(scene(own, *others, tick=tick), SensorPose(own[1], own[2], own[3], 0))
    assert cloud is not None
    return cloud


def rotation(roll: float, pitch: float, yaw: float) -> Float:
    """By Rodrigues' formula about each axis in turn."""
    total = np.eye(3)
    for axis, angle in ((0, roll), (1, pitch), (2, yaw)):
        k = np.cross(np.eye(3)[axis], np.eye(3)).T
        total = (np.eye(3) + math.sin(angle) * k + (1 - math.cos(angle)) * k @ k) @ total
    return total


@dataclass
class Oracle:
    """Plain ray casting; owners: 0 ground, then the boxes, then the buildings."""

    origin: Float
    rings: list[tuple[int, Float, float]]
    """Owner, counter-clockwise corners, height."""
    owners: int

    def distances(self, rays: Float) -> Float:
        """(R, owners) distance [m] to the nearest outside face of each."""
        best = np.full((len(rays), self.owners), np.inf)
        with np.errstate(divide="ignore", invalid="ignore"):
            fall = -self.origin[2] / rays[:, 2]
            best[:, 0] = np.where(rays[:, 2] < 0, fall, np.inf)
            for owner, ring, height in self.rings:
                for face in (self._sides(ring, height, rays), self._roof(ring, height, rays)):
                    best[:, owner] = np.minimum(best[:, owner], face)
        return best

    def _sides(self, ring: Float, height: float, rays: Float) -> Float:
        best = np.full(len(rays), np.inf)
        for a, b in zip(ring, np.roll(ring, -1, axis=0), strict=True):
            normal = np.array((b[1] - a[1], a[0] - b[0]))  # outward of a counter-clockwise ring
            facing = rays[:, :2] @ normal
            t = ((a - self.origin[:2]) @ normal) / facing
            at = self.origin + t[:, None] * rays
            along = (at[:, :2] - a) @ (b - a) / ((b - a) @ (b - a))
            on = (facing < 0) & (t > 0) & (along >= 0) & (along <= 1) & (at[:, 2] <= height)
            best = np.where(on, np.minimum(best, t), best)
        return best

    def _roof(self, ring: Float, height: float, rays: Float) -> Float:
        t = (height - self.origin[2]) / rays[:, 2]
        at = self.origin + np.where(np.isfinite(t), t, 0)[:, None] * rays
        inside = shapely.contains_xy(shapely.Polygon(ring), at[:, 0], at[:, 1])
        return np.where((rays[:, 2] < 0) & (t > 0) & inside, t, np.inf)


def oracle_of(boxes: list[Box], rings: list[Ring], origin: Float) -> Oracle:
    faces = [(i, box_corners(*box[1:]), height_of(box)) for i, box in enumerate(boxes, start=1)]
    for i, ring in enumerate(rings, start=1 + len(boxes)):
        corners = np.array(ring)
        x, y = corners.T
        area = (x * np.roll(y, -1) - np.roll(x, -1) * y).sum()
        faces.append((i, corners if area > 0 else corners[::-1], 10.0))
    return Oracle(origin, [face for face in faces if face[0] != 1], 1 + len(boxes) + len(rings))  # 1 is the carrier


def local_rays() -> Float:
    azimuth, elevation = np.meshgrid(2 * math.pi * np.arange(COLUMNS) / COLUMNS, ELEVATION, indexing="ij")
    flat = np.cos(elevation)
    return np.stack((flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)), axis=-1).reshape(-1, 3)


def ray_of(points: Float) -> np.ndarray:
    """Which ray of the scan each point is, by its direction."""
    column = np.rint(np.arctan2(points[:, 1], points[:, 0]) / (2 * math.pi) * COLUMNS).astype(int) % COLUMNS
    up = np.degrees(np.arctan2(points[:, 2], np.hypot(points[:, 0], points[:, 1])))
    return column * 64 + np.rint((up + 30) / 40 * 63).astype(int)


@dataclass(frozen=True)
class Case:
    """A random scene and pose."""

    own: Box
    others: list[Box]
    rings: list[Ring]
    pose: dict[str, float]

    def origin(self) -> Float:
        p, (_, x, y, yaw, *_size) = self.pose, self.own
        cos, sin = math.cos(yaw), math.sin(yaw)
        return np.array((x + cos * p["x"] - sin * p["y"], y + sin * p["x"] + cos * p["y"], p["z"]))

    def turn(self) -> Float:
        roll, pitch, yaw = (math.radians(self.pose.get(f"{n}_deg", 0.0)) for n in ("roll", "pitch", "yaw"))
        return rotation(0, 0, self.own[3]) @ rotation(roll, pitch, yaw)


def near_or_far() -> st.SearchStrategy[float]:
    return st.floats(-12, 12) | st.floats(-90, 90)


ANGLE = st.floats(-math.pi, math.pi)
BOXES = st.tuples(
    st.sampled_from(list(Kind)), near_or_far(), near_or_far(), ANGLE, st.floats(0.3, 14.0), st.floats(0.3, 3.0)
)


@st.composite
def rings(draw: st.DrawFn) -> Ring:
    """A star-shaped polygon, rarely convex, in either direction of turning; it may enclose the sensor."""
    x, y = draw(near_or_far()), draw(near_or_far())
    count = draw(st.integers(3, 8))
    radii = draw(st.lists(st.floats(1.0, 30.0), min_size=count, max_size=count))
    angles = [2 * math.pi * i / count for i in range(count)]
    ring = [(x + r * math.cos(a), y + r * math.sin(a)) for r, a in zip(radii, angles, strict=True)]
    return tuple(ring if draw(st.booleans()) else ring[::-1])


@st.composite
def cases(draw: st.DrawFn, leaning: bool) -> Case:
    own: Box = (Kind.VEHICLE, draw(st.floats(-1e3, 1e3)), draw(st.floats(-1e3, 1e3)), draw(ANGLE), 4.9, 2.1)
    pose = {"x": draw(st.floats(-3, 3)), "y": draw(st.floats(-2, 2)), "z": draw(st.floats(1.55, 9.0))}
    pose["yaw_deg"] = draw(st.floats(-180, 180))
    if leaning:
        pose |= {"roll_deg": draw(st.floats(-180, 180)), "pitch_deg": draw(st.floats(-180, 180))}
    others = [(k, x + own[1], y + own[2], *rest) for k, x, y, *rest in draw(st.lists(BOXES, max_size=12))]
    shifted = [tuple((x + own[1], y + own[2]) for x, y in ring) for ring in draw(st.lists(rings(), max_size=3))]
    return Case(own, others, shifted, pose)  # type: ignore[arg-type]


def check(case: Case) -> None:
    """Every ray agrees with the oracle, or with the oracle for a ray that points a hair aside."""
    cloud = scan(sensor(town(*case.rings), hit_ids=True, **case.pose), *case.others, own=case.own)
    boxes = [case.own, *case.others]
    names = [derive_track_name("a", "abcdefghijklmnopqrstuvwxyz"[i]) for i in range(len(boxes))]
    owner_of = {name: i for i, name in enumerate([*names, *(f"building:h{i}" for i in range(len(case.rings)))], 1)}
    owners = np.array([*(owner_of[name] for name in cloud.names), 0])[cloud.hit]
    rows = ray_of(cloud.points)
    assert len(set(rows.tolist())) == len(rows)
    found = np.full(len(local_rays()), 1e9)
    whose = np.zeros(len(found), dtype=int)
    found[rows], whose[rows] = np.linalg.norm(cloud.points[:, :3].astype(float), axis=1), owners
    oracle = oracle_of(boxes, case.rings, case.origin())
    agrees = np.zeros(len(found), dtype=bool)
    for aside in np.vstack((np.zeros(3), np.eye(3), -np.eye(3))) * 2e-6:
        open_ = np.flatnonzero(~agrees)
        expected = np.minimum(oracle.distances((local_rays()[open_] + aside) @ case.turn().T), 1e6)
        first = expected.min(axis=1)
        his = expected[np.arange(len(open_)), whose[open_]]
        hit = (first <= 85.0) & (abs(found[open_] - first) < 1e-3) & (abs(his - first) < 1e-3)
        agrees[open_] = hit | ((first > 85.0) & (found[open_] == 1e9))
        if aside.any():
            continue
        assert (~agrees).sum() <= 60, "more than grazing rays disagree"
    assert agrees.all(), (case, np.flatnonzero(~agrees)[:5], found[~agrees][:5])


@given(cases(leaning=False))
@settings(max_examples=40, deadline=None)
def test_all_rays_agree_with_brute_force(case: Case) -> None:
    check(case)


@given(cases(leaning=True))
@settings(max_examples=20, deadline=None)
def test_all_rays_of_a_leaning_sensor_agree_with_brute_force(case: Case) -> None:
    check(case)


AMID = {"x": 0.3, "y": -0.2, "z": 2.5, "yaw_deg": 30.0}
COURT = ((-9.0, -9.0), (9.0, -9.0), (9.0, 9.0), (-9.0, 9.0), (-9.0, 8.0), (8.0, 8.0), (8.0, -8.0), (-9.0, -8.0))


@pytest.mark.parametrize("lean", [{}, {"roll_deg": 20.0, "pitch_deg": -35.0}])
@pytest.mark.parametrize(
    ("others", "rings"),
    [
        ([(Kind.VEHICLE, 1.0, 0.5, 0.7, 4.5, 1.9)], []),  # below the sensor after a crash
        ([(Kind.VEHICLE, 1.0, 0.5, 0.7, 4.5, 1.9), (Kind.PEDESTRIAN, 2.0, 1.0, 0.0, 0.5, 0.5)], []),  # run over
        ([(Kind.VEHICLE, 1.0, 0.5, 0.7, 12.0, 2.5), (Kind.VEHICLE, 9.0, 0.0, 0.0, 4.5, 1.9)], []),  # inside a bus
        ([(Kind.VEHICLE, 20.0, 0.5, 0.7, 4.5, 1.9)], [((-5.0, -5.0), (30.0, -5.0), (30.0, 5.0), (-5.0, 5.0))]),
        ([(Kind.STATIC, 7.7, 3.0, 0.0, 1.0, 1.0)], [COURT]),  # a court that is open to the left rear
        ([(Kind.VEHICLE, 88.0, 3.0, 0.0, 12.0, 2.5), (Kind.VEHICLE, 0.0, -89.0, 0.0, 4.0, 9.0)], []),  # at the limit
    ],
)
def test_odd_places_agree_with_brute_force(others: list[Box], rings: list[Ring], lean: dict[str, float]) -> None:
    check(Case(OWN, others, rings, AMID | lean))


@pytest.mark.full
@given(st.booleans().flatmap(lambda leaning: cases(leaning)))
@settings(max_examples=400, deadline=None)
def test_many_more_scenes_agree_with_brute_force(case: Case) -> None:
    check(case)


# --- Rays


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
    senses = ObservationBuilder({"a": specs}, {"a": told()}, SensorContext(town(), WEATHERS["default"], 0))
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
        LidarSensor(SensorSpec("lidar", range_m=50.0), SensorSetup("a", 0, town(), WEATHERS["default"], told()))


def test_a_pose_beside_or_above_the_body_is_fine_and_a_bus_carries_its_sensor_higher() -> None:
    sensor(x=2.5, z=0.5)
    sensor(z=1.51)
    bus = SensorSetup("a", 0, town(), WEATHERS["default"], told(replace(CAR, length=12.0)))
    cloud = LidarSensor(SensorSpec("lidar"), bus).sense(
        scene((Kind.VEHICLE, 0, 0, 0, 12.0, 2.5)), SensorPose(0, 0, 0, 0)
    )
    assert cloud is not None
    assert cloud.points[:, 2].min() == pytest.approx(-4.4, abs=1e-4)
