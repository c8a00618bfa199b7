"""All scenario families of the hard tier by category."""

from collections.abc import Mapping

from mdrive_sumo.generate.hard import (
    blind_crossing,
    blocked_junction,
    emergency_vehicle,
    hidden_stop,
    mixed_crossing,
    motorway_merge,
    motorway_weave,
    narrow_street,
    occluded_pedestrian,
    platoon_crossing,
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
    motorway_merge.FAMILY,
    motorway_weave.FAMILY,
    platoon_crossing.FAMILY,
    platoon_crossing.CORRIDOR_FAMILY,
    narrow_street.FAMILY,
    works_zone.FAMILY,
    emergency_vehicle.FAMILY,
    emergency_vehicle.CORRIDOR_FAMILY,
    mixed_crossing.FAMILY,
    mixed_crossing.CORRIDOR_FAMILY,
    hidden_stop.FAMILY,
)

FAMILIES: Mapping[str, ScenarioFamily] = {family.category: family for family in _ALL}
