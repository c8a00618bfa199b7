"""Validation of one scenario of the hard tier: certificates are computed anew.

`omniscient` must score 100 with every seed, time limits must follow from its times, and the certificate of need is
computed from its drive. Difficulty is not a near miss of blind driving here, but the need.
"""

from collections.abc import Iterator
from dataclasses import dataclass

from mdrive_sumo.generate.hard.family import BUCKET as HARD_BUCKET
from mdrive_sumo.generate.hard.reference_drive import drive_with, score_reference
from mdrive_sumo.generate.hard.time_limits import LEAST_FACTOR, MOST_FACTOR, find_limit_factor
from mdrive_sumo.generate.validation.requirements import FULL_SCORE
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.reference_times import REFERENCE_AGENT, ReferenceTicks
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scoring import ScoreMode, find_arrival_ticks, score_episode
from mdrive_sumo.study.need_certificate import NeedCertificate, certify_need

__all__ = ["HARD_BUCKET", "HardValidation", "validate_hard_scenario"]


@dataclass(frozen=True, slots=True)
class HardValidation:
    """What the drives of a scenario of the hard tier showed."""

    problems: tuple[str, ...]
    omniscient_ds: float
    """Seed 0."""
    reference: ReferenceTicks
    need: NeedCertificate
    seeds: int
    """With how many seeds `omniscient` was driven."""


def validate_hard_scenario(scenario: Scenario, roads: RoadMap, seeds: int) -> HardValidation:
    """Drive a sound scenario with `omniscient` and so many seeds, and report its problems. Raises WorldError."""
    solved = drive_with(REFERENCE_AGENT, scenario, roads)
    result = score_episode(solved, scenario, roads, ScoreMode.MDRIVE, 0)
    ticks = find_arrival_ticks(result.egos)
    problems = (
        *_find_unsolved(scenario, roads, result.ds, seeds),
        *_find_wrong_limits(scenario, ticks),
    )
    return HardValidation(problems, result.ds, ticks, certify_need(scenario, roads, solved), seeds)


def _find_unsolved(scenario: Scenario, roads: RoadMap, first_ds: float, seeds: int) -> Iterator[str]:
    for seed in range(seeds):
        ds = _score_seed(scenario, roads, seed) if seed else first_ds
        if ds < FULL_SCORE:
            yield f"not solvable: seed {seed}: expected {REFERENCE_AGENT} to reach DS {FULL_SCORE:g}, found {ds:.2f}"


def _score_seed(scenario: Scenario, roads: RoadMap, seed: int) -> float:
    return score_reference(drive_with(REFERENCE_AGENT, scenario, roads, seed), scenario, roads, seed)


def _find_wrong_limits(scenario: Scenario, ticks: ReferenceTicks) -> Iterator[str]:
    if find_limit_factor(scenario, ticks) is None:
        found = ", ".join("none" if ego.time_limit_s is None else f"{ego.time_limit_s:g} s" for ego in scenario.egos)
        yield (
            f"time limits: expected factor x the time of {REFERENCE_AGENT} + 2 s with one factor from"
            f" {LEAST_FACTOR:g} to {MOST_FACTOR:g} for all CAVs, found {found}"
        )
