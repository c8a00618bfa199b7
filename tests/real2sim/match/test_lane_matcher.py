"""Tracks on lanes: manoeuvres on drawn roads, noise, and what stands off the road."""

import itertools
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from testing.map_faults import drive, lane, lanes_map
from testing.sampling import sampled

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.roads import RoadMap, build_lane_route, list_packaged_networks, load_road_map
from real2sim.hd_map import HdMap
from real2sim.match.lane_matcher import KEY_FRAME_M, LaneMatch, _select_key_frames, match_track
from real2sim.network import build_network

EAST = np.column_stack((np.arange(0.0, 201.0, 5.0), np.zeros(41)))


def moved(line: Float, x: float, y: float) -> Float:
    return line + np.array((x, y))


def arc(x: float, y: float, radius: float, begin: float, end: float) -> Float:
    """Points on a circle between two angles [deg]."""
    angle = np.radians(np.linspace(begin, end, 12))
    return np.column_stack((x + radius * np.cos(angle), y + radius * np.sin(angle)))


def roads_of(folder: Path, hd_map: HdMap) -> RoadMap:
    build_network(hd_map, [], folder / "net", "test")
    return load_road_map(folder / "net")


def drivable(roads: RoadMap, route: tuple[str, ...]) -> bool:
    return all(
        b in (*roads.lanes[a].successors, roads.lanes[a].left, roads.lanes[a].right)
        for a, b in itertools.pairwise(route)
    )


def checked(track: Float, roads: RoadMap, worst_offset: float = 0.2) -> LaneMatch:
    """The match of a track that must be matched throughout."""
    found = match_track(track, roads)
    assert (found.reason, found.is_off_road, found.break_frames) == ("", False, ())
    assert drivable(roads, found.route)
    assert set(found.lanes) <= set(found.route)
    assert np.abs(found.offset).max() <= worst_offset
    return found


# --- manoeuvres ---------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Town:
    roads: RoadMap
    tracks: dict[str, Float]


@pytest.fixture(scope="module")
def roundabout(tmp_path_factory: pytest.TempPathFactory) -> Town:
    """A ring in four quarters, an entry from the west, an exit to the east."""
    ring = {k: arc(0.0, 0.0, 20.0, 180.0 + 90 * k, 270.0 + 90 * k) for k in range(4)}
    quarters = [lane(f"q{k}", ring[k], (f"q{(k + 1) % 4}",)) for k in range(4)]
    entry = np.array([(-60.0, 20.0), (-40.0, 18.0), (-26.0, 12.0), (-21.0, 5.0), (-20.0, 0.0)])
    exit_ = np.array([(20.0, 0.0), (21.0, 5.0), (26.0, 12.0), (40.0, 18.0), (60.0, 20.0)])
    hd_map = lanes_map(*quarters, lane("in", entry, ("q0",)), lane("out", exit_))
    half = np.concatenate((entry, ring[0][1:], ring[1][1:], exit_[1:]))
    turn = np.concatenate((entry, *(ring[k % 4][1:] for k in range(6)), exit_[1:]))
    return Town(roads_of(tmp_path_factory.mktemp("ring"), hd_map), {"half": drive(half), "twice": drive(turn)})


@pytest.mark.parametrize(("name", "quarters"), [("half", 2), ("twice", 6)])
def test_a_roundabout_is_driven_quarter_by_quarter(name: str, quarters: int, roundabout: Town) -> None:
    found = checked(roundabout.tracks[name], roundabout.roads)
    edges = [roundabout.roads.lanes[id_].edge for id_ in found.route if not roundabout.roads.lanes[id_].junction]
    assert edges == ["ein", *(f"eq{k % 4}" for k in range(quarters)), "eout"]


def ways_without_lane_change(roads: RoadMap, start: str) -> dict[str, tuple[str, ...]]:
    """Chains of successors from a lane to all lanes outside junctions."""
    found: dict[str, tuple[str, ...]] = {}
    open_: list[tuple[str, ...]] = [(start,)]
    while open_:
        path = open_.pop()
        for there in roads.lanes[path[-1]].successors:
            if there not in path:
                open_.append((*path, there))
        if len(path) > 1 and not roads.lanes[path[-1]].junction:
            found[path[-1]] = path
    return found


LEAST_M = 11.0
"""Of the first and last lane: 5 m at their outer ends are not driven."""
SINGLE_ROADS = {"avenue", "country_road", "crescent", "village_street"}


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", sampled(sorted({*list_packaged_networks()} - SINGLE_ROADS), ("roundabout", "old_town", "lane_drop"))
)
def test_every_way_through_the_packaged_networks_is_found_in_noise(name: str) -> None:
    roads = load_road_map(list_packaged_networks()[name])
    rng = np.random.default_rng(0)
    starts = [one.id for one in roads.driving if not one.junction and one.successors and one.centre.length > LEAST_M]
    driven = 0
    for start, goal in itertools.permutations([*starts, *(one.id for one in roads.driving if not one.successors)], 2):
        path = ways_without_lane_change(roads, start).get(goal)
        if path is None or roads.lanes[goal].centre.length < LEAST_M:
            continue
        dense = build_lane_route(roads, path, 5.0, roads.lanes[goal].centre.length - 5.0)
        track = drive(dense.xy)
        track[:, :2] += rng.normal(0.0, 0.15, (len(track), 2))
        found = match_track(track, roads)
        assert (found.route, found.reason) == (path, "")
        driven += 1
    assert driven >= 3


