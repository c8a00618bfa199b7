"""All scenario families of the hard tier by category."""

from collections.abc import Mapping

from mdrive_sumo.generate.hard import (
    blind_crossing,
    blocked_junction,
    occluded_pedestrian,
    right_turn_cyclist,
    roundabout_entry,
    side_street_cyclist,
    unprotected_left,
)
from mdrive_sumo.generate.hard.family import ScenarioFamily

_ALL: tuple[ScenarioFamily, ...] = (
    unprotected_left.FAMILY,
    blind_crossing.FAMILY,
    occluded_pedestrian.FAMILY,
    right_turn_cyclist.FAMILY,
    roundabout_entry.FAMILY,
    blocked_junction.FAMILY,
    side_street_cyclist.FAMILY,
)

FAMILIES: Mapping[str, ScenarioFamily] = {family.category: family for family in _ALL}
