"""Families of step-outs: from parked rows, in front of buses, through queues, on zebra crossings, out of road works."""

import random
from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np

from mdrive_sumo.generate.drawn_places import PlaceChoice
from mdrive_sumo.generate.hard.family import FamilyParameter, ScenarioFamily, Values
from mdrive_sumo.generate.hard.sites.street_ways import (
    find_kerbs,
    find_obstacles_beside,
    find_right_lanes,
    find_zebras,
)
from mdrive_sumo.generate.hard.step_outs import (
    ABREAST_M,
    FAR_M,
    Exit,
    Side,
    StepOutKind,
    change_bounds,
    measure_other,
    stage_step_outs,
)
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scripted_actor import Actor
from mdrive_sumo.worlds.placement.bodies import BODIES, BODY_SIZES, build_parked_vehicle
from mdrive_sumo.worlds.placement.lane_chains import (
    Lanes,
    compute_chain_length,
    compute_pose,
    find_station_beside,
)
from mdrive_sumo.worlds.placement.parked_vehicles import WALK_GAP_M, FreePlace, ParkedRow, build_kerbside

STEP_M = 4.0
"""[m] Distance of the exits among which a family chooses."""
HALF_M = BODIES["adult"].width / 2
"""[m] Half of a person, from its way to what hides it."""
FRONT_M = 0.6
"""[m] From a standing vehicle to the middle of someone who passes its front."""
KERB_M = 0.2
"""[m] From the edge of the lane to a van that stands at the kerb."""
QUEUE_GAP_M = 2.0
"""[m] Between standing vehicles of a queue (SUMO's drivers keep 2.5 m)."""
QUEUE_M = 75.0
"""[m] Length of a queue before and behind the first and the last exit."""


def _find_row_exits(roads: RoadMap, lanes: Lanes, other: Lanes, values: Values) -> list[Exit]:
    """Return free places in parked rows, each with room for the van that hides people before it."""
    del other
    exits: list[Exit] = []
    for kerb in find_kerbs(roads, lanes):
        stations = np.arange(kerb.begin + BODY_SIZES["van"][0] + 1.0, kerb.end - values["free_m"] / 2, STEP_M)
        aside = kerb.offset - values["run_up_m"]
        exits += [Exit(station, aside, row=kerb.offset) for station in stations.tolist()]
    return exits


def _build_rows(roads: RoadMap, sides: Sequence[Side], values: Values, seed: str) -> list[Actor]:
    """Return the parked rows of the sides with CAVs, without the exits and the places to which people go."""
    made: list[Actor] = []
    free = values["free_m"] + (round(values["people"]) - 1) * ABREAST_M
    for k, side in enumerate(sides):
        places = [FreePlace(one.station - HALF_M, one.station + free, "van") for one in side.exits]
        for other in (*sides[:k], *sides[k + 1 :]):
            at = [find_station_beside(roads, side.lanes, other.lanes, one.station) for one in other.exits]
            places += [FreePlace(one - free - HALF_M, one + HALF_M + WALK_GAP_M, "") for one in at]
        kerbs = find_kerbs(roads, side.lanes)
        rows = [ParkedRow(side.lanes, (one.begin, one.end), one.offset, values["vans"]) for one in kerbs]
        made += build_kerbside(roads, rows, places, f"{seed}/{k}", f"parked{k}_")
    return made


def _find_bus_exits(roads: RoadMap, lanes: Lanes, other: Lanes, values: Values) -> list[Exit]:
    """Return places in front of vehicles that stand in the right lane beside a way."""
    del other
    exits: list[Exit] = []
    for kerb in find_right_lanes(roads, lanes):
        stations = np.arange(kerb.begin + BODY_SIZES["bus"][0] + 1.0, kerb.end, STEP_M)
        aside = kerb.offset - values["run_up_m"]
        exits += [Exit(station, aside, row=kerb.offset) for station in stations.tolist()]
    return exits


def _build_buses(roads: RoadMap, sides: Sequence[Side], values: Values, seed: str) -> list[Actor]:
    """Return the vehicles that stand in the right lane, one before each exit."""
    rng = random.Random(f"{seed}/standing")
    made: list[Actor] = []
    for side in sides:
        for one in side.exits:
            model = rng.choice(("bus", "truck")) if rng.random() < values["vans"] else "van"
            middle = one.station - FRONT_M - BODY_SIZES[model][0] / 2
            pose = compute_pose(roads, side.lanes, middle, one.row)
            made.append(build_parked_vehicle(f"standing{len(made)}", model, pose))
    return made


