"""Certificates of need: a corner made by hand, where the answer is known, and an independent simulation."""

import math
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from testing.blind_corner import CROSSING_X, BlindCorner, see_past_corner

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.state import Kind
from mdrive_sumo.scenario.scenario import RoadsideUnit
from mdrive_sumo.scenario.suite import load_suite
from mdrive_sumo.study.need.approach import OVERRUN_M, ApproachState
from mdrive_sumo.study.need.conflict_zone import ZoneFinder, find_largest_rectangle
from mdrive_sumo.study.need.motion import MotionLimits, build_route_motion
from mdrive_sumo.study.need.occluders import SightBox, StandingOccluders, StandingVehicles
from mdrive_sumo.study.need.sight_tables import SightTables
from mdrive_sumo.study.need_certificate import NEED_FILE, NeedCertificate, NeedCertificateFile, Proof, certify_need

BASE = BlindCorner()
MAST = RoadsideUnit(id="mast", x=70.0, y=-20.0)
CYCLIST = BlindCorner(kind=Kind.CYCLIST, speed=7.0, is_cav=False, gap=0.3, side=1.3, rsus=(MAST,))
WORSE_BRAKES = MotionLimits(deceleration=6.0)


@cache
def certify(corner: BlindCorner, limits: MotionLimits | None = None) -> NeedCertificate:
    return certify_need(corner.scenario, corner.roads, corner.record, limits)


def is_blind(corner: BlindCorner, limits: MotionLimits | None = None) -> bool:
    return certify(corner, limits).proves is not None


@pytest.mark.slow
def test_a_wall_at_the_corner_makes_the_conflict_blind_and_the_crossing_car_tells_of_itself() -> None:
    assert certify(BASE).proves is certify(BASE).proves_over_roofs is Proof.CONFLICT
    (found,) = certify(BASE).conflicts
    assert (found.ego, found.road_user, found.stations) == ("a", "b", ("b",))
    assert found.required_speed == pytest.approx(89.1 / 12.0, abs=0.01)
    # "b" is seen when its nose comes into the line past the corner; the message is there from the first tick.
    tick = round(found.own_sight_s * 20) if found.own_sight_s else 0
    nose = (tick - 100) / 20 * BASE.speed + 2.45
    assert nose > see_past_corner(BASE, tick * 0.5) > nose - BASE.speed / 20 - 0.5
    assert found.lead_s == found.own_sight_s


@pytest.mark.slow
def test_the_verdict_flips_where_the_wall_moves_a_metre_away() -> None:
    assert is_blind(replace(BASE, gap=2.0))
    assert not is_blind(replace(BASE, gap=3.0))


def test_without_a_wall_nothing_is_certified() -> None:
    found = certify(replace(BASE, has_wall=False))
    assert (found.proves, found.proves_over_roofs, found.conflicts) == (None, None, ())


@pytest.mark.slow
def test_more_time_never_makes_a_certificate() -> None:
    found = [certify(replace(BASE, time_limit_s=limit)) for limit in (8.5, 12.0, 30.0)]
    # A careful driver needs 8.91 s: too long for the first limit only. 30 s leave time to creep at 2.97 m/s.
    assert [one.proves for one in found] == [Proof.ALL, Proof.CONFLICT, None]
    assert {one.routes[0].cautious_s for one in found} == {8.91}


def test_a_limit_that_cannot_be_kept_at_all_proves_nothing() -> None:
    assert not is_blind(replace(BASE, time_limit_s=5.0))


def test_without_a_station_that_sees_it_there_is_no_certificate() -> None:
    assert not is_blind(replace(BASE, is_cav=False))


@pytest.mark.slow
def test_a_road_side_unit_is_a_witness() -> None:
    (found,) = certify(CYCLIST).conflicts
    assert found.stations == ("mast",)
    assert found.told_s is not None


