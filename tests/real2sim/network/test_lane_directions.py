"""Directions of lanes: votes by motion, repaired links, side of traffic."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from testing.map_faults import all_links, as_map, drive, lane, lanes_map, plant
from testing.network_samples import EAST, built, moved, on_lane, undirected

from mdrive_sumo.core.geometry import Float, Polyline
from mdrive_sumo.roads import list_packaged_networks, load_road_map
from real2sim.hd_map import HdMap
from real2sim.network.lane_directions import reverse_lane, vote_directions
from real2sim.network.lane_links import rebuild_links
from real2sim.network.lane_segment import LaneSegment


# --- direction ----------------------------------------------------------------------------------------------------
def test_observed_motion_turns_a_lane_round(tmp_path: Path) -> None:
    west = drive(EAST[::-1])
    report, roads = built(tmp_path, lanes_map(lane("a", EAST, directed=False)), west)
    assert report.directions.inverted == ("a",)
    assert report.directions.undecided == ()
    assert roads.lanes["ea_0"].centre.yaw_at(50.0) == pytest.approx(np.pi)


@pytest.mark.parametrize(
    "motion",
    [
        pytest.param(drive(EAST[::-1])[:9], id="too few samples"),
        pytest.param(np.concatenate((drive(EAST[::-1])[:60], drive(EAST)[:40])), id="no agreement"),
        pytest.param(drive(EAST[::-1], speed=1.0), id="steps too short"),
        pytest.param(drive(moved(EAST[::-1], y=3.5)), id="too far away"),
        pytest.param(drive(np.array([(50.0, -60.0), (50.0, 60.0)])), id="across"),
    ],
)
def test_weak_evidence_decides_nothing_and_is_reported(motion: Float) -> None:
    found = vote_directions({"a": lane("a", EAST, directed=False)}, [motion])
    assert (found.inverted, found.undecided) == ((), ("a",))


def test_a_wrong_way_driver_does_not_turn_a_directed_lane() -> None:
    lanes = {"a": lane("a", EAST, ("b",)), "b": lane("b", moved(EAST, x=100.0))}
    assert vote_directions(lanes, [drive(moved(EAST, x=100.0)[::-1]), drive(EAST[::-1])]).inverted == ()


def test_a_turned_lane_has_its_sides_changed_over() -> None:
    one = reverse_lane(lane("a", EAST, left=moved(EAST, y=2.0), right=moved(EAST, y=-2.0), left_neighbour="b"))
    assert one.centre[0] == pytest.approx((100.0, 0.0))
    assert one.left[0] == pytest.approx((100.0, -2.0))
    assert (one.left_neighbour, one.right_neighbour) == ("", "b")


def test_an_undecided_lane_takes_the_direction_of_its_neighbour() -> None:
    lanes = {
        "seen": lane("seen", EAST, directed=False, group="road"),
        "beside": lane("beside", moved(EAST, y=3.5), directed=False, group="road"),
        "elsewhere": lane("elsewhere", moved(EAST, y=90.0), directed=False, group="other"),
    }
    found = vote_directions(lanes, [drive(EAST[::-1])])
    assert found.inverted == ("seen", "beside")
    assert found.undecided == ("elsewhere",)


# --- planted faults -----------------------------------------------------------------------------------------------
def repair(hd_map: HdMap) -> tuple[set[str], set[tuple[str, str]]]:
    """Lanes that were turned round and links that were added, without compiling."""
    inverted = set(vote_directions(hd_map.lanes, []).inverted)
    lanes = {id_: reverse_lane(one) if id_ in inverted else one for id_, one in hd_map.lanes.items()}
    strips = {
        id_: LaneSegment(id_, id_, Polyline(one.centre), 3.5, 13.9, one.kind, one.junction)
        for id_, one in lanes.items()
    }
    return inverted, set(rebuild_links(strips, all_links(lanes)).added)


@pytest.mark.slow
@pytest.mark.parametrize("share", [pytest.param(0.1, marks=pytest.mark.full), 0.25])
def test_reversed_lanes_and_missing_links_are_repaired(share: float) -> None:
    rng = np.random.default_rng(4)
    planted = repaired = wrong = 0
    for folder in list_packaged_networks().values():
        clean = undirected(as_map(load_road_map(folder)))
        for _ in range(4):
            faulty = plant(clean, rng, share, share)
            inverted, added = repair(faulty.map)
            planted += len(faulty.reversed) + len(faulty.removed)
            repaired += len(inverted & faulty.reversed) + len(added & faulty.removed)
            wrong += len(inverted - faulty.reversed) + len(added - all_links(clean.lanes))
    assert planted > 150
    assert repaired >= 0.98 * planted
    assert wrong <= 0.01 * planted


# --- side of the traffic ------------------------------------------------------------------------------------------
@pytest.mark.slow
@pytest.mark.parametrize(("y", "left_hand"), [(3.5, False), (-3.5, True)])
def test_the_side_of_the_traffic_is_where_the_oncoming_lane_is_not(y: float, left_hand: bool, tmp_path: Path) -> None:
    lanes = lanes_map(
        lane("east", EAST, directed=False),
        lane("beside", moved(EAST, y=-y), directed=False),
        lane("west", moved(EAST, y=y), directed=False),
    )
    motions = [drive(EAST), drive(moved(EAST, y=-y)), drive(moved(EAST, y=y)[::-1])]
    report, roads = built(tmp_path, lanes, *motions)
    assert report.left_hand is left_hand
    assert report.directions.inverted == ("west",)
    kerb = roads.lanes[on_lane(roads, 50.0, -y)]  # SUMO counts lanes from the kerb
    assert (kerb.index, roads.lanes[on_lane(roads, 50.0, 0.0)].index) == (0, 1)
    assert report.deviation.max < 0.01


@pytest.mark.slow
def test_what_the_map_says_about_the_side_of_the_traffic_counts(tmp_path: Path) -> None:
    report, _ = built(tmp_path, replace(lanes_map(lane("a", EAST)), left_hand=True))
    assert report.left_hand
