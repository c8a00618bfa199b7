"""The order in which CAVs plan, such that every one finds a profile. Each CAV computes the same order."""

from collections.abc import Collection, Mapping, Sequence
from functools import partial

import numpy as np

from mdrive_sumo.core.geometry import Bool
from mdrive_sumo.planning.fleet_paths import FleetPaths
from mdrive_sumo.planning.parameters import JOINT_PLANNING, JointPlanningParameters, SafetyMargin
from mdrive_sumo.planning.profile_search import find_fastest_profile
from mdrive_sumo.planning.speed_profile import SpeedProfile, SpeedProfileProblem


def find_planning_order(
    fleet: FleetPaths,
    problems: Mapping[str, SpeedProfileProblem],
    parameters: JointPlanningParameters = JOINT_PLANNING,
) -> tuple[str, ...]:
    """Return an order in which prioritised planning succeeds for all CAVs, or the best of `order_attempts`.

    A car that stands in the way of another one must leave first. Apart from that the car nearest to a conflict comes
    first, and a car that finds no profile moves to the front for the next attempt.

    problems: by CAV id, on a free road.
    """
    before = {(leader, ego) for ego in problems for leader in fleet.find_blocking_starts(ego)}
    urgency = {ego: _find_first_conflict(fleet, ego) for ego in problems}
    best: tuple[str, ...] = ()
    most = -1
    for attempt in range(parameters.order_attempts):
        order = order_by_urgency(tuple(problems), urgency, before, own_urgency_breaks_ties=False)
        successful = _count_successful(fleet, problems, order)
        if successful > most:
            best, most = order, successful
        if successful == len(order):
            break
        urgency[order[successful]] = -1.0 - attempt
    return best


def _find_first_conflict(fleet: FleetPaths, ego: str) -> float:
    """Return the index of the first cell of ego that overlaps the path of another CAV."""
    cells = [np.flatnonzero(fleet.get_overlap(ego, j).any(1)) for j in fleet.path_by_ego if j != ego]
    return float(min((cell[0] for cell in cells if len(cell)), default=0))


def _count_successful(fleet: FleetPaths, problems: Mapping[str, SpeedProfileProblem], order: tuple[str, ...]) -> int:
    """Return how many CAVs of this order reach their goal before the first that does not."""
    done: dict[str, SpeedProfile] = {}
    for ego in order:
        block = partial(_find_blocked, fleet, ego, problems[ego], done)
        profile = find_fastest_profile(problems[ego].add_traffic(block, plan_margin=fleet.margin))
        if profile is None or not profile.reaches_goal:
            break
        done[ego] = profile
    return len(done)


def _find_blocked(
    fleet: FleetPaths,
    ego: str,
    problem: SpeedProfileProblem,
    done: Mapping[str, SpeedProfile],
    margin: SafetyMargin,
) -> Bool:
    """Return `SpeedProfileProblem.blocked` with the cells that the CAVs with a profile occupy."""
    blocked = problem.blocked.copy()
    for other, profile in done.items():
        stations = profile.get_stations(problem.times)
        blocked |= fleet.find_blocked_cells(ego, problem.cells, other, stations, margin)
    return blocked


def order_by_urgency(
    group: Sequence[str],
    urgency: Mapping[str, float],
    before: Collection[tuple[str, str]],
    own_urgency_breaks_ties: bool = True,
) -> tuple[str, ...]:
    """Return the group sorted by urgency (smallest value first) such that every pair (first, second) is respected.

    A member that must precede an urgent one inherits its urgency. A cycle is cut at its most urgent member. Ties go to
    the smaller own urgency (unless `own_urgency_breaks_ties` is False), then to the smaller id.
    """
    inherited = {name: urgency[name] for name in group}
    pairs = [(first, second) for first, second in before if first in inherited and second in inherited]
    for _ in group:
        for first, second in pairs:
            inherited[first] = min(inherited[first], inherited[second])
    own = urgency if own_urgency_breaks_ties else dict.fromkeys(group, 0.0)
    waiting = sorted(group, key=lambda name: (inherited[name], own[name], name))
    order: list[str] = []
    while waiting:
        free = [name for name in waiting if not any(second == name and first in waiting for first, second in pairs)]
        order.append((free or waiting)[0])
        waiting.remove(order[-1])
    return tuple(order)
