"""Groups of categories: InterDrive's three sub-categories (protocol 8.5), Interaction's three levels (protocol 1.2)."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType

from mdrive_sumo.scenario.categories import LEVELS, Category
from mdrive_sumo.scoring.results import BucketResult, ScenarioResult
from mdrive_sumo.scoring.score_mode import ScoreMode
from mdrive_sumo.scoring.summary import grouped_means

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


def category_groups(scenarios: Sequence[ScenarioResult], mode: ScoreMode) -> dict[str, BucketResult]:
    """Means over the scenarios of each group, other scenarios left out."""
    return interdrive_groups(scenarios, mode) | interaction_levels(scenarios)


def interaction_levels(scenarios: Sequence[ScenarioResult]) -> dict[str, BucketResult]:
    """Means over the scenarios of each interactivity level, other scenarios left out."""
    known = [scenario for scenario in scenarios if scenario.category in set(LEVELS)]
    return grouped_means(known, lambda scenario: LEVELS[Category(scenario.category)])


def interdrive_groups(scenarios: Sequence[ScenarioResult], mode: ScoreMode) -> dict[str, BucketResult]:
    """Means over the scenarios of each sub-category, other scenarios left out.

    The original compares name parts in an order in which crosschange falls into LM; so do the InterDrive
    modes.
    """
    groups = GROUPS if mode is ScoreMode.MDRIVE else {**GROUPS, "ins_crosschange": "LM"}
    return grouped_means([s for s in scenarios if s.category in groups], lambda s: groups[s.category])
