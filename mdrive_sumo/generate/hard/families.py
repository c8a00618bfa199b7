"""All scenario families of the hard tier by category."""

from collections.abc import Mapping

from mdrive_sumo.generate.hard import blind_platoons
from mdrive_sumo.generate.hard.family import ScenarioFamily

_ALL: tuple[ScenarioFamily, ...] = (blind_platoons.FAMILY,)

FAMILIES: Mapping[str, ScenarioFamily] = {family.category: family for family in _ALL}
