"""Requirements on a scenario by its bucket.

Scenarios made for the benchmark are screened as the paper screens its generated ones (protocol 14.2): blind driving at
constant speed has a near miss, and `omniscient` drives every CAV to its goal without an infraction. Recordings were not
selected for danger, and their road users never make way for CAVs: there the goals must be reached, and difficulty is
only reported.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from mdrive_sumo.scoring import ScenarioResult

NEAR_MISS_TTC_S = 0.9
"""[s] Blind driving must come closer to a collision than this (paper, CR; protocol 14.2)."""
FULL_SCORE = 100.0
"""Driving score [%] that only a drive without infraction and with every CAV at its goal has."""


@dataclass(frozen=True, slots=True)
class ScreeningRequirements:
    """Requirements on the two drives of a scenario."""

    near_miss_required: bool
    """Whether blind driving must have a near miss."""
    full_score: Literal["ds", "rc"]
    """Which score of `omniscient` must be full: driving score, or route completion alone."""


AUTHORED = ScreeningRequirements(near_miss_required=True, full_score="ds")
RECORDED = ScreeningRequirements(near_miss_required=False, full_score="rc")
REQUIREMENTS_BY_BUCKET: Mapping[str, ScreeningRequirements] = {
    "InterDrive": AUTHORED,
    "Interaction": AUTHORED,
    "V2XPnP": RECORDED,
    "Real2Sim": RECORDED,
}
"""By bucket; any other bucket counts as authored."""


def has_near_miss(blind_ttc_s: float | None) -> bool:
    """Return whether blind driving has a near miss."""
    return blind_ttc_s is not None and blind_ttc_s < NEAR_MISS_TTC_S


def find_unmet_requirements(bucket: str, blind: ScenarioResult, omniscient: ScenarioResult) -> tuple[str, ...]:
    """Return the requirements that the drives of a scenario do not meet, one sentence each."""
    demands, problems = REQUIREMENTS_BY_BUCKET.get(bucket, AUTHORED), list[str]()
    if demands.near_miss_required and not has_near_miss(blind.min_ttc):
        found = "none" if blind.min_ttc is None else f"{blind.min_ttc:.2f} s"
        problems.append(f"not difficult: expected a blind TTC below {NEAR_MISS_TTC_S} s, found {found}")
    if (score := getattr(omniscient, demands.full_score)) < FULL_SCORE:
        name = demands.full_score.upper()
        problems.append(f"not solvable: expected omniscient to reach {name} {FULL_SCORE:g}, found {score:.2f}")
    return tuple(problems)
