"""Exit of a side street across a pavement on which a fast cyclist comes from behind the corner house."""

from dataclasses import dataclass

import shapely

from mdrive_sumo.generate.hard.family import FamilyCandidate, FamilyParameter, ScenarioFamily
from mdrive_sumo.generate.hard.family_parts import (
    WALKER_SIZES,
    FamilyTraffic,
    Lanes,
    build_cav,
    build_platoon,
    build_scenario,
    compute_chain_length,
    compute_pose,
    find_station,
    load_network,
    read_values,
)
from mdrive_sumo.generate.hard.family_streets import CORRIDORS
from mdrive_sumo.generate.hard.family_traffic import build_traffic
from mdrive_sumo.roads import RoadMap, find_lane_path
from mdrive_sumo.scenario.scenario import Ego, RoadsideUnit, Scenario
from mdrive_sumo.scenario.scripted_actor import Actor, PathMotion

SITES = (
    (0, "south_2_in_1", "east", 2),
    (0, "north_4_in_1", "west", 4),
    (1, "south_1_in_1", "east", 1),
    (1, "north_1_in_1", "west", 1),
    (1, "south_3_in_1", "east", 3),
    (1, "north_3_in_1", "west", 3),
)
"""Corridor, lane of CAV 0, direction of traffic on the near lanes, junction. None has a light."""
MEAN_SPEED = 8.0
"""[m/s] Of a CAV that slows down for the turn."""
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


def _find_exit(site: float, ride_m: float) -> _Exit:
    index, entry, direction, junction = SITES[min(int(site), len(SITES) - 1)]
    corridor = CORRIDORS[index]
    roads, other = load_network(corridor.network), "west" if direction == "east" else "east"
    near = corridor.find_chain(roads, direction, corridor.lanes[0])
    far = corridor.find_chain(roads, other, corridor.lanes[-1])
    out = min(junction + 1, corridor.junctions) if direction == "east" else max(junction - 2, 0)
    own = find_lane_path(roads, entry, f"{direction}_{out}_{corridor.lanes[0]}")
    mouth = find_station(roads, near, *roads.lanes[entry].centre.xy[-1])
    stations = [mouth + STEP_M * k for k in range(-6, 7)]
    ride = shapely.LineString([(p.x, p.y) for p in (compute_pose(roads, near, s, -ride_m) for s in stations)])
    end = roads.lanes[entry].centre.length
    drive = shapely.LineString([(p.x, p.y) for p in (compute_pose(roads, own, end - 8.0 + k) for k in range(24))])
    met = ride.intersection(drive).centroid
    return _Exit(
        roads, own, near, far, find_station(roads, own, met.x, met.y), find_station(roads, near, met.x, met.y), ride_m
    )


def build_side_street_cyclist(candidate: FamilyCandidate) -> Scenario:
    """Return the scenario of a candidate: CAV 0 leaves the side street, CAV 1 on the main street sees the cyclist."""
    values = read_values(FAMILY, candidate)
    found = _find_exit(values["site"], values["ride_m"])
    roads = found.roads
    start = max(found.own_m - values["own_m"], 3.0)
    goal = min(found.own_m + 70.0, compute_chain_length(roads, found.own) - 3.0)
    own = build_cav(roads, "0", found.own, start, goal, values["own_speed"])
    needed_s = max((found.own_m - start) / MEAN_SPEED + values["gap_s"], 1.0)
    cyclist = _build_cyclist(found, needed_s, values["cycling_speed"], values["from_right"] >= 0.5)
    count = round(values["cavs"]) - 1
    behind = build_platoon(
        roads, [str(k + 2) for k in range(count - 1)][::2], found.own, (start - 18.0, 18.0), (goal, values["own_speed"])
    )
    egos = (own, *behind, *_build_on_main(found, [str(k + 1) for k in range(count)][::2], values["witness_m"]))
    streams = CORRIDORS[SITES[min(int(values["site"]), len(SITES) - 1)][0]].all_streams
    vehicles = build_traffic(roads, streams, round(values["vehicles"]), candidate.seed, egos)
    pose = compute_pose(roads, found.near, found.near_m, 12.0)
    rsus = (RoadsideUnit(id="mast", x=pose.x, y=pose.y),) if values["mast"] >= 0.5 else ()
    return build_scenario(FAMILY, candidate, roads, egos, FamilyTraffic(vehicles, (cyclist,), rsus, signals=True))


def _build_cyclist(found: _Exit, needed_s: float, speed: float, from_right: bool) -> Actor:
    """Return a cyclist who rides on the pavement from the start on and reaches the crossing after `needed_s`."""
    sign = -1.0 if from_right else 1.0
    count = int((speed * needed_s + BEYOND_M) / STEP_M) + 2
    begin = found.near_m - sign * speed * needed_s
    ends = 1.0, compute_chain_length(found.roads, found.near) - 1.0
    stations = [s for s in (begin + sign * STEP_M * k for k in range(count)) if ends[0] <= s <= ends[1]]
    poses = [compute_pose(found.roads, found.near, station, -found.ride_m) for station in stations]
    length, width = WALKER_SIZES["cyclist"]
    return Actor(
        id="cyclist",
        kind="cyclist",
        model="bicycle",
        length=length,
        width=width,
        start=poses[0],
        motion=PathMotion(
            points=tuple((pose.x, pose.y) for pose in poses), speed=round(speed, 2), start_speed=round(speed, 2)
        ),
    )


def _build_on_main(found: _Exit, names: list[str], witness_m: float) -> list[Ego]:
    """Return CAVs on the far side of the main street, the first `witness_m` before the side street."""
    pose = compute_pose(found.roads, found.near, found.near_m)
    beside = find_station(found.roads, found.far, pose.x, pose.y)
    front = max(beside - witness_m, 3.0)
    goal = min(beside + 60.0, compute_chain_length(found.roads, found.far) - 3.0)
    return build_platoon(found.roads, names, found.far, (front, 24.0), (goal, 10.0))


FAMILY = ScenarioFamily(
    category="side-street-cyclist",
    description="Exit of a side street across a pavement with a fast cyclist behind the corner house.",
    parameters=(
        FamilyParameter("site", 0.0, float(len(SITES)), "", "side street"),
        FamilyParameter("own_m", 25.0, 75.0, "m", "distance of CAV 0 from the cyclist's path"),
        FamilyParameter("own_speed", 3.0, 12.0, "m/s", "start speed of CAV 0"),
        FamilyParameter("gap_s", -3.0, 4.0, "s", "how much later than CAV 0 the cyclist reaches the crossing"),
        FamilyParameter("cycling_speed", 4.0, 9.0, "m/s", "speed of the cyclist"),
        FamilyParameter("ride_m", 4.8, 6.2, "m", "distance of the cyclist's path from the lane; houses stand at 7 m"),
        FamilyParameter("from_right", 0.0, 1.0, "", "whether the cyclist comes from the right (from 0.5 on)"),
        FamilyParameter("witness_m", 20.0, 110.0, "m", "distance of the first CAV on the main street"),
        FamilyParameter("mast", 0.0, 1.0, "", "whether a roadside unit stands across the street (from 0.5 on)"),
        FamilyParameter("cavs", 2.0, 8.0, "", "number of CAVs"),
        FamilyParameter("vehicles", 0.0, 100.0, "", "number of reactive vehicles"),
    ),
    build=build_side_street_cyclist,
)