@pytest.mark.slow
def test_lane_changes_are_seen_where_they_happen(tmp_path: Path) -> None:
    roads = roads_of(tmp_path, lanes_map(*(lane(f"l{k}", moved(EAST, 0.0, 3.5 * k)) for k in range(3))))
    s = np.linspace(0.0, 200.0, 201)
    y = 3.5 / (1 + np.exp(-(s - 60) / 4)) + 3.5 / (1 + np.exp(-(s - 140) / 4))
    found = checked(drive(np.column_stack((s, y))), roads, worst_offset=1.8)
    assert found.route == ("el0_0", "el0_1", "el0_2")
    changes = [k for k in range(1, len(found.lanes)) if found.lanes[k] != found.lanes[k - 1]]
    assert [float(found.s[k]) for k in changes] == pytest.approx([60.0, 140.0], abs=2.0)


def test_drifting_within_a_lane_is_no_lane_change(tmp_path: Path) -> None:
    roads = roads_of(tmp_path, lanes_map(lane("l0", EAST), lane("l1", moved(EAST, 0.0, 3.5))))
    s = np.linspace(0.0, 200.0, 201)
    found = checked(drive(np.column_stack((s, 1.9 * np.exp(-(((s - 100) / 12) ** 2))))), roads, worst_offset=2.0)
    assert found.route == ("el0_0",)


def test_a_merge_is_followed_from_the_ramp(tmp_path: Path) -> None:
    ramp = np.column_stack((np.linspace(0.0, 100.0, 30), -15.0 * (1 - np.linspace(0.0, 1.0, 30)) ** 2))
    hd_map = lanes_map(
        lane("main", EAST[:21], ("on",)), lane("ramp", ramp, ("on",)), lane("on", moved(EAST[:21], 100.0, 0.0))
    )
    roads = roads_of(tmp_path, hd_map)
    found = checked(drive(np.concatenate((ramp, moved(EAST[:21], 100.0, 0.0)))[np.r_[:30, 31:51]]), roads)
    edges = [roads.lanes[id_].edge for id_ in found.route if not roads.lanes[id_].junction]
    assert edges == ["eramp", "eon"]


@pytest.mark.slow
@pytest.mark.parametrize(("goal", "end"), [("left", 15.0), ("right", -15.0)])
def test_at_a_fork_the_whole_track_decides(goal: str, end: float, tmp_path: Path) -> None:
    """Both ways begin alike; the nearest lane alone could not tell them apart."""
    ways = {
        name: np.column_stack((EAST[:21, 0] + 100.0, y * np.linspace(0.0, 1.0, 21) ** 3))
        for name, y in (("left", 15.0), ("right", -15.0))
    }
    roads = roads_of(
        tmp_path, lanes_map(lane("in", EAST[:21], ("left", "right")), *(lane(k, v) for k, v in ways.items()))
    )
    line = np.concatenate((EAST[:20], ways[goal]))
    track = drive(line)
    track[:, 1] += 0.3 * np.sin(np.arange(len(track)))
    found = match_track(track, roads)
    assert found.lanes[-1] == f"e{goal}_0"
    assert {id_ for id_ in found.lanes if not roads.lanes[id_].junction} == {"ein_0", f"e{goal}_0"}


def test_gaps_are_bridged_and_unseen_frames_have_no_lane(roundabout: Town) -> None:
    track = roundabout.tracks["half"].copy()
    track[40:60] = np.nan
    found = match_track(track, roundabout.roads)
    assert found.reason == ""
    assert found.route == match_track(roundabout.tracks["half"], roundabout.roads).route
    assert found.lanes[39] and found.lanes[60] and not any(found.lanes[40:60])
    assert np.isnan(found.s[40:60]).all()


@pytest.mark.slow
def test_the_offset_is_signed(tmp_path: Path) -> None:
    roads = roads_of(tmp_path, lanes_map(lane("a", EAST)))
    assert match_track(drive(moved(EAST, 0.0, 0.7)), roads).offset == pytest.approx(0.7)
    assert match_track(drive(moved(EAST, 0.0, -0.7)), roads).offset == pytest.approx(-0.7)


# --- off the road, standing, and without a way --------------------------------------------------------------------


def standing(x: float, y: float, yaw: float = 0.0) -> Float:
    wobble = np.random.default_rng(0).normal(0.0, 0.05, (50, 2))
    return np.column_stack((np.array((x, y)) + wobble, np.full(50, yaw)))


