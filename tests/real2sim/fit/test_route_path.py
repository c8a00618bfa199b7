"""A route as SUMO measures it, and straight on from its end."""

import numpy as np
import pytest
from testing.fit_crossing import FRAMES, crossing, matches_of, seconds, track
from testing.map_faults import lane, lanes_map
from testing.network_samples import built

from mdrive_sumo.roads import RoadMap
from real2sim.fit.route_path import build_route_path, compute_edge_length, compute_progress, find_straight_continuation


@pytest.fixture(scope="module")
def roads(tmp_path_factory: pytest.TempPathFactory) -> RoadMap:
    return crossing(tmp_path_factory.mktemp("crossing"))


@pytest.fixture(scope="module")
def fork(tmp_path_factory: pytest.TempPathFactory) -> RoadMap:
    """A road that goes straight on or bends to the left, and a ring beside it."""
    turn = np.radians(np.linspace(0.0, 90.0, 10))
    bend = np.column_stack((100 + 20 * np.sin(turn), 20 * (1 - np.cos(turn))))
    ring = np.radians(np.linspace(0.0, 180.0, 19))
    halves = [np.column_stack((300 + side * 20 * np.cos(ring), side * 20 * np.sin(ring))) for side in (1, -1)]
    return built(
        tmp_path_factory.mktemp("fork"),
        lanes_map(
            lane("in", [(0, 0), (100, 0)], ("a_bend", "straight")),
            lane("a_bend", bend, ("up",)),
            lane("up", [(120, 20), (120, 120)]),
            lane("straight", [(100, 0), (140, 0)], ("on",)),
            lane("on", [(140, 0), (240, 0)]),
            lane("north", halves[0], ("south",)),
            lane("south", halves[1], ("north",)),
        ),
    )[1]


def find_edges(roads: RoadMap, lanes: tuple[str, ...]) -> list[str]:
    return [roads.lanes[id_].edge for id_ in lanes if not roads.lanes[id_].junction]


def test_the_continuation_turns_least_and_is_long_enough(fork: RoadMap) -> None:
    assert find_edges(fork, find_straight_continuation(fork, "ein_0", 10.0)) == ["estraight"]
    assert find_edges(fork, find_straight_continuation(fork, "ein_0", 80.0)) == ["estraight", "eon"]
    assert find_edges(fork, find_straight_continuation(fork, "ein_0", 1e4)) == ["estraight", "eon"]
    assert find_straight_continuation(fork, "eon_0", 100.0) == ()
    assert find_straight_continuation(fork, "ein_0", 0.0) == ()


def test_a_continuation_on_a_ring_ends(fork: RoadMap) -> None:
    lanes = find_straight_continuation(fork, "enorth_0", 1e4)
    assert len(set(lanes)) == len(lanes) > 0
    assert not fork.lanes[lanes[-1]].junction


def test_edges_of_a_path_follow_each_other_without_gaps_but_joints(roads: RoadMap) -> None:
    first = next(one for one in roads.driving if one.edge == "ew0" and not one.left)
    lanes = (first.right, first.id, *find_straight_continuation(roads, first.id, 1e4))
    path = build_route_path(roads, lanes)
    begins = [stage.begin for stage in path.edges_in_order]
    ends = [stage.end for stage in path.edges_in_order]
    assert begins[0] == 0.0
    assert all(0.0 <= begin - end <= 0.1 for begin, end in zip(begins[1:], ends, strict=False))
    assert path.length == ends[-1] == pytest.approx(430.0, abs=2.0)
    assert len(path.edges_in_order[0].lanes) == 2  # a lane change stays on its edge
    assert path.edges == tuple(stage.edge for stage in path.edges_in_order if not stage.junction)


def test_all_lanes_of_an_edge_have_its_length(roads: RoadMap) -> None:
    for one in roads.driving:
        beside = [other for other in roads.driving if other.edge == one.edge]
        lengths = {compute_edge_length(roads, other) for other in beside}
        assert len(lengths) == 1
        shortest, longest = min(o.centre.length for o in beside), max(o.centre.length for o in beside)
        assert shortest - 1e-9 <= lengths.pop() <= longest + 1e-9


@pytest.mark.parametrize("hidden", [(), (40, 60), (0, 15), (90, FRAMES)])
def test_progress_is_what_was_driven_wherever_the_track_was_seen(hidden: tuple[int, ...], roads: RoadMap) -> None:
    """In between it is interpolated; before the first and after the last frame there is none."""
    x = 20.0 + 10.0 * seconds() + 0.3 * np.sin(seconds())
    full = track("a", x, 0.2)
    (match,) = matches_of([full], roads).values()
    path = build_route_path(roads, match.route)
    there = np.ones(FRAMES, dtype=np.bool_)
    if hidden:
        there[slice(*hidden)] = False
    seen = track("a", np.where(there, x, np.nan), 0.2)
    progress = compute_progress(path, seen, matches_of([seen], roads)["a"])
    first, last = seen.valid_frames[[0, -1]]
    assert np.isnan(progress[:first]).all()
    assert np.isnan(progress[last + 1 :]).all()
    assert progress[first : last + 1] == pytest.approx(x[first : last + 1], abs=0.6)
    assert (np.diff(progress[first : last + 1]) >= 0.0).all()
