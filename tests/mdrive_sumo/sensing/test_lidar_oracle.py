"""LiDAR against a brute-force caster of our own: every ray against every face, one face at a time."""

import math
from dataclasses import dataclass

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from testing.lidar_scans import COLUMNS, ELEVATION, OWN, Box, Ring, height_of, ray_of, rotation, scan, sensor, town
from testing.sampling import examples

from mdrive_sumo.core.geometry import Float, box_corners
from mdrive_sumo.core.state import Kind
from mdrive_sumo.sensing.sensing_frame import derive_track_name

pytestmark = pytest.mark.slow


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
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
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
    return Case(own, others, shifted, pose)


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
@settings(max_examples=examples(10, 40), deadline=None)
def test_all_rays_agree_with_brute_force(case: Case) -> None:
    check(case)


@given(cases(leaning=True))
@settings(max_examples=examples(6, 20), deadline=None)
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