def _find_queue_exits(roads: RoadMap, lanes: Lanes, other: Lanes, values: Values) -> list[Exit]:
    """Return places beside a queue of the other direction; people come from the far kerb."""
    exits: list[Exit] = []
    if not other:
        return exits
    for station in np.arange(20.0, compute_chain_length(roads, lanes) - 20.0, STEP_M).tolist():
        away = measure_other(roads, lanes, other, station)
        if 2.0 < away < 6.0 and not _is_inside(roads, lanes, station):
            exits.append(Exit(station, away + values["run_up_m"], -FAR_M, away))
    return exits


def _is_inside(roads: RoadMap, lanes: Lanes, station: float) -> bool:
    """Return whether a station of a chain lies in a junction or close to one."""
    pose = compute_pose(roads, lanes, station)
    near = roads.find_lanes_near(pose.x, pose.y, 4.0)
    return any(lane.junction for lane in near)


def _build_queue(roads: RoadMap, sides: Sequence[Side], values: Values, seed: str) -> list[Actor]:
    """Return the queue of the other direction; people come out before the front of a van or lorry, seen from CAVs."""
    rng = random.Random(f"{seed}/queue")
    made: list[Actor] = []
    for side in sides:
        exits = sorted(side.exits, key=lambda one: one.station)
        station = exits[0].station - QUEUE_M / 2
        for one in [*exits, None]:
            end = exits[-1].station + QUEUE_M if one is None else one.station - FRONT_M
            row = exits[-1].row if one is None else one.row
            vehicles = list(_fill_back(station, end, values["vans"], rng))
            for middle, model in vehicles:
                pose = compute_pose(roads, side.lanes, middle, row)
                turned = pose.model_copy(update={"yaw": round(_turn_round(pose.yaw), 4)})
                if not _is_inside(roads, side.lanes, middle):
                    made.append(build_parked_vehicle(f"queue{len(made)}", model, turned))
            station = end + FRONT_M + max(values["free_m"] / 2, 1.0)
    return made


def _turn_round(yaw: float) -> float:
    return yaw - np.pi if yaw > 0.0 else yaw + np.pi


def _fill_back(begin: float, end: float, share: float, rng: random.Random) -> Iterator[tuple[float, str]]:
    """Return stations [m] and models of standing vehicles from an end back; the last one hides the most."""
    model = "van"
    while end - BODY_SIZES[model][0] >= begin:
        yield end - BODY_SIZES[model][0] / 2, model
        end -= BODY_SIZES[model][0] + QUEUE_GAP_M
        model = rng.choice(("van", "truck")) if rng.random() < share else "car"


def _find_zebra_exits(roads: RoadMap, lanes: Lanes, other: Lanes, values: Values) -> list[Exit]:
    """Return the pedestrian crossings of a way; people come from the right."""
    del other
    half = roads.lanes[lanes[0]].width / 2
    aside = -(half + KERB_M + BODY_SIZES["van"][1] / 2)
    return [Exit(station, aside - values["run_up_m"], row=aside) for station in find_zebras(roads, lanes)]


def _build_kerb_vans(roads: RoadMap, sides: Sequence[Side], values: Values, seed: str) -> list[Actor]:
    """Return vans that stand at the kerb just before the exits, where they must not."""
    del seed
    made: list[Actor] = []
    for side in sides:
        for one in side.exits:
            for j in range(1 + (values["vans"] >= 0.5)):
                middle = one.station - values["free_m"] / 2 - FRONT_M - (j + 0.5) * BODY_SIZES["van"][0] - j
                pose = compute_pose(roads, side.lanes, middle, one.row)
                made.append(build_parked_vehicle(f"van{len(made)}", "van", pose, mirrored=False))
    return made


def _find_works_exits(roads: RoadMap, lanes: Lanes, other: Lanes, values: Values) -> list[Exit]:
    """Return the places behind containers and heaps of road works at the right of a way."""
    del other, values
    return [
        Exit(station + FRONT_M, aside, roads.lanes[lanes[0]].width / 2, aside)
        for station, aside in find_obstacles_beside(roads, lanes, ("container", "heap"))
    ]


def _build_nothing(roads: RoadMap, sides: Sequence[Side], values: Values, seed: str) -> list[Actor]:
    del roads, sides, values, seed
    return []


