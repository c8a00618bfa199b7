"""What the briefing tells of the junctions on a route: where they are and who gives way."""

from pathlib import Path

import numpy as np
import pytest
from testing.made_network import compile_tee, save_network

from mdrive_sumo.agent_process.wire_protocol import decode, encode
from mdrive_sumo.contract import JunctionControl
from mdrive_sumo.core.geometry import Polyline
from mdrive_sumo.roads import RoadMap, find_network_folder, load_road_map
from mdrive_sumo.scenario.suite import load_suite
from mdrive_sumo.sensing.briefing_builder import build_briefing
from mdrive_sumo.sensing.route_junctions import find_junctions
from mdrive_sumo.vehicle.dynamics import MKZ_2017, to_vehicle_facts
from mdrive_sumo.worlds.authoring.route_steps import build_route


def drive(network: str, steps: str) -> list[JunctionControl]:
    return junctions_of(load_road_map(find_network_folder(network)), steps)


def junctions_of(roads: RoadMap, steps: str) -> list[JunctionControl]:
    route = build_route(roads, steps)
    return list(find_junctions(route.lanes, roads, Polyline(route.xy)))


@pytest.mark.parametrize(
    ("kind", "minor", "major"),
    [
        ("priority", "yield", "priority-road"),
        ("priority_stop", "stop", "priority-road"),
        ("allway_stop", "all-way-stop", "all-way-stop"),
        ("right_before_left", "right-before-left", "right-before-left"),
        ("traffic_light", "traffic-light", "traffic-light"),
        ("unregulated", "uncontrolled", "uncontrolled"),
    ],
)
def test_each_approach_has_the_control_that_its_driver_sees(tmp_path: Path, kind: str, minor: str, major: str) -> None:
    roads = save_network(tmp_path / "tee", compile_tee(tmp_path / "plain", kind))
    for steps, expected in (
        ("s_in_0 -30 > w_out_0 20", minor),
        ("e_in_0 -30 > w_out_0 20", major),
        ("w_in_0 -30 > e_out_0 20", major),
        ("e_in_0 -30 > s_out_0 20", major),  # a left turn, which gives way to oncoming traffic
    ):
        (junction,) = junctions_of(roads, steps)
        assert junction.kind == expected, steps
        assert junction.entry_s == pytest.approx(30.0, abs=0.1)
        assert junction.entry_s < junction.exit_s < 60.0


def test_a_roundabout_is_one_junction_from_entry_to_exit() -> None:
    (ring,) = drive("roundabout", "west_in_0 -30 > east_out_0 20")
    assert ring.kind == "roundabout"
    assert ring.entry_s == pytest.approx(30.0, abs=0.1)
    length = ring.exit_s + 20.0
    roads = load_road_map(find_network_folder("roundabout"))
    whole = Polyline(build_route(roads, "west_in_0 -30 > east_out_0 20").xy).length
    assert whole == pytest.approx(length, abs=0.5)


def test_a_route_that_begins_or_ends_in_a_junction_has_its_part_of_it() -> None:
    (begun,) = drive("old_town", ":x_5_0 3 > west_out_1 20")
    assert (begun.kind, begun.entry_s) == ("right-before-left", 0.0)
    (unfinished,) = drive("old_town", "south_in_1 -20 > :x_5_0 9")
    assert unfinished.entry_s == pytest.approx(20.0, abs=0.1)
    assert unfinished.exit_s == pytest.approx(29.0, abs=0.1)


def test_where_lanes_only_join_or_part_there_is_nothing_to_tell() -> None:
    assert drive("lane_drop", "wide_0 20 > narrow_0 20") == []


def test_the_briefing_tells_them_to_agents_and_processes() -> None:
    scenario = next(one for one in load_suite("interdrive@0") if one.id.startswith("i19"))
    roads = load_road_map(find_network_folder(scenario.network))
    told = [build_briefing(ego, roads, to_vehicle_facts(MKZ_2017), 7, 30.0) for ego in scenario.egos]
    kinds = {junction.kind for briefing in told for junction in briefing.junctions}
    assert kinds == {"priority-road", "stop"}
    for briefing in told:
        assert [junction.kind == "stop" for junction in briefing.junctions] == [bool(briefing.stop_signs)]
        entries = np.array([junction.entry_s for junction in briefing.junctions])
        assert ((entries > 0.0) & (entries < briefing.route_s[-1])).all()
        assert decode(encode(briefing)).junctions == briefing.junctions
