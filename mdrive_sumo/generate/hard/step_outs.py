"""Scenes in which people run or ride out from behind what stands beside the lane, each in front of one CAV.

A kind of step-out says where people come out along a lane and what stands there; everything else is here: each person
is set off by the place of its CAV and timed such that both meet if the CAV drives on at the limit.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

from mdrive_sumo.core import portable
from mdrive_sumo.generate.hard.family import FamilyParameter, FamilyScene, Values
from mdrive_sumo.generate.hard.sites.junction_conflicts import choose_site
from mdrive_sumo.generate.hard.sites.junction_ways import compute_timing
from mdrive_sumo.generate.hard.sites.street_traffic import build_street_traffic
from mdrive_sumo.generate.hard.sites.street_ways import compute_rise_s, find_street_ways, select_ways
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import Ego, RoadsideUnit
from mdrive_sumo.scenario.scripted_actor import Actor, PositionTrigger, StartMotion
from mdrive_sumo.scenario.start_boxes import CAR
from mdrive_sumo.worlds.placement.bodies import (
    Body,
    build_arrival_trigger,
    build_crossing_actor,
    build_driving_actor,
    build_mast,
)
from mdrive_sumo.worlds.placement.cavs import NoRoomError, Platoon, build_platoons
from mdrive_sumo.worlds.placement.lane_chains import Lanes, compute_pose, find_station, find_station_beside

RIM_M = 4.0
"""[m] No CAV starts nearer to the begin of its way, and no goal lies nearer to the end."""
BEYOND_M = 45.0
"""[m] From the last place where someone steps out to the goals."""
FAR_M = 4.5
"""[m] People stop so far beyond the middle of the last lane that they cross."""
FIRST_M = 40.0
"""[m] Range of the first exit behind the first one possible."""
ABREAST_M = 1.4
"""[m] Between two people at one exit."""
MAST_FROM = 0.4
"""Value of `mast` from which there are roadside units."""
MAST_M = 6.0, 1.2
"""[m] A roadside unit stands so far behind an exit, and so much farther aside than people begin."""
TRIGGER_M = 3.0
"""[m] Radius of the circle at which a CAV sets someone off."""
ACCELERATION = {"pedestrian": 1.5, "cyclist": 1.2, "vehicle": 2.6}
"""[m/s2] Of scripted road users (`actors.kinematic_limits`)."""


@dataclass(frozen=True, slots=True)
class Exit:
    """A place beside a lane where people come out behind what hides them, and cross the lane."""

    station: float
    """[m] Along the way, of the first of them."""
    aside: float
    """[m] To the left of the way where they turn out; negative: to the right."""
    far: float | None = None
    """[m] To the left of the way where they stop; None: beyond the other direction of the street."""
    row: float = 0.0
    """[m] To the left of the way of the middle of the row in which the exit is, if there is one."""
    path: Lanes = ()
    """Lanes out of a driveway or track along which a vehicle comes; () for people."""
    path_m: float = 0.0
    """Station [m] on `path` at which it meets the way."""


@dataclass(frozen=True, slots=True)
class Side:
    """One direction of a street: its way, its exits in driving order, and its CAVs."""

    lanes: Lanes
    exits: tuple[Exit, ...]
    platoon: Platoon


@dataclass(frozen=True, slots=True)
class StepOutKind:
    """Who steps out, where, and what stands there."""

    body: Body
    find_exits: Callable[[RoadMap, Lanes, Lanes, Values], Sequence[Exit]]
    """Return all exits along a chain of lanes, given the chain of the other direction (() without one)."""
    build_standing: Callable[[RoadMap, Sequence[Side], Values, str], Sequence[Actor]]
    """Return what stands at the exits of both directions, by the seed."""
    is_mirrored: bool = False
    """Whether reactive traffic starts clear of what stands: it stands in lanes."""


def _choose_exits(found: Sequence[Exit], values: Values, least: float) -> tuple[Exit, ...]:
    """Return exits from a station [m] on, `spacing_m` or more apart."""
    chosen: list[Exit] = []
    wanted = least + values["first"] * FIRST_M
    for one in found:
        if one.station >= wanted and len(chosen) < round(values["exits"]):
            chosen.append(one)
            wanted = one.station + values["spacing_m"]
    return tuple(chosen)


def _plan_side(roads: RoadMap, kind: StepOutKind, ways: tuple[Lanes, Lanes], count: int, values: Values) -> Side | None:
    """Return a direction of a street whose first CAV reaches its first exit after `arrival_s`; None without exits."""
    lanes, other = ways
    if not lanes or count < 1:
        return None
    timing = compute_timing(roads, lanes)
    speed = round(timing.find_speed(RIM_M) * values["speed"], 2)
    platoon = Platoon(lanes, count, 0.0, 0.0, speed, values["headway_s"])
    least = timing.find_start(RIM_M + (count - 1) * platoon.pitch_m, -values["arrival_s"])
    exits = _choose_exits(kind.find_exits(roads, lanes, other, values), values, least)
    if not exits:
        return None
    exits = tuple(one if one.far is not None else replace(one, far=_find_far(roads, ways, one)) for one in exits)
    lead = timing.find_start(exits[0].station, values["arrival_s"])
    goal = min(exits[-1].station + BEYOND_M, len(timing.time) - 1 - RIM_M)
    return Side(lanes, exits, replace(platoon, lead_m=lead, goal_m=goal))


def _find_far(roads: RoadMap, ways: tuple[Lanes, Lanes], place: Exit) -> float:
    """Return how far [m] to the left of an exit's way people go: beyond the lane of the other direction, if any."""
    return FAR_M + (measure_other(roads, *ways, place.station) if ways[1] else 0.0)