@pytest.mark.slow
def test_a_certificate_keeps_with_worse_brakes_and_with_another_occluder() -> None:
    assert is_blind(BASE, WORSE_BRAKES)
    assert is_blind(replace(BASE, more=((30.0, -6.0, 0.0, 12.0, 2.5),)))


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "over_roofs"), [(Kind.STATIC, False), (Kind.VEHICLE, True)])
def test_a_lidar_on_the_roof_looks_over_a_fence_but_not_over_a_lorry(kind: Kind, over_roofs: bool) -> None:
    standing = (CROSSING_X - 2.6, -62.0, math.pi / 2, 120.0, 2.6)
    found = certify(replace(BASE, has_wall=False, more=(standing,), more_kind=kind))
    assert (found.proves, found.proves_over_roofs) == (Proof.CONFLICT, Proof.CONFLICT if over_roofs else None)


def test_a_car_is_committed_below_its_braking_distance() -> None:
    motion = build_route_motion(BASE.scenario.egos[0], BASE.roads, MotionLimits(deceleration=8.0, drag=0.0))
    (zone,) = ZoneFinder(BASE.record, 0, motion).find_zones()
    # Side of "b" at x = 59, nose of "a" 2.45 m ahead of its centre; the zone is smaller, never larger.
    assert 0.0 < zone.enter_m - (59.0 - 2.45) < 0.6
    assert 0.0 < (61.0 + 2.45) - zone.leave_m < 0.6
    for speed in (4.0, 10.0):
        limit_m = zone.enter_m + OVERRUN_M - speed * speed / 16.0
        for off, committed in ((0.01, True), (-0.01, False)):
            state = ApproachState(motion, zone, limit_m + off, limit_m + off, speed, speed)
            assert state.is_committed is committed
    standing = ApproachState(motion, zone, zone.enter_m, zone.enter_m, 0.0, 0.0)
    assert standing.clear_s == pytest.approx(math.sqrt(2.0 * (zone.leave_m - zone.enter_m) / 4.5))


@pytest.mark.slow
def test_the_table_of_sight_hides_no_more_than_the_wall_does() -> None:
    motion = build_route_motion(BASE.scenario.egos[0], BASE.roads, MotionLimits())
    (zone,) = ZoneFinder(BASE.record, 0, motion).find_zones()
    tables = SightTables(StandingVehicles(BASE.record, False), BASE.roads, 0, motion, zone)
    ticks = np.arange(60, zone.leave + 1)
    noses = (ticks - 100) / 20 * BASE.speed + 2.45
    wall = shapely.Polygon(BASE.roads.buildings[0].polygon)
    for row in range(len(tables.edges) - 1):
        visible = tables.look_from_route(row, 0)[tables.find_cells(ticks)]
        for eye_x in tables.edges[row : row + 2]:
            targets = shapely.box(np.full(len(noses), 59.0), noses - 4.9, np.full(len(noses), 61.0), noses)
            clear = [_has_clear_line(float(eye_x), target, wall) for target in targets.tolist()]
            assert not (np.array(clear) & ~visible).any()


def _has_clear_line(eye_x: float, target: shapely.Polygon, wall: shapely.Polygon) -> bool:
    corners = target.exterior.coords[:4]
    return any(not shapely.LineString([(eye_x, 0.0), corner]).crosses(wall) for corner in corners)


def is_inside(box: SightBox, x: float, y: float) -> bool:
    cos, sin = math.cos(box.yaw), math.sin(box.yaw)
    ahead, aside = cos * (x - box.x) + sin * (y - box.y), cos * (y - box.y) - sin * (x - box.x)
    return abs(ahead) <= box.length / 2 and abs(aside) <= box.width / 2


