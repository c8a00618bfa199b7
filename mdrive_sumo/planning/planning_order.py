"""Who plans first: an order of the CAVs in which everyone finds a way. Every CAV computes the same one for itself."""

from collections.abc import Mapping
from functools import partial

import numpy as np

from mdrive_sumo.core.geometry import Bool
from mdrive_sumo.planning.fleet import Fleet
from mdrive_sumo.planning.path_overlap import Margin
from mdrive_sumo.planning.speed_profile import Profile, Task, fastest

TRIES = 24


def planning_order(fleet: Fleet, tasks: Mapping[str, Task]) -> tuple[str, ...]:
    """An order in which prioritised planning succeeds for all, or the best of `TRIES`; tasks are those of a free road.

    A car that stands in the way of another must leave first. Apart from that whoever is nearest to a conflict comes
    first, and whoever finds no way is moved to the front for the next try.
    """
    leaders = {ego: fleet.standing_in_way(ego) for ego in tasks}
    urgency = {ego: _first_conflict(fleet, ego) for ego in tasks}
    best: tuple[str, ...] = ()
    most = -1
    for attempt in range(TRIES):
        order = _sorted(leaders, urgency)
        successful = _successful(fleet, tasks, order)
        if successful > most:
            best, most = order, successful
        if successful == len(order):
            break
        urgency[order[successful]] = -1.0 - attempt
    return best


def _first_conflict(fleet: Fleet, ego: str) -> float:
    """Index of the first cell of ego at which it may meet anybody."""
    cells = [np.flatnonzero(fleet.overlap(ego, j).any(1)) for j in fleet.paths if j != ego]
    return float(min((cell[0] for cell in cells if len(cell)), default=0))


def _sorted(leaders: Mapping[str, frozenset[str]], urgency: Mapping[str, float]) -> tuple[str, ...]:
    """Leaders first, then the urgent; whom the urgent wait for is as urgent. A circle is cut at its most urgent."""
    inherited = dict(urgency)
    for _ in leaders:
        for ego, before in leaders.items():
            for leader in before:
                inherited[leader] = min(inherited[leader], inherited[ego])
    left = sorted(leaders, key=lambda ego: (inherited[ego], ego))
    order: list[str] = []
    while left:
        free = [ego for ego in left if not leaders[ego] & set(left)]
        order.append((free or left)[0])
        left.remove(order[-1])
    return tuple(order)


def _successful(fleet: Fleet, tasks: Mapping[str, Task], order: tuple[str, ...]) -> int:
    """How many CAVs of this order arrive one after the other before the first that does not."""
    done: dict[str, Profile] = {}
    for ego in order:
        profile = fastest(tasks[ego].among(partial(_blocked, fleet, ego, tasks[ego], done)))
        if profile is None or not profile.arrives:
            break
        done[ego] = profile
    return len(done)


def _blocked(fleet: Fleet, ego: str, task: Task, done: Mapping[str, Profile], margin: Margin) -> Bool:
    """Which cells those who have planned block, as `Task.blocked`."""
    blocked = task.blocked.copy()
    for other, profile in done.items():
        blocked |= fleet.blocked(ego, task.cells, other, profile.at(task.times), margin)
    return blocked
