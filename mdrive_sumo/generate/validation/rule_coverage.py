"""Which rules of the protocol the scenarios of a suite can break: found on scenario and network, without driving.

A rule that no scenario exercises costs no agent anything, whatever it does.
"""

from collections.abc import Callable, Mapping
from itertools import pairwise
from types import MappingProxyType

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from mdrive_sumo.core.state import Kind
from mdrive_sumo.roads import RoadMap, find_network_folder, load_road_map
from mdrive_sumo.roads.network_file import StopSignBox
from mdrive_sumo.scenario.scenario import Ego, Scenario
from mdrive_sumo.scenario.scripted_actor import KIND_BY_NAME, Actor, PathMotion, ReplayMotion
from mdrive_sumo.scenario.start_boxes import CAR, build_box, compute_first_pose
from mdrive_sumo.scenario.suite import Suite
from mdrive_sumo.scoring.metrics.stop_signs import CHECKED_AHEAD_M

ROAMING_M = 30.0
"""How far [m] a CAV gets from its route before it is ended for deviation (protocol 7.4)."""
RuleCheck = Callable[[Scenario, RoadMap], bool]


def find_exercised_rules(scenario: Scenario, roads: RoadMap) -> frozenset[str]:
    """Return the kinds of infractions that a CAV of the scenario can commit by driving badly."""
    return frozenset(rule for rule, can_fire in RULES.items() if can_fire(scenario, roads))


def count_rules(suite: Suite) -> Mapping[str, int]:
    """Return for every rule the number of scenarios of a suite that exercise it. Raises InputError."""
    counts = dict.fromkeys(RULES, 0)
    for scenario in suite:
        roads = load_road_map(find_network_folder(scenario.network, suite.find_folder(scenario.id)))
        for rule in find_exercised_rules(scenario, roads):
            counts[rule] += 1
    return counts


def describe_rules(suite: Suite) -> tuple[str, ...]:
    """Return sentences: how many scenarios exercise each rule, and which rules none exercises. Raises InputError."""
    counts = count_rules(suite)
    exercised = ", ".join(f"{rule} {count}" for rule, count in counts.items() if count)
    missing = ", ".join(rule for rule, count in counts.items() if not count)
    told = f"{suite.name}: scenarios that exercise a rule: {exercised}"
    return (told, f"{suite.name}: no scenario exercises {missing}") if missing else (told,)


def find_missing_rules(suite: Suite) -> tuple[str, ...]:
    """Return the rules that no scenario of a suite exercises; looks no further than needed. Raises InputError."""
    missing = set(RULES)
    for scenario in suite:
        if missing:
            roads = load_road_map(find_network_folder(scenario.network, suite.find_folder(scenario.id)))
            missing -= {rule for rule in missing if RULES[rule](scenario, roads)}
    return tuple(rule for rule in RULES if rule in missing)


def _can_hit_vehicle(scenario: Scenario, _roads: RoadMap) -> bool:
    rolling = any(_hits(actor, Kind.VEHICLE, Kind.CYCLIST) for actor in scenario.actors)
    return len(scenario.egos) > 1 or rolling or bool(scenario.background.vehicles)


def _can_hit_pedestrian(scenario: Scenario, roads: RoadMap) -> bool:
    ways = _sweep_routes(scenario)
    return any(_hits(actor, Kind.PEDESTRIAN) and ways.intersects(_sweep(actor, roads)) for actor in scenario.actors)


def _can_hit_static(scenario: Scenario, roads: RoadMap) -> bool:
    """Return whether a prop or a building is within reach of a CAV that leaves its route."""
    reach = _sweep_routes(scenario, ROAMING_M)
    props = (_sweep(actor, roads) for actor in scenario.actors if _hits(actor, Kind.STATIC))
    return any(reach.intersects(shape) for shape in (*props, *roads.building_shapes))


def _can_miss_stop_sign(scenario: Scenario, roads: RoadMap) -> bool:
    signs = {sign.lane: sign for sign in roads.stop_signs or ()}
    return any(
        lane in signs and not _rests_at_line(ego, signs[lane], roads)
        for ego in scenario.egos
        for lane in ego.lanes[:-1]
    )


def _rests_at_line(ego: Ego, sign: StopSignBox, roads: RoadMap) -> bool:
    """Return whether a CAV starts beyond the line, or at rest so near that this counts as its stop (protocol 7.7)."""
    if sign.lane != ego.lanes[0]:
        return False
    before_m = sign.line_pos_m - roads.lanes[sign.lane].centre.project(ego.start.x, ego.start.y)[0]
    return before_m <= 0.0 or (ego.start_speed == 0.0 and before_m - sign.length_m <= CHECKED_AHEAD_M)


def _can_run_red_light(scenario: Scenario, roads: RoadMap) -> bool:
    return scenario.signals == "program" and any(
        following in roads.lanes[lane].lights for ego in scenario.egos for lane, following in pairwise(ego.lanes)
    )


def _can_leave_road(_scenario: Scenario, _roads: RoadMap) -> bool:
    """Return whether a CAV can leave its lanes and its route: always, since nothing holds it there."""
    return True


RULES: Mapping[str, RuleCheck] = MappingProxyType(
    {
        "collision-vehicle": _can_hit_vehicle,
        "collision-pedestrian": _can_hit_pedestrian,
        "collision-static": _can_hit_static,
        "red-light": _can_run_red_light,
        "stop-sign": _can_miss_stop_sign,
        "outside-lanes": _can_leave_road,
        "route-deviation": _can_leave_road,
    }
)
"""Rule (kind of infraction, protocol 7.1) -> whether a scenario exercises it."""


def _hits(actor: Actor, *kinds: Kind) -> bool:
    return KIND_BY_NAME[actor.kind] in kinds


def _sweep_routes(scenario: Scenario, beside_m: float = CAR.width / 2) -> BaseGeometry:
    """Return the area within `beside_m` [m] of a route: by default what CAVs cover that keep to them."""
    return shapely.MultiLineString([ego.xy for ego in scenario.egos]).buffer(beside_m)


def _sweep(actor: Actor, roads: RoadMap) -> BaseGeometry:
    """Return the area that an actor covers on its way; of an actor that follows lanes, its start."""
    box = build_box(compute_first_pose(actor, roads), actor.length, actor.width)
    match actor.motion:
        case PathMotion(points=points):
            way = np.array(points)
        case ReplayMotion(poses=poses):
            way = np.array([(x, y) for _, x, y, _ in poses])
        case _:
            return box
    return box.union(shapely.LineString(way).buffer(actor.width / 2))
