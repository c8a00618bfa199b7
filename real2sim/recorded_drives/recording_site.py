"""RecordingSite: a drawn place of a season, and how much traffic it has."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path

from mdrive_sumo.generate.drawn_places import PlaceChoice
from mdrive_sumo.roads import load_road_map
from mdrive_sumo.worlds.places import check_place, draw_place, write_place
from mdrive_sumo.worlds.traffic import find_demand
from mdrive_sumo.worlds.traffic.traffic_demand import TrafficDemand

_SIGNALS = {"control": "signals", "program": "permitted", "zebras": True}
_ROWS = {"parking": "both_sides"}
PLACES: Sequence[tuple[str, PlaceChoice, str]] = (
    ("signalled", PlaceChoice("crossing", {"arms": 4, "main_lanes": 2, "beside": "parking", **_SIGNALS}), "town-busy"),
    ("signalled", PlaceChoice("crossing", {"arms": 4, "main_lanes": 1, "beside": "parking", **_SIGNALS}), "town-busy"),
    ("signalled", PlaceChoice("corridor", {"junctions": 1, "lanes": 1, "signals": "all"}), "town-busy"),
    ("signalled", PlaceChoice("arterial", {"junctions": 1, "lanes": 2}), "arterial"),
    ("unsignalled", PlaceChoice("crossing", {"arms": 3, "control": "priority", "main_lanes": 1}), "town-busy"),
    ("unsignalled", PlaceChoice("crossing", {"arms": 4, "control": "stop", "main_lanes": 1}), "town-busy"),
    ("unsignalled", PlaceChoice("crossing", {"arms": 4, "control": "right_before_left"}), "town-busy"),
    ("unsignalled", PlaceChoice("corridor", {"junctions": 1, "lanes": 1, "signals": "none"}), "town-busy"),
    ("unsignalled", PlaceChoice("crossing", {"area": "old_town", "arms": 4, "control": "priority"}), "old-town"),
    ("mid-block", PlaceChoice("corridor", {"junctions": 0, "lanes": 1, "zebras": 1, **_ROWS}), "town-busy"),
    ("mid-block", PlaceChoice("corridor", {"junctions": 0, "lanes": 2, **_ROWS}), "town-busy"),
    ("campus", PlaceChoice("residential_street", {"junctions": 1, **_ROWS}), "town-quiet"),
    ("campus", PlaceChoice("town_block", {"columns": 2, "rows": 1, "control": "right_before_left"}), "town-busy"),
    ("campus", PlaceChoice("driveways", {"driveways": 3}), "town-quiet"),
    ("roundabout", PlaceChoice("roundabout", {"arms": 4, "lanes": 1}), "town-busy"),
)  # fmt: skip
"""Setting, kind of place and demand of the places of a season."""
DRAWN_OF_EACH = 2
"""Places of each of these: intervals are over places."""
COUNTS: Mapping[str, int] = {"most_vehicles": 38, "most_people": 54, "most_parked": 52}
"""What an observer sees of them is about the 84 road users of the paper."""
RATES: Mapping[str, float] = {"crossers_per_zebra": 2.0, "pull_out_share": 0.3, "deliveries_per_km": 2.0}


@dataclass(frozen=True)
class RecordingSite:
    """A network with its traffic."""

    network: Path
    """Folder of the network."""
    setting: str
    """Signalled, unsignalled, mid-block, campus or roundabout."""
    demand: str
    """Name of the demand that `build_demand` adapts."""


def draw_sites(seed: str, folder: Path) -> list[RecordingSite]:
    """Draw the places of a season into folders below `folder`. Raises InputError without netconvert."""
    return [_draw_site(number, f"{seed}-{number}", folder) for number in range(DRAWN_OF_EACH * len(PLACES))]


def _draw_site(index: int, seed: str, folder: Path) -> RecordingSite:
    """Draw places until one is sound."""
    setting, choice, demand = PLACES[index % len(PLACES)]
    for number in count():
        place = draw_place(choice.kind, f"{seed}-{number}", **choice.parameters)
        roads = load_road_map(write_place(place, folder / place.name))
        if not check_place(roads):
            return RecordingSite(roads.folder, setting, demand)
    raise AssertionError("unreachable")


def build_demand(name: str) -> TrafficDemand:
    """Return the named demand with the numbers of road users and the events of a recording."""
    demand = find_demand(name)
    walkers = max(demand.walkers_per_km, 45.0)
    return replace(demand, walkers_per_km=walkers, cyclists_per_km=12.0, fronts=1.5, **COUNTS, **RATES)  # pyright: ignore[reportArgumentType]
