"""Parameters and places that families at junctions share."""

from mdrive_sumo.contract.briefing import JunctionKind
from mdrive_sumo.generate.drawn_places import PlaceChoice
from mdrive_sumo.generate.hard.family import FamilyParameter

MOST_SEEN_S = 3.2
"""[s] Where drivers see each other earlier, one without messages brakes in time: from 50 km/h a car stops in 2 s."""
AMBULANCE_MPS = 13.9
"""[m/s] Least speed of an ambulance on call in a street of 30 km/h: 50 km/h."""
GIVING_WAY: tuple[JunctionKind, ...] = ("yield",)
MAIN_STREET: tuple[JunctionKind, ...] = ("priority-road",)
EQUAL: tuple[JunctionKind, ...] = ("right-before-left",)
OLD_TOWNS = (
    PlaceChoice("town_block", {"area": "old_town", "control": "main_street", "columns": 3, "keeps_sight": False}),
    PlaceChoice(
        "crossing", {"area": "old_town", "arms": 4, "control": "priority", "speed_kmh": 50, "keeps_sight": False}
    ),
    PlaceChoice("corridor", {"junctions": 3, "limit_kmh": 50.0, "signals": "none", "keeps_sight": False}),
)
HEDGES = (
    PlaceChoice("country_road", {"tracks": 3, "roadside": "hedges", "keeps_sight": False}),
    PlaceChoice("crossing", {"area": "country", "arms": 4, "control": "priority", "keeps_sight": False}),
)
EQUAL_PLACES = (
    PlaceChoice(
        "crossing",
        {"area": "old_town", "arms": 4, "control": "right_before_left", "speed_kmh": 50, "keeps_sight": False},
    ),
    PlaceChoice("town_block", {"area": "old_town", "control": "right_before_left", "rows": 2, "keeps_sight": False}),
)
STOP_PLACES = tuple(
    PlaceChoice("crossing", {"area": area, "arms": 4, "control": "stop", "speed_kmh": speed, "keeps_sight": False})
    for area, speed in (("old_town", 50), ("town", 50), ("country", 70))
)
SITE = FamilyParameter("site", 0.0, 1.0, "", "which of the crossings of the place")
DUE = FamilyParameter("due_s", 3.5, 5.5, "s", "time after which the first CAV is due at the conflict")
HEADWAY = FamilyParameter("headway_s", 0.8, 1.6, "s", "time headway in a column of CAVs")
VAN = FamilyParameter("van", 0.0, 1.0, "", "whether hidden vehicles are vans (from 0.5 on)")
MAST = FamilyParameter("mast", 0.0, 1.0, "", "whether a roadside unit sees the junction (from 0.5 on)")


def name_number(name: str, low: float, high: float, meaning: str) -> FamilyParameter:
    return FamilyParameter(name, low, high, "", f"number of CAVs {meaning}, rounded")


def name_flow(low: float, high: float, where: str) -> FamilyParameter:
    return FamilyParameter("flow", low, high, "veh/h", f"other traffic on each way of {where}")


COLUMNS = (
    SITE,
    name_number("own", 1.5, 4.4, "on the first approach"),
    name_number("back", 0.0, 3.0, "on the opposite approach"),
    DUE,
    FamilyParameter("back_s", -1.0, 1.5, "s", "how much later those on the opposite approach are due"),
    HEADWAY,
)
CROSS = (
    name_number("near", 1.0, 3.0, "on the near way of the other street"),
    FamilyParameter("near_s", -1.0, 1.5, "s", "how much later they are due"),
    name_number("far", 0.0, 2.0, "on the far way of the other street"),
    FamilyParameter("far_s", -1.0, 1.5, "s", "how much later they are due"),
)
HIDDEN = (
    FamilyParameter("gap_s", -0.8, 0.8, "s", "how much later than the first CAV the hidden vehicle is due"),
    FamilyParameter("share", 0.85, 1.1, "", "speed of hidden vehicles as a share of the limit"),
    FamilyParameter("behind_s", 1.0, 2.2, "s", "how much later than a hidden vehicle the CAV behind it is due"),
)
WITNESSES = (
    name_number("near", 1.0, 3.0, "behind the hidden vehicle on the near way"),
    name_number("far", 0.0, 2.0, "behind the hidden vehicle on the far way"),
    FamilyParameter("far_s", -0.5, 2.0, "s", "how much later the hidden vehicle on the far way is due"),
)
