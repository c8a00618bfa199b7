"""Draws the road users of a world beside its CAVs, on any network."""

import random
from collections.abc import Sequence
from dataclasses import dataclass

from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.background import BackgroundVehicle
from mdrive_sumo.scenario.scenario import Ego
from mdrive_sumo.scenario.scripted_actor import Actor
from mdrive_sumo.worlds.traffic.driving_vehicles import draw_entering, draw_present, select_nearest
from mdrive_sumo.worlds.traffic.occupancy import TakenGround
from mdrive_sumo.worlds.traffic.traffic_demand import TrafficDemand


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
    seed = rng.getrandbits(64)
    taken = TakenGround(egos, actors)
    present = list(draw_present(roads, demand, taken, random.Random(f"{seed}/present")))
    entering = sorted(
        draw_entering(roads, demand, random.Random(f"{seed}/entering")), key=lambda one: (one.depart_s, one.edges)
    )
    vehicles = select_nearest(roads, (*present, *entering), egos, demand.most_vehicles)
    numbered = tuple(one.model_copy(update={"id": f"bg{k}"}) for k, one in enumerate(vehicles))
    return Traffic(numbered, tuple(actors))
