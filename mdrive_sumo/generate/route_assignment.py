"""Assigns a lane-level route to every CAV of a proposal such that all relations hold (constraint satisfaction by
backtracking)."""

import math
import random
from collections.abc import Callable, Iterator, Mapping, Sequence

from mdrive_sumo.core.geometry import wrap_angle
from mdrive_sumo.generate.proposal import EgoVehicle, Proposal
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.worlds.lane_routes import LaneRoute, are_opposite, find_lane_change_routes, find_lane_routes
from mdrive_sumo.worlds.placement.spawn_points import LaneRoutes

PERPENDICULAR_RAD = math.radians(40)
"""[rad] Largest deviation of a crossing road from a right angle."""
MOST_TRIES = 20000


def assign_routes(proposal: Proposal, roads: RoadMap, rng: random.Random) -> dict[str, LaneRoute] | None:
    """Return routes by vehicle id that satisfy all constraints, a random solution; None if the network has none."""
    domains = {ego.vehicle_id: _build_domain(ego, roads) for ego in proposal.ego_vehicles}
    for ways in domains.values():
        rng.shuffle(ways)
    tries = iter(range(MOST_TRIES))
    return next(_search(proposal, domains, {}, tries), None)


def _search(
    proposal: Proposal, domains: Mapping[str, Sequence[LaneRoute]], chosen: dict[str, LaneRoute], tries: Iterator[int]
) -> Iterator[dict[str, LaneRoute]]:
    open_ = [name for name in domains if name not in chosen]
    if not open_:
        yield dict(chosen)
        return
    name = open_[0]
    for way in domains[name]:
        if next(tries, None) is None:
            return
        chosen[name] = way
        if _consistent(proposal, chosen, name):
            yield from _search(proposal, domains, chosen, tries)
        del chosen[name]


def _consistent(proposal: Proposal, chosen: LaneRoutes, last: str) -> bool:
    return all(
        RELATIONS[constraint.type](chosen[constraint.a], chosen[constraint.b])
        for constraint in proposal.vehicle_constraints
        if last in (constraint.a, constraint.b) and constraint.a in chosen and constraint.b in chosen
    )


def _build_domain(ego: EgoVehicle, roads: RoadMap) -> list[LaneRoute]:
    """Return the routes that match the proposal of one vehicle, independent of the others."""
    plain, changing = find_lane_routes(roads), find_lane_change_routes(roads)
    sides = _find_side_entries((*plain, *changing))
    ramps = {way.entry for way in changing} - {way.entry for way in plain}
    pool = changing if ego.maneuver == "lane_change" else (*plain, *(way for way in changing if way.entry in ramps))
    return [way for way in pool if _matches_maneuver(ego, way) and _matches_entry(ego, way, sides)]


def _matches_maneuver(ego: EgoVehicle, way: LaneRoute) -> bool:
    if ego.maneuver == "lane_change":
        late = ego.lane_change_phase == "after_intersection"
        return ego.lane_change_phase == "unknown" or way.changes_late == late
    turns = ("unknown", way.turn, "left" if way.turn == "u_turn" else way.turn)
    return ego.maneuver in turns or bool(way.change_side)


def _matches_entry(ego: EgoVehicle, way: LaneRoute, sides: set[str]) -> bool:
    return ego.entry_road == "unknown" or (way.entry in sides) == (ego.entry_road == "side")


def _find_side_entries(ways: Sequence[LaneRoute]) -> set[str]:
    """Return the minor roads: those without a straight route, and all but the widest of those that lead to one exit."""
    entries = {way.entry for way in ways}
    width = {entry: max(way.entry_rank for way in ways if way.entry == entry) for entry in entries}
    if len({way.exit for way in ways}) == 1:
        return {entry for entry in entries if width[entry] < max(width.values())}
    return entries - {way.entry for way in ways if way.turn == "straight"}


def _is_perpendicular(a: LaneRoute, b: LaneRoute, side: int) -> bool:
    """Return whether `a` comes from the right of `b` (side 1) or from its left (-1)."""
    return abs(wrap_angle(wrap_angle(a.entry_yaw - b.entry_yaw) - side * math.pi / 2)) < PERPENDICULAR_RAD


def _is_beside(a: LaneRoute, b: LaneRoute, step: int) -> bool:
    """Return whether `a` begins so many lanes to the left of `b`, on the same road."""
    return a.entry == b.entry and a.entry_rank == b.entry_rank + step


def _merges(a: LaneRoute, b: LaneRoute) -> bool:
    return a.lanes[0] != b.lanes[0] and a.exit == b.exit and a.exit_rank == b.exit_rank


RELATIONS: Mapping[str, Callable[[LaneRoute, LaneRoute], bool]] = {
    "same_approach_as": lambda a, b: a.entry == b.entry,
    "same_road_as": lambda a, b: a.entry == b.entry,
    "opposite_approach_of": are_opposite,
    "perpendicular_right_of": lambda a, b: _is_perpendicular(a, b, 1),
    "perpendicular_left_of": lambda a, b: _is_perpendicular(a, b, -1),
    "same_exit_as": lambda a, b: a.exit == b.exit,
    "follow_route_of": lambda a, b: a == b,
    "left_lane_of": lambda a, b: _is_beside(a, b, 1),
    "right_lane_of": lambda a, b: _is_beside(a, b, -1),
    "merges_into_lane_of": _merges,
    "same_lane_as": lambda a, b: _is_beside(a, b, 0),
}
"""Whether `a` stands in a relation to `b`."""