def measure_other(roads: RoadMap, lanes: Lanes, other: Lanes, station: float) -> float:
    """Return how far [m] a station of a chain of lanes lies from that of the other direction."""
    here = compute_pose(roads, lanes, station)
    there = compute_pose(roads, other, find_station_beside(roads, other, lanes, station))
    return portable.hypot(here.x - there.x, here.y - there.y)


def stage_step_outs(kind: StepOutKind, values: Values, seed: str, roads: RoadMap) -> FamilyScene:
    """Return the scene of a candidate. Raises ProposalRejected and NoRoomError."""
    found = {way: kind.find_exits(roads, way.lanes, way.oncoming, values) for way in find_street_ways(roads)}
    ways = select_ways(roads, lambda way: bool(found[way]))
    way = choose_site(ways, values["site"])
    planned = (
        _plan_side(roads, kind, (way.lanes, way.oncoming), round(values["cavs"]), values),
        _plan_side(roads, kind, (way.oncoming, way.lanes), round(values["oncoming"]), values),
    )
    sides = [side for side in planned if side is not None]
    if not sides:
        raise NoRoomError(f"network {roads.name}: expected exits far enough from the starts of CAVs, found none")
    egos = build_platoons(roads, [side.platoon for side in sides])
    people: list[Actor] = []
    masts: list[RoadsideUnit] = []
    for k, side in enumerate(sides):
        first = sum(one.platoon.count for one in sides[:k])
        mine = egos[first : first + side.platoon.count]
        people += _build_people(roads, side, mine, values, kind.body, f"person{k}_")
        masts += [_build_mast(roads, side, i, f"mast{k}_{i}") for i in range(len(side.exits))]
    if not people:
        raise NoRoomError(f"network {roads.name}: expected road users with time to come out, found none")
    standing = kind.build_standing(roads, sides, values, seed)
    clear = (*egos, *people, *standing) if kind.is_mirrored else (*egos, *people)
    vehicles = build_street_traffic(roads, round(values["vehicles"]), seed, clear)
    rsus = tuple(masts) if values["mast"] >= MAST_FROM else ()
    return FamilyScene(egos, vehicles, (*people, *standing), rsus, signals=True)


