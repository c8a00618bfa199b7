"""Draws the road users of a world beside its CAVs, on any network."""

import random
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import count
from typing import TypeVar

from mdrive_sumo.core import portable
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.background import BackgroundVehicle
from mdrive_sumo.scenario.scenario import Ego
from mdrive_sumo.scenario.scripted_actor import Actor
from mdrive_sumo.worlds.placement.bodies import build_parked_vehicle
from mdrive_sumo.worlds.traffic.cyclists import draw_cyclists
from mdrive_sumo.worlds.traffic.door_openers import draw_door_openers
from mdrive_sumo.worlds.traffic.driving_vehicles import draw_entering, draw_present
from mdrive_sumo.worlds.traffic.occupancy import TakenGround
from mdrive_sumo.worlds.traffic.parked_streets import ParkedPlace, draw_parked, draw_pull_outs
from mdrive_sumo.worlds.traffic.people import draw_people
from mdrive_sumo.worlds.traffic.stopping_vehicles import draw_buses, draw_deliveries
from mdrive_sumo.worlds.traffic.traffic_demand import TrafficDemand

T = TypeVar("T")
METRES_PER_S = 10.0
"""[m/s] What comes a second later is as remote as what is this far away: about the speed of traffic in a town."""


@dataclass(frozen=True, slots=True)
class Traffic:
    """Road users beside the CAVs."""

    vehicles: tuple[BackgroundVehicle, ...]
    """Driven by SUMO; ids "bg0", "bg1" ..."""
    actors: tuple[Actor, ...]
    """Scripted: those that were given, and what was drawn."""


def draw_traffic(
    roads: RoadMap, egos: Sequence[Ego], actors: Sequence[Actor], demand: TrafficDemand, rng: random.Random
) -> Traffic:
    """Return the traffic of a scenario: the given actors, and around them and the CAVs what the demand wants.

    Nothing overlaps at the start. The same arguments give the same traffic on every machine.
    """
    seed, taken = rng.getrandbits(64), TakenGround(egos, actors)

    def branch(name: str) -> random.Random:
        """Return random numbers of their own for each part: one part more changes no other."""
        return random.Random(f"{seed}/{name}")

    places = _select_nearest(draw_parked(roads, demand, taken, branch("parked")), egos, demand.most_parked, _at_place)
    doors = list(draw_door_openers(roads, places, demand, taken, branch("doors")))
    leaving = draw_pull_outs(roads, places, demand, taken, branch("pull-outs"))
    vehicles = [
        *leaving.values(),
        *draw_buses(roads, demand, taken, branch("buses")),
        *draw_deliveries(roads, demand, taken, branch("deliveries")),
        *draw_present(roads, demand, taken, branch("present")),
        *draw_cyclists(roads, demand, taken, branch("cyclists")),
        *sorted(draw_entering(roads, demand, taken, branch("entering")), key=lambda one: (one.depart_s, one.edges)),
    ]
    kept = _select_nearest(vehicles, egos, demand.most_vehicles, lambda one: _at_departure(roads, one))
    lost = {k for k, vehicle in leaving.items() if not any(vehicle is one for one in kept)}
    parked = [
        build_parked_vehicle("parked", place.model, place.pose, mirrored=False)
        for k, place in enumerate(places)
        if k not in leaving or k in lost
    ]
    blocked = _find_blocked_pavements(roads, places)
    people = list(draw_people(roads, demand, taken, blocked, branch("people")))
    near = _select_nearest(people, egos, demand.most_people, lambda one: (one.start.x, one.start.y, 0.0))
    return Traffic(
        tuple(one.model_copy(update={"id": f"bg{k}"}) for k, one in enumerate(kept)),
        (*actors, *_number((*parked, *doors, *near), {actor.id for actor in actors})),
    )


def _at_place(place: ParkedPlace) -> tuple[float, float, float]:
    return place.pose.x, place.pose.y, 0.0


def _at_departure(roads: RoadMap, vehicle: BackgroundVehicle) -> tuple[float, float, float]:
    name = f"{vehicle.edges[0]}_{vehicle.depart_lane}"
    lane = roads.lanes.get(name) or roads.cycle_lanes[name]
    return *lane.centre.at(vehicle.depart_pos_m), vehicle.depart_s


def _select_nearest(
    users: Sequence[T], egos: Sequence[Ego], most: int, locate: Callable[[T], tuple[float, float, float]]
) -> list[T]:
    """Return at most `most` road users, in their order: those that start nearest to a CAV and earliest.

    `locate`: x, y [m] and time [s] of a start. Without CAVs the first ones.
    """
    if len(users) <= most or not egos:
        return list(users[:most])
    starts = [(ego.start.x, ego.start.y) for ego in egos]
    remoteness: list[tuple[float, int]] = []
    for k, user in enumerate(users):
        x, y, start_s = locate(user)
        away = min(portable.hypot(x - x0, y - y0) for x0, y0 in starts)
        remoteness.append((away + METRES_PER_S * start_s, k))
    return [users[k] for k in sorted(k for _, k in sorted(remoteness)[:most])]


def _find_blocked_pavements(roads: RoadMap, places: Iterable[ParkedPlace]) -> frozenset[str]:
    """Return the edges whose pavement parked vehicles stand on: those of networks without parking rows."""
    if roads.parking:
        return frozenset()
    return frozenset(roads.lanes[place.lane].edge for place in places if place.lane)


def _number(actors: Iterable[Actor], used: set[str]) -> list[Actor]:
    """Return the actors with a number after what they are, no id twice."""
    numbers: dict[str, count[int]] = {}
    numbered: list[Actor] = []
    for actor in actors:
        counter = numbers.setdefault(actor.id, count())
        name = next(name for k in counter if (name := f"{actor.id}{k}") not in used)
        numbered.append(actor.model_copy(update={"id": name}))
    return numbered
