"""Exit of a side street across a pavement on which a fast cyclist comes from behind the corner house.

Cyclists of 6 to 9 m/s ride pedelecs.
"""

from dataclasses import dataclass

from mdrive_sumo.generate.hard.blind_crossing import STREAMS_BY_NETWORK
from mdrive_sumo.generate.hard.family import FamilyParameter, FamilyScene, ScenarioFamily, Values, load_network
from mdrive_sumo.generate.hard.family_streets import CORRIDORS
from mdrive_sumo.roads import RoadMap, find_lane_path
from mdrive_sumo.scenario.scenario import Ego
from mdrive_sumo.scenario.scripted_actor import Actor
from mdrive_sumo.worlds.placement.bodies import BODIES, build_mast, build_rider
from mdrive_sumo.worlds.placement.cavs import build_platoon
from mdrive_sumo.worlds.placement.lane_chains import (
    Lanes,
    build_pose_line,
    compute_chain_length,
    compute_pose,
    find_station,
    find_station_beside,
)
from mdrive_sumo.worlds.streams.edge_streams import TrafficStream, build_traffic


@dataclass(frozen=True, slots=True)
class _Street:
    """A side street that leads to a pavement, and the street beyond it."""

    network: str
    own: tuple[str, str]
    """First and last lane of CAV 0."""
    near: tuple[str, str]
    """First and last lane of the rightmost lane of the street, on the side of the side street."""
    far: tuple[str, str]
    """Those of the leftmost lane of the other direction."""
    house_m: float
    """[m] From the centre of the near lane to the houses."""
    mean_speed: float
    """[m/s] Of CAV 0 until the pavement."""
    streams: tuple[TrafficStream, ...]


def _build_corridor_street(index: int, entry: str, direction: str, junction: int) -> _Street:
    """Return a side street of a corridor from which CAV 0 turns right."""
    corridor, other = CORRIDORS[index], "west" if direction == "east" else "east"
    begin, end = (0, corridor.junctions) if direction == "east" else (corridor.junctions, 0)
    out = min(junction + 1, end) if direction == "east" else max(junction - 2, end)
    near, far = corridor.lanes[0], corridor.lanes[-1]
    return _Street(
        corridor.network,
        (entry, f"{direction}_{out}_{near}"),
        (f"{direction}_{begin}_{near}", f"{direction}_{end}_{near}"),
        (f"{other}_{end}_{far}", f"{other}_{begin}_{far}"),
        7.0,
        8.0,
        corridor.all_streams,
    )


ALLEY = _Street(
    "hard_blind_crossing",
    ("south_1_in_0", "north_1_out_0"),
    ("east_0_1", "east_1_1"),
    ("west_1_1", "west_0_1"),
    3.275,
    12.0,
    STREAMS_BY_NETWORK["hard_blind_crossing"],
)
"""A one-way street that CAV 0 leaves straight on, between houses at the pavement."""
SITES = (
    ALLEY,
    _build_corridor_street(0, "south_2_in_1", "east", 2),
    ALLEY,
    _build_corridor_street(1, "south_1_in_1", "east", 1),
    ALLEY,
    _build_corridor_street(1, "north_3_in_1", "west", 3),
)
"""None has a light. Every second one is the alley: in a curve a CAV is so slow that it stops within a metre."""
BEYOND_M = 18.0
"""[m] The cyclist's path goes on this far beyond the side street."""
STEP_M = 3.0


@dataclass(frozen=True, slots=True)
class _Exit:
    """The side street of a candidate."""

    roads: RoadMap
    own: Lanes
    near: Lanes
    """The rightmost lane of the main street, on the side of the side street."""
    far: Lanes
    """The leftmost lane of the other direction."""
    own_m: float
    """Stations [m] of the place where the paths of CAV 0 and of the cyclist cross, on `own` and on `near`."""
    near_m: float
    ride_m: float
    """[m] From the centre of `near` to the cyclist's path."""


def _find_exit(street: _Street, wall_m: float) -> _Exit:
    roads = load_network(street.network)
    own, near, far = (find_lane_path(roads, *ends) for ends in (street.own, street.near, street.far))
    ride_m = street.house_m - wall_m
    entry = roads.lanes[street.own[0]].centre
    mouth = find_station(roads, near, *entry.xy[-1])
    stations = [mouth + STEP_M * k for k in range(-6, 7)]
    ride = build_pose_line([compute_pose(roads, near, s, -ride_m) for s in stations])
    drive = build_pose_line([compute_pose(roads, own, entry.length - 8.0 + k) for k in range(24)])
    met = ride.intersection(drive).centroid
    return _Exit(
        roads, own, near, far, find_station(roads, own, met.x, met.y), find_station(roads, near, met.x, met.y), ride_m
    )