def _build_people(
    roads: RoadMap, side: Side, egos: Sequence[Ego], values: Values, body: Body, prefix: str
) -> Iterator[Actor]:
    """Return the road users of a direction that come out; those of the first exits are for the first CAVs, by turns."""
    timing = compute_timing(roads, side.lanes)
    abreast = round(values["people"])
    places = [(exit_, number) for exit_ in side.exits for number in range(abreast)]
    for k, (exit_, number) in enumerate(places):
        cav, station = egos[k % len(egos)], exit_.station + number * ABREAST_M
        distance = values["along_m"] + (0.0 if exit_.path else abs(exit_.aside))
        takes_s = compute_rise_s(distance, values["walking"], ACCELERATION[body.kind])
        set_off = timing.find_start(station - CAR.length / 2, takes_s + values["late_s"]) + TRIGGER_M
        along = set_off - find_station(roads, side.lanes, cav.start.x, cav.start.y)
        if along >= TRIGGER_M:
            place = replace(exit_, station=station)
            yield _build_one(
                roads, side.lanes, place, values, (f"{prefix}{k}", body, build_arrival_trigger(cav, along))
            )


def _build_one(
    roads: RoadMap, lanes: Lanes, place: Exit, values: Values, who: tuple[str, Body, PositionTrigger]
) -> Actor:
    """Return who comes out at an exit; who: id, body and trigger."""
    name, body, trigger = who
    speed = round(values["walking"], 2)
    if place.path:
        drive = (place.path, max(place.path_m - values["along_m"], 0.0), speed)
        return build_driving_actor(roads, name, body.model, drive, trigger=trigger, action=StartMotion())
    begin = (place.station - values["along_m"], place.aside)
    stations = (begin, (place.station, place.aside), (place.station, 0.0), (place.station, place.far or 0.0))
    points = [compute_pose(roads, lanes, at, offset) for at, offset in stations]
    return build_crossing_actor(name, body, [(one.x, one.y) for one in points], speed, trigger)


def _build_mast(roads: RoadMap, side: Side, number: int, name: str) -> RoadsideUnit:
    place = side.exits[number]
    if place.path:
        return build_mast(name, compute_pose(roads, place.path, place.path_m, MAST_M[1]))
    outward = MAST_M[1] if place.aside > 0.0 else -MAST_M[1]
    return build_mast(name, compute_pose(roads, side.lanes, place.station + MAST_M[0], place.aside + outward))


PARAMETERS = (
    FamilyParameter("site", 0.0, 1.0, "", "street and direction"),
    FamilyParameter("first", 0.0, 1.0, "", "where the first exit lies, in 40 m"),
    FamilyParameter("exits", 2.0, 4.0, "", "number of exits in each direction, rounded"),
    FamilyParameter("spacing_m", 18.0, 40.0, "m", "least distance of two exits"),
    FamilyParameter("free_m", 2.2, 4.5, "m", "length of the free place at an exit"),
    FamilyParameter("people", 1.0, 2.0, "", "number of people at each, rounded"),
    FamilyParameter("arrival_s", 3.5, 7.0, "s", "time after which the first CAV is due at the first exit"),
    FamilyParameter("speed", 0.85, 1.0, "", "start speed as a share of the limit"),
    FamilyParameter("headway_s", 1.2, 2.4, "s", "time headway of CAVs"),
    FamilyParameter("cavs", 1.5, 3.5, "", "number of CAVs in one direction, rounded"),
    FamilyParameter("oncoming", 1.5, 3.5, "", "number of CAVs in the other direction, rounded"),
    FamilyParameter("along_m", 1.5, 8.0, "m", "how far people run along the street before they turn out"),
    FamilyParameter("run_up_m", 2.0, 3.4, "m", "distance of their way from the middle of what hides them"),
    FamilyParameter("walking", 1.9, 2.9, "m/s", "speed of people"),
    FamilyParameter("late_s", -0.25, 0.3, "s", "how much later than the person the CAV is where both meet"),
    FamilyParameter("vans", 0.2, 0.9, "", "share of vans and lorries among what stands"),
    FamilyParameter("mast", 0.0, 1.0, "", "whether roadside units see the people (from 0.4 on)"),
    FamilyParameter("vehicles", 0.0, 40.0, "", "number of reactive vehicles"),
)


def change_bounds(**bounds: tuple[float, float]) -> tuple[FamilyParameter, ...]:
    """Return the parameters with other bounds by name."""
    return tuple(
        replace(one, low=bounds[one.name][0], high=bounds[one.name][1]) if one.name in bounds else one
        for one in PARAMETERS
    )
