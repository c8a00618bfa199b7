"""Groups of categories: InterDrive's three sub-categories (protocol 8.5), Interaction's three levels (protocol 1.2)."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType

from mdrive_sumo.scenario.categories import LEVELS, Category
from mdrive_sumo.scoring.results import BucketResult, ScenarioResult
from mdrive_sumo.scoring.score_mode import ScoreMode
from mdrive_sumo.scoring.summary import compute_group_means

GROUPS: Mapping[str, str] = MappingProxyType(
    {
        "ins_ss": "IC",
        "ins_sl": "IC",
        "ins_oppo": "IC",
        "ins_chaos": "IC",
        "ins_sr": "LM",
        "ins_c": "LM",
        "ins_rl": "LM",
        "hw_merge": "LM",
        "ins_crosschange": "LC",
        "hw_c": "LC",
    }
)
"""Category -> intersection crossing, lane merge or lane change."""


def compute_category_group_means(scenarios: Sequence[ScenarioResult], mode: ScoreMode) -> dict[str, BucketResult]:
    """Return the means over the scenarios of each InterDrive group and Interaction level."""
    return compute_interdrive_means(scenarios, mode) | compute_level_means(scenarios)


def compute_level_means(scenarios: Sequence[ScenarioResult]) -> dict[str, BucketResult]:
    """Return the means over the scenarios of each interactivity level; other scenarios are left out."""
    levelled = [scenario for scenario in scenarios if scenario.category in set(LEVELS)]
    return compute_group_means(levelled, lambda scenario: LEVELS[Category(scenario.category)])


def compute_interdrive_means(scenarios: Sequence[ScenarioResult], mode: ScoreMode) -> dict[str, BucketResult]:
    """Return the means over the scenarios of each InterDrive group; other scenarios are left out.

    The original's order of name comparisons assigns crosschange to LM; so do the InterDrive modes.
    """
    groups = GROUPS if mode in (ScoreMode.MDRIVE, ScoreMode.HARD) else {**GROUPS, "ins_crosschange": "LM"}
    return compute_group_means([s for s in scenarios if s.category in groups], lambda s: groups[s.category])
