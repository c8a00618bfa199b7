"""All scenario families of the hard tier by category."""

from collections.abc import Mapping

from mdrive_sumo.generate.hard import (
    driveway_exits,
    families_crossings,
    families_junctions,
    families_queues,
    families_two_lanes,
    step_out_families,
)
from mdrive_sumo.generate.hard.family import ScenarioFamily

_ALL: tuple[ScenarioFamily, ...] = (
    *families_crossings.FAMILIES,
    *families_junctions.FAMILIES,
    *families_queues.FAMILIES,
    *families_two_lanes.FAMILIES,
    *step_out_families.FAMILIES,
    *driveway_exits.FAMILIES,
)

FAMILIES: Mapping[str, ScenarioFamily] = {family.category: family for family in _ALL}
