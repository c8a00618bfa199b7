"""Select the converted recordings whose means are nearest to the paper's table."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.statistics import compute_heading_change_deg, compute_route_length

PAPER_MEANS = np.array((45.68, 60.92, 83.88))
"""Means of the bucket in the paper's table: route [m] and heading change [deg] per CAV, background actors."""
MAX_ROUNDS = 200


@dataclass(frozen=True)
class SelectionCandidate:
    """A converted recording with its figures for the selection."""

    id: str
    group: str
    """Map and number of CAVs; the required number of each group is selected."""
    sums: tuple[float, float, float]
    """Route lengths [m] and heading changes [deg] summed over the CAVs, number of background actors."""
    cavs: int


def build_candidate(scenario: Scenario, group: str) -> SelectionCandidate:
    """Compute the figures of a scenario."""
    lengths, turns = (sum(map(f, scenario.egos)) for f in (compute_route_length, compute_heading_change_deg))
    actors = len(scenario.background.vehicles) + len(scenario.actors)
    return SelectionCandidate(scenario.id, group, (lengths, turns, float(actors)), len(scenario.egos))


def compute_means(chosen: Sequence[SelectionCandidate]) -> Float:
    """Return means in the order of `PAPER_MEANS`; lengths and turns over all CAVs, actors over the scenarios."""
    sums = np.array([one.sums for one in chosen]).sum(axis=0)
    cavs = sum(one.cavs for one in chosen)
    return sums / (cavs, cavs, len(chosen))


def select_candidates(
    candidates: Sequence[SelectionCandidate], wanted: Mapping[str, int]
) -> tuple[SelectionCandidate, ...]:
    """Start with the first of every group, then apply the best exchange within a group until none improves."""
    chosen = [
        one
        for group, count in wanted.items()
        for one in [other for other in candidates if other.group == group][:count]
    ]
    for _ in range(MAX_ROUNDS):
        swaps = [
            (_compute_distance([*chosen[:i], other, *chosen[i + 1 :]]), i, other)
            for i, one in enumerate(chosen)
            for other in candidates
            if other.group == one.group and other not in chosen
        ]
        if not swaps:
            break
        best, i, other = min(swaps, key=lambda swap: swap[:2])
        if best >= _compute_distance(chosen) - 1e-9:
            break
        chosen[i] = other
    return tuple(sorted(chosen, key=lambda one: one.id))


def _compute_distance(chosen: Sequence[SelectionCandidate]) -> float:
    return float(np.square(compute_means(chosen) / PAPER_MEANS - 1.0).sum())