@pytest.fixture(scope="module")
def street(tmp_path_factory: pytest.TempPathFactory) -> RoadMap:
    return roads_of(
        tmp_path_factory.mktemp("street"), lanes_map(lane("east", EAST), lane("west", (moved(EAST, 0.0, 3.5))[::-1]))
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("track", "reason"),
    [
        pytest.param(standing(50.0, -2.2), "parked beside the road, 2.2 m from the nearest centre line", id="kerb"),
        pytest.param(standing(50.0, -30.0), "parked off the road: 100% of frames over 4 m from any lane", id="far"),
        pytest.param(
            drive(moved(EAST, 0.0, -30.0)), "drives off the road: 100% of frames over 4 m from any lane", id="field"
        ),
        pytest.param(
            standing(50.0, 1.0, np.pi / 2),
            "parked across or against the lanes: in 100% of frames none within 4 m runs its way",
            id="across",
        ),
        pytest.param(np.full((5, 3), np.nan), "never seen", id="unseen"),
    ],
)
def test_what_is_off_the_road_stays_there(track: Float, reason: str, street: RoadMap) -> None:
    found = match_track(track, street)
    assert (found.is_off_road, found.reason, found.route) == (True, reason, ())
    assert set(found.lanes) == {""}
    assert np.isnan(found.offset).all()


def test_a_queue_stands_in_its_lane(street: RoadMap) -> None:
    assert checked(standing(50.0, 0.4), street, worst_offset=0.6).route == ("eeast_0",)
    assert checked(standing(50.0, 3.5, np.pi), street).route == ("ewest_0",)


def test_a_wrong_way_driver_is_not_on_the_lane(street: RoadMap) -> None:
    assert match_track(drive(EAST[::-1] - (0.0, 1.0)), street).lanes[50] in ("", "ewest_0")


def test_one_frame_is_enough(street: RoadMap) -> None:
    assert match_track(np.array([[50.0, 0.1, 0.0]]), street).lanes == ("eeast_0",)


def test_out_of_a_driveway_the_route_begins_on_the_road(street: RoadMap) -> None:
    turn = np.concatenate(([(60.0, -25.0)], arc(68.0, -8.0, 8.0, 180.0, 90.0), EAST[15:]))
    found = match_track(drive(turn), street)
    assert (found.is_off_road, found.reason, found.route) == (False, "", ("eeast_0",))
    assert found.lanes[0] == ""


def test_where_no_way_leads_on_the_match_says_so(tmp_path: Path) -> None:
    roads = roads_of(tmp_path, lanes_map(lane("a", EAST), lane("b", moved(EAST, 250.0, 0.0))))
    found = match_track(drive(np.concatenate((EAST, moved(EAST, 250.0, 0.0)))), roads)
    assert found.reason == "no way from lane ea_0 to lane eb_0"
    assert not found.is_off_road
    assert len(found.break_frames) == 1
    assert found.lanes[found.break_frames[0]] == "eb_0"
    assert found.route in (("ea_0",), ("eb_0",))


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_vehicle_at_a_slant_is_in_the_lane_and_one_across_is_not(side: float, street: RoadMap) -> None:
    """A stopped vehicle of a tight turn stands at up to 75 degrees to its lane; at more it crosses the lane."""
    for slant_deg in (45.0, 61.0, 74.0):
        assert checked(standing(50.0, 0.3, side * np.radians(slant_deg)), street, 0.6).route == ("eeast_0",)
    for slant_deg in (76.0, 90.0, 104.0):
        found = match_track(standing(50.0, 0.3, side * np.radians(slant_deg)), street)
        assert found.reason.startswith("parked across or against the lanes")


@pytest.mark.parametrize(
    ("speed", "lane_of_motion"),
    [pytest.param(2.6, True, id="driving"), pytest.param(2.4, False, id="creeping")],
)
def test_the_box_tells_the_direction_of_what_creeps_and_the_motion_of_what_drives(
    speed: float, lane_of_motion: bool, street: RoadMap
) -> None:
    """A vehicle that manoeuvres backwards stays in its lane. The yaw of one that drives is wrong: trackers turn boxes.

    Between frames of 0.1 s it drives from 0.25 m on.
    """
    track = drive(moved(EAST[5:10], 0.0, 1.7), speed)  # between the eastbound and the westbound lane
    track[:, 2] = np.pi  # the box looks west
    track[[0, -1], 2] = np.nan  # the ends have one neighbour each, so half the motion
    lanes = set(match_track(track, street).lanes)
    assert lanes == ({"eeast_0"} if lane_of_motion else {"ewest_0"})


@pytest.mark.parametrize("step_m", [0.09, 0.3, 0.45])
def test_key_frames_are_evenly_spaced_along_the_track(step_m: float) -> None:
    """Wherever it ends: from half to one and a half of their distance apart, and a step between frames."""
    for frames, first in itertools.product(range(2, 80), (0, 1)):
        x = step_m * np.arange(frames)
        keys = _select_key_frames(np.column_stack((x, 0 * x)), np.arange(first, frames))
        assert (keys[0], keys[-1]) == (first, frames - 1)
        gaps = np.diff(x[keys])
        assert (gaps <= 1.5 * KEY_FRAME_M + step_m).all()
        assert len(gaps) <= 1 or (gaps >= 0.5 * KEY_FRAME_M).all()
