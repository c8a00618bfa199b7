"""Rows of parked vehicles and the places that stay free."""

import pytest

from mdrive_sumo.roads import RoadMap, find_lane_path, find_network_folder, load_road_map
from mdrive_sumo.scenario.scripted_actor import Actor
from mdrive_sumo.scenario.start_boxes import build_user_box
from mdrive_sumo.worlds.placement.bodies import BODY_SIZES
from mdrive_sumo.worlds.placement.lane_chains import Lanes, find_station
from mdrive_sumo.worlds.placement.parked_vehicles import (
    WALK_GAP_M,
    FreePlace,
    ParkedRow,
    build_kerbside,
    build_parked_row,
)


def load_chain() -> tuple[RoadMap, Lanes]:
    roads = load_road_map(find_network_folder("hard_corridor_market"))
    return roads, find_lane_path(roads, "east_0_2", "east_5_2")


def span(roads: RoadMap, lanes: Lanes, one: Actor) -> tuple[float, float]:
    middle = find_station(roads, lanes, one.start.x, one.start.y)
    return middle - one.length / 2, middle + one.length / 2


@pytest.mark.parametrize(("occupied", "least", "most"), [(1.0, 13, 30), (0.5, 4, 20), (0.0, 0, 0)])
def test_a_row_lies_between_its_ends_and_its_vehicles_do_not_touch(occupied: float, least: int, most: int) -> None:
    roads, lanes = load_chain()
    row = build_parked_row(roads, ParkedRow(lanes, (30.0, 130.0), -2.8, 0.3, occupied), "seed", "r")
    assert least <= len(row) <= most
    spans = [span(roads, lanes, one) for one in row]
    assert all(begin >= 29.9 and end <= 130.1 for begin, end in spans)
    boxes = [build_user_box(one) for one in row]
    assert all(one.distance(other) > 0.5 for k, one in enumerate(boxes) for other in boxes[:k])
    assert all(not one.mirrored for one in row)  # traffic passes them


def test_a_free_place_stays_free_and_a_bus_hides_it() -> None:
    roads, lanes = load_chain()
    place = FreePlace(80.0, 92.0, "bus")
    crossed = FreePlace(110.0, 116.0, "")
    row = ParkedRow(lanes, (20.0, 140.0), -2.8)
    parked = build_kerbside(roads, [row], [place, crossed], "seed", "row")
    hiding = [one for one in parked if "hides" in one.id]
    assert [one.length for one in hiding] == [BODY_SIZES["bus"][0]]
    assert span(roads, lanes, hiding[0])[1] == pytest.approx(80.0 - WALK_GAP_M, abs=0.05)
    for begin, end in (span(roads, lanes, one) for one in parked):
        assert end <= 80.0 or begin >= 92.0 - 0.05
        assert end <= 110.05 or begin >= 116.0 - 0.05
    assert len(parked) > 5
