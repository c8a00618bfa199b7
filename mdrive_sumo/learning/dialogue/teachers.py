"""Orders of passing that formulas and `omniscient` teach, and which orders are worth a simulation."""

from collections.abc import Mapping, Sequence
from itertools import combinations, permutations

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.negotiation.conflict_graph import CONFLICT, ConflictGraph
from mdrive_sumo.negotiation.dialogue.dialogue_view import find_zones
from mdrive_sumo.negotiation.negotiator import NegotiationMember
from mdrive_sumo.negotiation.rule_negotiator import find_leader_pairs
from mdrive_sumo.planning.planning_order import order_by_urgency

ALL_ORDERS_UP_TO = 3
"""Members of which all orders are considered; of larger groups those of the teachers and their neighbours."""
BEYOND_S = 4.0
"""When a member without a shared area within the prediction counts as entering one."""

Order = tuple[str, ...]
"""Stations in the order in which they pass."""


def find_passing_order(members: Sequence[NegotiationMember], graph: ConflictGraph, group: Sequence[str]) -> Order:
    """Return the order of `passing`: that of entering shared areas, each member behind its leader."""
    leaders = find_leader_pairs(members)
    return order_by_urgency(tuple(group), {name: graph.get_entry_time(name) for name in group}, leaders)


def find_rule_order(graph: ConflictGraph, group: Sequence[str]) -> Order:
    """Return the order of the rule of the protocol: the nearest to its conflict goes, the others wait."""
    return tuple(sorted(group, key=lambda name: (graph.get_distance_to_conflict(name), name)))


def find_driven_order(episode: EpisodeRecord, column_by_station: Mapping[str, int]) -> Order:
    """Return the order in which CAVs entered the areas that they shared in a drive.

    column_by_station: of the recording, by station of the group. A CAV that shared none comes last.
    """
    group = tuple(sorted(column_by_station))
    entered = {name: float(episode.ticks) for name in group}
    before: set[tuple[str, str]] = set()
    for first, second in combinations(group, 2):
        first_tick = _find_entry(episode, column_by_station[first], column_by_station[second])
        second_tick = _find_entry(episode, column_by_station[second], column_by_station[first])
        if first_tick is None or second_tick is None:
            continue
        before.add((first, second) if (first_tick, first) < (second_tick, second) else (second, first))
        entered[first] = min(entered[first], float(first_tick))
        entered[second] = min(entered[second], float(second_tick))
    return order_by_urgency(group, entered, before)


def _find_entry(episode: EpisodeRecord, column: int, other: int) -> int | None:
    """Return the tick at which a CAV enters the area that it shares with another one; None if there is none."""
    ticks = np.flatnonzero(episode.valid[:, column])
    mine, theirs = _get_way(episode, column), _get_way(episode, other)
    gaps = portable.hypot(mine[:, None, 0] - theirs[None, :, 0], mine[:, None, 1] - theirs[None, :, 1])
    inside = np.flatnonzero(gaps.min(axis=1) < CONFLICT.min_distance_m)
    return int(ticks[inside[0] * WAY_STRIDE]) if len(inside) else None


WAY_STRIDE = 4
"""Ticks between points of a way that are compared: 1.6 m at 8 m/s."""


def _get_way(episode: EpisodeRecord, column: int) -> Float:
    ticks = np.flatnonzero(episode.valid[:, column])[::WAY_STRIDE]
    return np.column_stack((episode.x[ticks, column], episode.y[ticks, column]))


def choose_candidates(
    members: Sequence[NegotiationMember], graph: ConflictGraph, taught: Sequence[Order], most: int
) -> list[Order]:
    """Return at most so many orders to simulate: those of teachers, then those that cost the least waiting.

    A leader stays before its follower. The waiting is a surrogate: each member enters its areas when the one before it
    has left them.
    """
    leaders = find_leader_pairs(members)
    group = tuple(sorted(member.id for member in members))
    others = [*permutations(group)] if len(group) <= ALL_ORDERS_UP_TO else _list_neighbours(taught)
    possible = {order for order in (*taught, *others) if all(order.index(a) < order.index(b) for a, b in leaders)}
    found = [order for order in dict.fromkeys(taught) if order in possible]
    zones = find_zones(members, graph)
    found += sorted(possible - set(found), key=lambda order: (_estimate_waiting(order, zones), order))
    return found[:most]


def _list_neighbours(orders: Sequence[Order]) -> list[Order]:
    """Return the orders with two members next to each other exchanged."""
    return [
        (*order[:i], order[i + 1], order[i], *order[i + 2 :]) for order in orders for i in range(len(order) - 1)
    ]  # fmt: skip


def _estimate_waiting(order: Order, zones: Mapping[str, tuple[float, float] | None]) -> float:
    """Return the time that all members together lose [s]."""
    free_from = waiting = 0.0
    for name in order:
        entry, leave = zones[name] or (BEYOND_S, BEYOND_S)
        late = max(free_from - entry, 0.0)
        waiting += late
        free_from = max(free_from, leave + late)
    return waiting