def stage_side_street_cyclist(values: Values, seed: str) -> FamilyScene:
    """Return the scene of a candidate: CAV 0 leaves the side street, CAV 1 on the main street sees the cyclist."""
    street = SITES[min(int(values["site"]), len(SITES) - 1)]
    found = _find_exit(street, values["wall_m"])
    roads = found.roads
    start = max(found.own_m - values["own_m"], 3.0)
    goal = min(found.own_m + 70.0, compute_chain_length(roads, found.own) - 3.0)
    needed_s = max((found.own_m - start) / street.mean_speed + values["gap_s"], 1.0)
    cyclists = [
        _build_cyclist(found, f"cyclist{k}", needed_s + k * values["headway_s"], values)
        for k in range(round(values["cyclists"]))
    ]
    witnesses = 0 if values["mast"] >= 0.5 else 1
    own, *names = (str(k) for k in range(round(values["cavs"])))
    line = build_platoon(roads, [own, *names[witnesses:]], found.own, (start, 18.0), (goal, values["own_speed"]))
    egos = (*line, *_build_on_main(found, names[:witnesses], values["witness_m"]))
    vehicles = build_traffic(roads, street.streams, round(values["vehicles"]), seed, egos)
    mast = build_mast("mast", compute_pose(roads, found.near, found.near_m, 12.0))
    rsus = (mast,) if values["mast"] >= 0.5 else ()
    return FamilyScene(roads, egos, vehicles, tuple(cyclists), rsus, street is not ALLEY)


def _build_cyclist(found: _Exit, name: str, needed_s: float, values: Values) -> Actor:
    """Return a cyclist who rides on the pavement from the start on and reaches the crossing after `needed_s`."""
    speed = values["cycling_speed"]
    sign = -1.0 if values["from_right"] >= 0.5 else 1.0
    count = int((speed * needed_s + BEYOND_M) / STEP_M) + 2
    begin = found.near_m - sign * speed * needed_s
    ends = 1.0, compute_chain_length(found.roads, found.near) - 1.0
    stations = [s for s in (begin + sign * STEP_M * k for k in range(count)) if ends[0] <= s <= ends[1]]
    poses = [compute_pose(found.roads, found.near, station, -found.ride_m) for station in stations]
    return build_rider(name, BODIES["bicycle"], poses, round(speed, 2))


def _build_on_main(found: _Exit, names: list[str], witness_m: float) -> list[Ego]:
    """Return CAVs on the far side of the main street, the first `witness_m` before the side street."""
    beside = find_station_beside(found.roads, found.far, found.near, found.near_m)
    front = max(beside - witness_m, 3.0)
    goal = min(beside + 60.0, compute_chain_length(found.roads, found.far) - 3.0)
    return build_platoon(found.roads, names, found.far, (front, 24.0), (goal, 10.0))


FAMILY = ScenarioFamily(
    category="side-street-cyclist",
    description="Exit of a side street across a pavement with a fast cyclist behind the corner house.",
    parameters=(
        FamilyParameter("site", 0.0, float(len(SITES)), "", "side street"),
        FamilyParameter("own_m", 40.0, 100.0, "m", "distance of CAV 0 from the cyclist's path"),
        FamilyParameter("own_speed", 7.0, 14.0, "m/s", "start speed of CAV 0"),
        FamilyParameter("gap_s", -2.0, 2.0, "s", "how much later than CAV 0 the cyclist reaches the crossing"),
        FamilyParameter("cycling_speed", 6.0, 9.0, "m/s", "speed of the cyclist"),
        FamilyParameter("wall_m", 0.6, 1.2, "m", "distance of the cyclist's path from the houses"),
        FamilyParameter("from_right", 0.0, 1.0, "", "whether the cyclist comes from the right (from 0.5 on)"),
        FamilyParameter("witness_m", 20.0, 110.0, "m", "distance of the first CAV on the main street"),
        FamilyParameter(
            "mast", 0.0, 1.0, "", "whether a roadside unit across the street sees the cyclists (from 0.5 on), or a CAV"
        ),
        FamilyParameter("cyclists", 1.0, 4.0, "", "number of cyclists, rounded"),
        FamilyParameter("headway_s", 1.0, 3.0, "s", "time between two cyclists"),
        FamilyParameter("cavs", 2.0, 8.0, "", "number of CAVs"),
        FamilyParameter("vehicles", 0.0, 100.0, "", "number of reactive vehicles"),
    ),
    stage=stage_side_street_cyclist,
)
