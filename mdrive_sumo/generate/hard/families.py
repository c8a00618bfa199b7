"""All scenario families of the hard tier by category."""

from collections.abc import Mapping

from mdrive_sumo.generate.hard import (
    families_agreed,
    families_queues,
    families_riders,
    families_rows,
)
from mdrive_sumo.generate.hard.family import ScenarioFamily

_ALL: tuple[ScenarioFamily, ...] = (
    *families_agreed.FAMILIES,
    *families_queues.FAMILIES,
    *families_rows.FAMILIES,
    *families_riders.FAMILIES,
)

FAMILIES: Mapping[str, ScenarioFamily] = {family.category: family for family in _ALL}
