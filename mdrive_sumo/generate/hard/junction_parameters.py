"""Parameters and places that families at junctions share."""

from mdrive_sumo.generate.drawn_places import PlaceChoice
from mdrive_sumo.generate.hard.family import FamilyParameter

OLD_TOWNS = (
    PlaceChoice("town_block", {"area": "old_town", "control": "main_street", "columns": 3, "keeps_sight": False}),
    PlaceChoice(
        "crossing", {"area": "old_town", "arms": 4, "control": "priority", "speed_kmh": 50, "keeps_sight": False}
    ),
    PlaceChoice("corridor", {"junctions": 3, "limit_kmh": 50.0, "signals": "none", "keeps_sight": False}),
)
SITE = FamilyParameter("site", 0.0, 1.0, "", "which of the crossings of the place")
HEADWAY = FamilyParameter("headway_s", 0.8, 1.6, "s", "time headway in a column of CAVs")


def name_number(name: str, low: float, high: float, meaning: str) -> FamilyParameter:
    return FamilyParameter(name, low, high, "", f"number of CAVs {meaning}, rounded")
