"""Categories of the labels of V2XPnP, V2V4Real and V2X-Real, and of objects without a known label."""

import math
import re
from collections.abc import Mapping
from types import MappingProxyType

from real2sim.recording import ObjectCategory

CATEGORY_BY_LABEL: Mapping[str, ObjectCategory] = MappingProxyType(
    {
        **dict.fromkeys(("car", "policecar"), ObjectCategory.CAR),
        **dict.fromkeys(("van", "ambulance"), ObjectCategory.VAN),
        **dict.fromkeys(("truck", "longvehicle", "concretetruck", "firetruck", "trailer"), ObjectCategory.TRUCK),
        "bus": ObjectCategory.BUS,
        **dict.fromkeys(("motorcycle", "motorcyclerider"), ObjectCategory.MOTORCYCLE),
        **dict.fromkeys(("bicyclerider", "cyclist", "bicycle", "scooter", "scooterrider"), ObjectCategory.BICYCLE),
        **dict.fromkeys(("pedestrian", "child", "roadworker"), ObjectCategory.PEDESTRIAN),
        **dict.fromkeys(
            ("trashcan", "trafficcone", "cone", "barrier", "constructioncart", "firehydrant"), ObjectCategory.STATIC
        ),
    }
)
"""Labels without case and separators."""
CATEGORY_BY_LENGTH: tuple[tuple[float, ObjectCategory], ...] = (
    (1.2, ObjectCategory.PEDESTRIAN),
    (2.6, ObjectCategory.BICYCLE),
    (6.5, ObjectCategory.CAR),
    (math.inf, ObjectCategory.TRUCK),
)
"""Category of an object without known label by the length of its box [m]; CARLA's motorcycles are up to 2.4 m long."""


def find_category(label: str) -> ObjectCategory | None:
    """Return the category of a label in any case and with any separators; None if it is unknown."""
    return CATEGORY_BY_LABEL.get(re.sub(r"[^a-z]", "", label.lower()))


def find_category_by_length(length_m: float) -> ObjectCategory:
    """Return the category that fits the length of a box."""
    return next(category for largest, category in CATEGORY_BY_LENGTH if length_m <= largest)
