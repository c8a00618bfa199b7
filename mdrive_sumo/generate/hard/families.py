"""All scenario families of the hard tier by category."""

from collections.abc import Mapping

from mdrive_sumo.generate.hard import (
    blind_crossing,
    blocked_junction,
    hidden_stop,
    motorway_ramps,
    narrow_street,
    occluded_pedestrian,
    priority_crossings,
    right_turn_cyclist,
    roundabout_entry,
    side_street_cyclist,
    unprotected_left,
    works_zone,
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
    motorway_ramps.MERGE_FAMILY,
    motorway_ramps.WEAVE_FAMILY,
    *priority_crossings.PLATOON_FAMILIES,
    narrow_street.FAMILY,
    works_zone.FAMILY,
    *priority_crossings.AMBULANCE_FAMILIES,
    *priority_crossings.MIXED_FAMILIES,
    hidden_stop.FAMILY,
)

FAMILIES: Mapping[str, ScenarioFamily] = {family.category: family for family in _ALL}
