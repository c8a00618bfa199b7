"""Families in which CAVs cross streams of riders that pass closely behind what stands at the kerb."""

from functools import partial

from mdrive_sumo.contract.briefing import JunctionKind
from mdrive_sumo.generate.drawn_places import PlaceChoice
from mdrive_sumo.generate.hard.family import FamilyParameter, ScenarioFamily
from mdrive_sumo.generate.hard.junction_parameters import SITE
from mdrive_sumo.generate.hard.riders import (
    BUSES,
    DELIVERING,
    PARKED,
    PEDELEC_MPS,
    SCOOTER_MPS,
    RiderKind,
    stage_riders,
)


def _choose(**parameters: str | int | float | bool) -> PlaceChoice:
    """Return a choice of crossings; none with zebras, which lie where a row would have to stand."""
    fixed = {"arms": 4, "speed_kmh": 50, "keeps_sight": False, "zebras": False, "skew_deg": 0.0, "bend": 0.0}
    return PlaceChoice("crossing", {**fixed, **parameters})


_CYCLE_PLACES = (
    _choose(area="old_town", control="priority", beside="cycle_lanes"),
    _choose(area="old_town", control="right_before_left", beside="cycle_lanes"),
    _choose(area="town", control="priority", beside="parking"),
    PlaceChoice("town_block", {"area": "old_town", "control": "main_street", "columns": 3, "keeps_sight": False}),
)
_MAIN_PLACES = (
    _choose(area="old_town", control="priority", beside="parking"),
    _choose(area="town", control="priority", beside="cycle_lanes"),
    _choose(area="suburb", control="priority", beside="cycle_lanes"),
    PlaceChoice("town_block", {"area": "old_town", "control": "main_street", "columns": 3, "keeps_sight": False}),
)
_TWO_LANES = (
    _choose(area="town", control="priority", main_lanes=2),
    _choose(area="old_town", control="priority", main_lanes=2),
    _choose(area="suburb", control="priority", main_lanes=2, speed_kmh=60),
)
_COUNTRY = (
    _choose(area="country", control="priority", speed_kmh=70),
    _choose(area="country", control="priority", speed_kmh=50),
    _choose(area="country", control="priority", speed_kmh=60),
)
_QUIET = (
    PlaceChoice("town_block", {"area": "town", "control": "right_before_left", "rows": 2, "keeps_sight": False}),
    PlaceChoice("town_block", {"area": "town", "control": "main_street", "columns": 3, "keeps_sight": False}),
    _choose(area="town", control="right_before_left", speed_kmh=30),
    _choose(area="suburb", control="priority", speed_kmh=30),
)
_MINOR: tuple[JunctionKind, ...] = ("yield", "stop", "right-before-left")


def _name_parameters(**bounds: tuple[float, float]) -> tuple[FamilyParameter, ...]:
    def name(one: str, low: float, high: float, unit: str, meaning: str) -> FamilyParameter:
        return FamilyParameter(one, *bounds.get(one, (low, high)), unit, meaning)

    return (
        SITE,
        name("own", 1.6, 3.4, "", "number of CAVs on the first way, rounded"),
        name("back", 0.9, 3.4, "", "number of CAVs on the second way, if there is one, rounded"),
        FamilyParameter("due_s", 3.0, 4.5, "s", "time after which the first CAV is due at the riders' line"),
        FamilyParameter("back_s", -0.5, 1.5, "s", "how much later the first one on the second way is due"),
        name("headway_s", 1.1, 1.9, "s", "time headway in a column of CAVs"),
        name("riding", *PEDELEC_MPS, "m/s", "speed of the riders"),
        name("before_s", 1.2, 2.2, "s", "how much earlier than the first CAV the first rider is due"),
        name("every_s", 1.0, 1.5, "s", "time between two riders"),
        name("lasts_s", 8.0, 11.0, "s", "how long a group of riders takes to pass"),
        name("pause_s", 5.5, 8.0, "s", "pause between two groups"),
        name("wall_m", 1.0, 1.8, "m", "distance of the riders from the edge of the street's lanes"),
        name("free_m", 0.3, 0.4, "m", "distance of what stands at the kerb from the riders"),
        name("side_m", 1.75, 1.95, "m", "its distance from the middle of the CAVs' way"),
        FamilyParameter("mast", 0.0, 0.8, "", "whether a roadside unit sees the riders (from 0.5 on)"),
        FamilyParameter("mast_back", 0.0, 0.8, "", "whether one sees those before the second way (from 0.5 on)"),
    )


FAMILIES = (
    ScenarioFamily(
        "side-street-cyclist",
        "CAVs leave a side street across a two-way cycle track; what parks up to the corner hides groups of pedelecs.",
        _CYCLE_PLACES,
        _name_parameters(),
        partial(
            stage_riders,
            RiderKind(
                "bicycle",
                DELIVERING,
                PARKED,
                _MINOR,
            ),
        ),
    ),
    ScenarioFamily(
        "cycle-crossing",
        "CAVs on a main street meet groups of pedelecs on a crossing right behind lorries that park there.",
        _MAIN_PLACES,
        _name_parameters(),
        partial(
            stage_riders,
            RiderKind(
                "bicycle",
                DELIVERING,
                PARKED,
                ("priority-road",),
            ),
        ),
    ),
    ScenarioFamily(
        "standing-bus",
        "Groups of pedelecs cross in front of buses that stand in the right one of two lanes.",
        _TWO_LANES,
        _name_parameters(),
        partial(
            stage_riders,
            RiderKind(
                "bicycle",
                BUSES,
                BUSES,
                ("priority-road",),
                beside_lane=True,
            ),
        ),
    ),
    ScenarioFamily(
        "country-cycle-track",
        "CAVs of a minor country road cross the cycle track beside a main one behind parked lorries.",
        _COUNTRY,
        _name_parameters(),
        partial(
            stage_riders,
            RiderKind("bicycle", DELIVERING, PARKED, _MINOR),
        ),
    ),
    ScenarioFamily(
        "pavement-rider",
        "CAVs of quiet streets cross a pavement on which groups of e-scooters come behind parked vans.",
        _QUIET,
        _name_parameters(riding=SCOOTER_MPS, wall_m=(0.8, 1.6)),
        partial(
            stage_riders,
            RiderKind("e-scooter", DELIVERING, PARKED, _MINOR),
        ),
    ),
)