@settings(max_examples=30, deadline=None)
@given(
    st.tuples(st.floats(-20, 20), st.floats(3, 12), st.floats(0, 3), st.floats(2, 12), st.floats(1, 3)),
    st.floats(0.05, 1.0),
    st.floats(0, 2 * math.pi),
    st.floats(15, 40),
)
@example((0.0, 3.0, 1.0, 4.0, 3.0), 1.0, 2.0, 15.0)  # the eye would move into the occluder
def test_what_is_hidden_behind_eroded_occluders_is_hidden_from_all_around(
    occluder: tuple[float, float, float, float, float], erosion: float, angle: float, y: float
) -> None:
    between = StandingOccluders(
        StandingVehicles(BASE.record, False), replace(BASE.roads, buildings=()), (0, 1), shapely.box(-99, -99, 99, 99)
    )
    targets = tuple(SightBox(x, y, 0.4, 4.9, 2.0) for x in np.linspace(-40, 40, 15).tolist())
    box = (SightBox(*occluder),)
    eye = (erosion * math.cos(angle), erosion * math.sin(angle))
    assume(not is_inside(box[0], *eye))  # no sensor stands inside a vehicle
    visible = between.find_visible((0.0, 0.0), erosion, box, targets)
    moved = between.find_visible(eye, 0.0, box, targets)
    assert not (moved & ~visible).any()


@given(st.lists(st.lists(st.booleans(), min_size=5, max_size=5), min_size=1, max_size=5))
def test_the_largest_rectangle_is_full_and_none_is_larger(rows: list[list[bool]]) -> None:
    mask = np.array(rows)
    full = [
        (bottom - top + 1) * (right - left + 1)
        for top in range(len(rows))
        for bottom in range(top, len(rows))
        for left in range(5)
        for right in range(left, 5)
        if mask[top : bottom + 1, left : right + 1].all()
    ]
    if not full:
        with pytest.raises(ValueError, match="True cell"):
            find_largest_rectangle(mask)
        return
    top, bottom, left, right = find_largest_rectangle(mask)
    assert mask[top : bottom + 1, left : right + 1].all()
    assert (bottom - top + 1) * (right - left + 1) == max(full)


def collides(corner: BlindCorner, speed: float, shift: int) -> bool:
    """Whether "a" at constant speed collides with "b" that comes `shift` ticks later, whether it then brakes with
    8.3 m/s2 or accelerates with 4.5 m/s2 from the tick in which it first sees it; by simulation and shapely alone."""
    wall = shapely.Polygon(corner.roads.buildings[0].polygon)
    drives = []
    for gain in (-8.3, 4.5):
        x, v, seen, hit = 0.0, speed, False, False
        for tick in range(400):
            y = (max(tick - shift, 0) - 100) / 20 * corner.speed
            other, own = shapely.box(59.0, y - 2.45, 61.0, y + 2.45), shapely.box(x - 2.45, -1.0, x + 2.45, 1.0)
            hit = hit or own.intersects(other)
            seen = seen or _has_clear_line(x, other, wall)
            x, v = x + v / 20, max(v + gain / 20, 0.0) if seen else v
        drives.append(hit)
    return all(drives)


@pytest.mark.slow
@pytest.mark.parametrize("speed", [8.0, 13.0])
def test_every_steady_drive_collides_for_some_start_where_blindness_is_certified(speed: float) -> None:
    assert certify(CYCLIST).proves is Proof.ALL
    arrival = round((CROSSING_X - 5.0) / speed * 20) - 100
    assert any(collides(CYCLIST, speed, shift) for shift in range(arrival - 16, arrival + 24, 2))


@pytest.mark.slow
def test_a_file_is_read_as_it_was_written(tmp_path: Path) -> None:
    one = certify(BASE)
    file = NeedCertificateFile(suite_checksum="sha256:0", certificates=(one, one))
    file.save(tmp_path)
    assert NeedCertificateFile.read(tmp_path) == file
    assert (one.holds, one.proves, one.lead_s) == (True, Proof.CONFLICT, one.conflicts[0].lead_s)
    assert file.of(load_suite("interdrive@0")) == {}
    (tmp_path / NEED_FILE).write_text('{"format": "other"}')
    with pytest.raises(InputError, match=r"need.json: format: expected"):
        NeedCertificateFile.read(tmp_path)


def test_a_folder_without_certificates_has_none(tmp_path: Path) -> None:
    assert NeedCertificateFile.read(tmp_path) is None
