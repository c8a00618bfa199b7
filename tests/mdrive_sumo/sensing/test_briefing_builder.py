"""The briefing: what an agent is told of its route."""

import numpy as np
import pytest

from mdrive_sumo.contract import Briefing, Observation, Reply, SensorSpec
from mdrive_sumo.core.errors import WorldError
from mdrive_sumo.loop.agent_driver import LocalDriver
from mdrive_sumo.roads import find_network_folder, load_road_map
from mdrive_sumo.scenario.suite import load_suite
from mdrive_sumo.sensing import briefing_builder
from mdrive_sumo.sensing.briefing_builder import build_briefing, compute_route_room
from mdrive_sumo.vehicle.dynamics import MKZ_2017, to_vehicle_facts

SUITE = load_suite("interdrive@0")


def brief(scenario: str, ego: int) -> Briefing:
    found = next(s for s in SUITE.scenarios if s.id.startswith(scenario))
    return build_briefing(
        found.egos[ego], load_road_map(find_network_folder(found.network)), to_vehicle_facts(MKZ_2017), 7, 30.0
    )


def test_the_briefing_has_lane_width_speed_limit_and_arc_length_of_the_route() -> None:
    told = brief("i03", 0)
    assert told.route_xy.shape == (len(told.route_s), 2)
    assert told.route_s[-1] == pytest.approx(np.hypot(*np.diff(told.route_xy, axis=0).T).sum())
    assert ((told.route_lane_width > 2.5) & (told.route_lane_width < 4.0)).all()
    assert told.route_speed_limit[0] == 13.89
    assert (told.route_speed_limit > 3.0).all()
    assert (told.seed, told.time_limit_s, told.vehicle.length) == (7, 30.0, 4.9)


def test_lights_and_stop_signs_lie_on_the_route_that_they_control() -> None:
    lit = brief("i03", 0)
    assert len(lit.traffic_lights) == 1
    assert 0.0 < lit.traffic_lights[0].s < lit.route_s[-1]
    assert lit.stop_signs == ()
    told = [brief("i19", ego) for ego in (0, 1)]
    assert all(light == () for light in (one.traffic_lights for one in told))
    signs = [one.stop_signs for one in told]
    assert sum(map(len, signs)) >= 1
    assert all(0.0 < sign.s < one.route_s[-1] for one in told for sign in one.stop_signs)
    assert () in signs  # the main road has none


def test_the_free_width_is_measured_once_and_only_if_it_is_read(monkeypatch: pytest.MonkeyPatch) -> None:
    measured: list[int] = []
    monkeypatch.setattr(briefing_builder, "compute_route_room", lambda *_: measured.append(1) or np.ones((2, 2)))
    told = brief("i03", 0)
    assert (told.route_s[0], measured) == (0.0, [])
    assert told.route_room is told.route_room
    assert measured == [1]


class Measures:
    """An agent that reads the free width."""

    label = "single"

    def sensors(self) -> tuple[SensorSpec, ...]:
        return ()

    def start(self, briefing: Briefing) -> None:
        _ = briefing.route_room

    def act(self, seen: Observation) -> Reply:
        raise NotImplementedError


def test_a_failure_to_measure_is_none_of_the_agent_that_reads_it(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise ValueError("no surface")

    monkeypatch.setattr(briefing_builder, "compute_route_room", fail)
    with pytest.raises(WorldError, match="free width of a route: ValueError: no surface"):
        LocalDriver(Measures()).start(brief("i03", 0))


def test_an_agent_that_writes_into_its_briefing_changes_no_other() -> None:
    roads = load_road_map(find_network_folder("avenue"))
    lane = roads.driving[0].centre
    room = compute_route_room(roads, lane.xy, lane.yaws_at(lane.s))
    before = room.copy()
    room[:] = -1.0
    assert np.array_equal(compute_route_room(roads, lane.xy, lane.yaws_at(lane.s)), before)
