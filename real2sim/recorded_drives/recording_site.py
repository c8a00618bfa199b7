"""RecordingSite: a drawn place of a city with two road-side units, and how many road users there are."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import count
from pathlib import Path

from mdrive_sumo.core.geometry import wrap_angle
from mdrive_sumo.roads import load_road_map
from mdrive_sumo.worlds.places import check_place, draw_place, write_place
from mdrive_sumo.worlds.places.place_parameters import Value
from real2sim.recorded_drives.roadside_poses import KerbSide, compute_walking_pose, find_kerb_sides
from real2sim.recorded_drives.scripted_people import PopulationCounts

PLACES: Sequence[tuple[str, dict[str, Value]]] = (
    (
        "crossing",
        {"arms": 4, "control": "signals", "program": "permitted", "zebras": True, "main_lanes": 2, "beside": "parking"},
    ),
    ("corridor", {"junctions": 1, "lanes": 1, "signals": "all", "has_cycle_lanes": False, "parking": "both_sides"}),
    (
        "crossing",
        {
            "arms": 4,
            "control": "signals",
            "program": "permitted",
            "zebras": True,
            "main_lanes": 1,
            "beside": "cycle_lanes",
        },
    ),
    ("corridor", {"junctions": 2, "lanes": 1, "signals": "all", "has_cycle_lanes": True, "parking": "none"}),
    (
        "crossing",
        {"arms": 3, "control": "signals", "program": "permitted", "zebras": True, "main_lanes": 2, "beside": "parking"},
    ),
    ("corridor", {"junctions": 1, "lanes": 2, "signals": "all", "has_cycle_lanes": False, "parking": "one_side"}),
    (
        "crossing",
        {"arms": 4, "control": "signals", "program": "permitted", "zebras": True, "main_lanes": 1, "beside": "parking"},
    ),
    ("corridor", {"junctions": 2, "lanes": 2, "signals": "all", "has_cycle_lanes": False, "parking": "both_sides"}),
)
"""Eight places of a season: signals everywhere, half of them crossings, half of them streets."""
VEHICLES = 34
"""Three quarters of them at the start; the others enter within 20 s."""
PEOPLE = PopulationCounts(walkers=21, waiting=5, crossing=7, cyclists=5, parked=26)
"""With the vehicles that are seen, about the 84 road users of the paper."""
STATION_ASIDE = 0.9
"""Road-side units stand on the pavement at the houses."""
APART_RAD = 0.8
"""[rad] Least angle between the roads at which the two units stand."""


@dataclass(frozen=True)
class RecordingSite:
    """A network with its stations and traffic density."""

    network: Path
    """Folder of the network."""
    stations: tuple[tuple[float, float], ...]
    """x, y [m]"""
    vehicles: int
    people: PopulationCounts


def draw_sites(seed: str, folder: Path) -> list[RecordingSite]:
    """Draw the places of a season into folders below `folder`. Raises InputError without netconvert."""
    return [_draw_site(kind, parameters, f"{seed}-{n}", folder) for n, (kind, parameters) in enumerate(PLACES)]


def _draw_site(kind: str, parameters: dict[str, Value], seed: str, folder: Path) -> RecordingSite:
    """Draw places until one is sound and has signals, crossings and pavements."""
    for number in count():
        place = draw_place(kind, f"{seed}-{number}", **parameters)
        roads = load_road_map(write_place(place, folder / place.name))
        sides = find_kerb_sides(roads)
        stations = tuple(_list_stations(sides))
        if not check_place(roads) and roads.crossings and len(stations) == 2:
            return RecordingSite(roads.folder, stations, VEHICLES, PEOPLE)
    raise AssertionError("unreachable")


def _list_stations(sides: Sequence[KerbSide]) -> Iterator[tuple[float, float]]:
    """Yield a pose at the end of the first lane that leads to lights, and one on a road at an angle to it."""
    lit = [side for side in sides if side.lane.lights]
    first = next(iter(lit), None)
    if first is None:
        return
    yield _compute_station(first)
    yaw = first.lane.centre.yaw_at(first.lane.centre.length)
    for other in lit:
        if abs(wrap_angle(other.lane.centre.yaw_at(other.lane.centre.length) - yaw)) > APART_RAD:
            yield _compute_station(other)
            return


def _compute_station(side: KerbSide) -> tuple[float, float]:
    pose = compute_walking_pose(side, side.lane.centre.length - 1.0, STATION_ASIDE)
    return pose.x, pose.y