CHILD = StepOutKind(BODIES["adult"], _find_row_exits, _build_rows)
RIDER = StepOutKind(BODIES["e-scooter"], _find_row_exits, _build_rows)
PASSENGER = StepOutKind(BODIES["adult"], _find_bus_exits, _build_buses, is_mirrored=True)
QUEUE = StepOutKind(BODIES["adult"], _find_queue_exits, _build_queue, is_mirrored=True)
ZEBRA = StepOutKind(BODIES["adult"], _find_zebra_exits, _build_kerb_vans)
WORKER = StepOutKind(BODIES["adult"], _find_works_exits, _build_nothing)


def _choose(kind: str, **parameters: str | int | float | bool) -> PlaceChoice:
    return PlaceChoice(kind, parameters)


_PARKED = {"parking": "both_sides", "lanes": 1, "limit_kmh": 50.0, "has_cycle_lanes": False}
PARKED_STREETS = (
    _choose("corridor", **_PARKED),
    _choose("corridor", **_PARKED, keeps_sight=False),
    _choose("residential_street", parking="both_sides", limit_kmh=30.0, lane_m=2.9),
)
TWO_LANES = (
    _choose("arterial", junctions=2, lanes=2, limit_kmh=50.0),
    _choose("corridor", lanes=2, limit_kmh=50.0, signals="some"),
)
PLAIN_STREETS = (
    _choose("corridor", parking="none", lanes=1, limit_kmh=50.0, signals="none", has_cycle_lanes=False),
    _choose("country_road", tracks=1, limit_kmh=60.0, roadside="hamlet"),
    _choose("country_road", tracks=2, limit_kmh=60.0, roadside="open"),
)
ZEBRA_STREETS = (
    _choose("corridor", parking="none", lanes=1, limit_kmh=50.0, zebras=2, signals="none", has_cycle_lanes=False),
    _choose("corridor", parking="none", lanes=1, limit_kmh=50.0, zebras=2, signals="some", has_cycle_lanes=False),
)
WORKS = (
    _choose("works_zone", layout="narrowed", zone_kmh=50.0),
    _choose("works_zone", layout="lane_closed", side="right", zone_kmh=50.0),
)


def _build_family(
    category: str,
    description: str,
    kind: StepOutKind,
    places: tuple[PlaceChoice, ...],
    **bounds: tuple[float, float],
) -> ScenarioFamily:
    parameters: tuple[FamilyParameter, ...] = change_bounds(**bounds)
    return ScenarioFamily(category, description, places, parameters, partial(stage_step_outs, kind))


FAMILIES = (
    _build_family(
        "running-child",
        "Children run from between parked vans, one after the other along a street, each in front of one CAV.",
        CHILD,
        PARKED_STREETS,
    ),
    _build_family(
        "pavement-rider",
        "Riders of e-scooters leave the pavement between parked vans and cross the street, each in front of one CAV.",
        RIDER,
        PARKED_STREETS,
        along_m=(4.0, 14.0),
        walking=(2.8, 4.2),
    ),
    _build_family(
        "standing-bus",
        "People cross in front of buses and lorries that stand in the right lane, each in front of one CAV.",
        PASSENGER,
        TWO_LANES,
        spacing_m=(26.0, 45.0),
        walking=(2.2, 3.4),
        run_up_m=(2.6, 3.4),
        people=(1.0, 3.0),
    ),
    _build_family(
        "queue-crossing",
        "People cross a street through the standing queue of the other direction, each in front of one CAV.",
        QUEUE,
        PLAIN_STREETS,
        oncoming=(0.0, 0.4),
        cavs=(2.0, 5.0),
        exits=(2.0, 5.0),
        walking=(2.0, 3.2),
        run_up_m=(2.0, 3.5),
        along_m=(0.5, 4.0),
    ),
    _build_family(
        "zebra-crossing",
        "People cross on pedestrian crossings just behind vans that stand there, each in front of one CAV.",
        ZEBRA,
        ZEBRA_STREETS,
        people=(1.6, 3.4),
        cavs=(1.6, 2.6),
        oncoming=(1.0, 2.4),
        walking=(2.0, 3.0),
        run_up_m=(1.5, 2.6),
        along_m=(1.0, 5.0),
    ),
    _build_family(
        "works-crossing",
        "Workers cross the lane that is left beside road works, out from behind containers and heaps.",
        WORKER,
        WORKS,
        oncoming=(0.0, 0.4),
        cavs=(2.0, 5.0),
        spacing_m=(8.0, 25.0),
        walking=(1.6, 2.4),
        people=(1.0, 2.0),
        along_m=(0.1, 1.0),
    ),
)
