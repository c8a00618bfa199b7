"""What the abbreviations of scores mean, for pages that show them; a test compares the texts with docs/glossary.md."""

from collections.abc import Mapping
from types import MappingProxyType

SCORE_TERMS: Mapping[str, str] = MappingProxyType(
    {
        "DS": "driving score in percent: RC x IP",
        "SR": "success rate in percent: share of CAVs with DS > 99.95",
        "RC": "route completion in percent",
        "IP": "infraction penalty: the product of the factors of all infractions, 1 if there are none",
        "efficient SR": ("success rate in percent that counts only successes within twice the time of `omniscient`"),
        "time ratio": (
            "the time that a CAV needs to arrive divided by the time of `omniscient`, averaged over the CAVs of a"
            " scenario if all arrive"
        ),
        "timed": "of a scenario: every CAV arrived, so that it has a time ratio",
        "void": "of an episode: made worthless by a failure of mdrive-sumo or SUMO, never by the agent",
    }
)
"""Term -> its row in the glossary."""
