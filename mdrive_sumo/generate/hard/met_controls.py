"""Which routes of a scenario meet traffic control: a priority, yield or stop sign, or lights that run."""

from mdrive_sumo.contract.briefing import JunctionKind
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import Ego, Scenario

SIGNED: tuple[JunctionKind, ...] = ("priority-road", "yield", "stop", "all-way-stop", "roundabout")
"""Junctions whose signs say who gives way; `right-before-left` and `zipper` have none."""


def count_met_controls(scenario: Scenario, roads: RoadMap) -> int:
    """Return how many CAVs meet a sign or a light at a junction that their route enters."""
    return sum(meets_control(ego, scenario, roads) for ego in scenario.egos)


def meets_control(ego: Ego, scenario: Scenario, roads: RoadMap) -> bool:
    """Return whether a CAV meets a sign or a light at a junction that its route enters."""
    controls = {roads.junction_controls.get(lane) for lane in ego.lanes[1:]}
    return bool(controls & set(SIGNED)) or (scenario.signals == "program" and "traffic-light" in controls)
