"""The cheapest chain of lanes through the key frames of a track, found by Viterbi.

Emission costs depend on lateral distance and heading, transition costs on the difference between the distance along the
network and the driven distance.
"""

from dataclasses import dataclass

import numpy as np

from mdrive_sumo.core.geometry import Float
from real2sim.match.lane_candidates import LaneCandidateIndex, LaneCandidates, LanePath

OFFSET_SIGMA_M = 0.8
"""[m] Chosen: standard deviation of the distance from the centre line of the lane that is driven on."""
HEADING_SIGMA_RAD = np.radians(15)
"""Chosen: standard deviation of the angle between vehicle and lane."""
DISTANCE_SCALE_M = 1.5
"""[m] Chosen: this difference between the driven distance and that along the lanes costs 1."""
LANE_CHANGE_COST = 4.0
"""Cost of a lane change: that of driving 2.3 sigma off a centre line in a single key frame."""
LANE_CHANGE_M = 5.0
"""[m] Cost of a lane change in the choice between paths to the same lane."""
BREAK_COST = 60.0
"""Cost of a step between lanes without a path: higher than any real step."""
DETOUR_M = 40.0
"""[m] How much longer than driven the paths are that are searched."""
MAX_DETOUR_M, MAX_DETOUR_SHARE = 10.0, 0.25
"""[m] A step whose network distance differs by more than this, and this share of the driven distance, is a break: the
vehicle took a way that the map lacks (a U-turn, a gateway). The largest of the 4449 real steps of the logs in
docs/real2sim.md is 4.7 m."""


@dataclass(frozen=True)
class _ViterbiStep:
    """Best step to a candidate: predecessor (row of `LaneCandidates`), accumulated cost and path (None: a break)."""

    predecessor: int
    cost: float
    path: LanePath | None


def compute_emission_cost(d: Float, turn: Float) -> Float:
    """Return costs of candidates with lateral distance d [m] and angle turn [rad]; unknown angles cost nothing."""
    heading = np.where(np.isnan(turn), 0.0, turn / HEADING_SIGMA_RAD)
    return 0.5 * (d / OFFSET_SIGMA_M) ** 2 + 0.5 * heading**2


def compute_transition_cost(network_m: float, driven_m: float, changes: int) -> float:
    """Return the cost of a step from network distance and driven distance [m] and the number of lane changes."""
    if abs(network_m - driven_m) > MAX_DETOUR_M + MAX_DETOUR_SHARE * driven_m:
        return BREAK_COST
    return abs(network_m - driven_m) / DISTANCE_SCALE_M + LANE_CHANGE_COST * changes


def find_best_chain(
    index: LaneCandidateIndex, near: LaneCandidates, keys: list[int], xy: Float
) -> tuple[list[int], list[LanePath | None]]:
    """Return the cheapest rows of `near`, one per key frame, and the paths between them (None: a break)."""
    cost = compute_emission_cost(near.offset, near.turn)
    driven = np.concatenate(((0.0,), np.cumsum(np.hypot(*np.diff(xy, axis=0).T)))) if len(xy) > 1 else np.zeros(1)
    layers = [np.flatnonzero(near.point == key) for key in keys]
    chain: list[dict[int, _ViterbiStep]] = [{int(row): _ViterbiStep(-1, float(cost[row]), None) for row in layers[0]}]
    lanes, s = [index.roads.driving[lane].id for lane in near.lane.tolist()], near.s.tolist()
    for k in range(1, len(keys)):
        distance = float(driven[keys[k]] - driven[keys[k - 1]])
        before = [
            (step.cost, s[there], there, index.find_paths(lanes[there], distance + DETOUR_M, LANE_CHANGE_M))
            for there, step in chain[-1].items()
        ]
        chain.append({})
        for row in layers[k].tolist():
            step = _find_best_step(before, lanes[row], s[row], distance)
            chain[-1][row] = _ViterbiStep(step.predecessor, step.cost + float(cost[row]), step.path)
    return _backtrack(chain)


def _find_best_step(
    before: list[tuple[float, float, int, dict[str, LanePath]]], goal: str, s: float, driven: float
) -> _ViterbiStep:
    """Return the best step to arc length `s` [m] on the lane `goal`. `before`: cost, arc length, row, and the paths
    from the lane of each candidate of the key frame before."""
    best = _ViterbiStep(-1, np.inf, None)
    for cost, start, there, paths in before:
        hop = paths.get(goal)
        added = BREAK_COST
        if hop is not None:
            added = compute_transition_cost(hop.length + (s - start), driven, hop.lane_changes)
        if added >= BREAK_COST:
            hop, added = None, BREAK_COST
        if cost + added < best.cost:
            best = _ViterbiStep(there, cost + added, hop)
    return best


def _backtrack(chain: list[dict[int, _ViterbiStep]]) -> tuple[list[int], list[LanePath | None]]:
    row = min(chain[-1], key=lambda last_row: chain[-1][last_row].cost)
    rows, hops = [row], list[LanePath | None]()
    for layer in reversed(chain[1:]):
        step = layer[rows[-1]]
        rows.append(step.predecessor)
        hops.append(step.path)
    return rows[::-1], hops[::-1]
