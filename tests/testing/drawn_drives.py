"""Drives of drawn traffic without any CAV: what touches, what departs, how far it comes."""

import random
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import numpy as np

from mdrive_sumo.actors import ScriptedActors
from mdrive_sumo.core.geometry import boxes_corners, boxes_overlap
from mdrive_sumo.core.state import DT, Actors, Frame, Kind
from mdrive_sumo.roads import RoadMap, load_road_map
from mdrive_sumo.scenario.background import Background
from mdrive_sumo.scenario.scenario import Ego, Scenario
from mdrive_sumo.scenario.scenario_part import Pose
from mdrive_sumo.sumo import SumoWorld
from mdrive_sumo.worlds.places import draw_place, write_place
from mdrive_sumo.worlds.traffic import Traffic, draw_traffic, find_demand

SLACK_M = 0.1
"""Boxes that overlap by less on each side do not count."""
FAR_M = 9e4


@cache
def place_roads(kind: str, seed: int, folder: Path) -> RoadMap:
    """The network of a drawn place, written into a folder of its own."""
    return load_road_map(write_place(draw_place(kind, seed), folder / f"{kind}{seed}"))


def scenario_of(roads: RoadMap, traffic: Traffic, *egos: Ego) -> Scenario:
    """The traffic as a scenario, with a CAV far away where none is given."""
    route = ((FAR_M, 0.0, 0.0), (FAR_M + 1.0, 0.0, 0.0))
    far = Ego(id="far", start=Pose(x=FAR_M, y=0, yaw=0), lanes=("x",), route=route)
    return Scenario(
        id="drawn",
        bucket="Test",
        category="test",
        network=roads.name,
        signals="program",
        egos=egos or (far,),
        background=Background(vehicles=traffic.vehicles),
        actors=traffic.actors,
    )


@dataclass(frozen=True)
class DrawnDrive:
    """Pairs of ids that touch, and how far [m] every vehicle has come that has departed."""

    traffic: Traffic
    contacts: set[tuple[str, str]] = field(default_factory=set[tuple[str, str]])
    driven_m: dict[str, float] = field(default_factory=dict[str, float])


def drive_drawn(roads: RoadMap, demand: str, seed: int, seconds: float = 30.0) -> DrawnDrive:
    """Draw traffic and drive it; SUMO raises WorldError for a teleport."""
    drive = DrawnDrive(draw_traffic(roads, (), (), find_demand(demand), random.Random(seed)))
    for actors in _drive(scenario_of(roads, drive.traffic), roads, seconds):
        drive.contacts.update(find_contacts(actors))
        moving = zip(actors.ids, actors.speed.tolist(), strict=True)
        for name, speed in ((name, speed) for name, speed in moving if name.startswith("bg")):
            drive.driven_m[name] = drive.driven_m.get(name, 0.0) + speed * DT
    return drive


def _drive(scenario: Scenario, roads: RoadMap, seconds: float) -> Iterator[Actors]:
    scripted = ScriptedActors(scenario, roads)
    with SumoWorld(scenario, roads, {}, 1) as world:
        around = world.start({}, scripted.present)
        for tick in range(round(seconds / DT)):
            frame = Frame(tick, {}, around.actors.merge(scripted.present), around.signals)
            yield frame.actors
            around = world.advance({}, scripted.advance(frame, ()), ())


def find_contacts(actors: Actors) -> list[tuple[str, str]]:
    """Vehicles and cyclists that overlap anything; people do not block each other."""
    length, width = np.maximum(actors.length - 2 * SLACK_M, 0.05), np.maximum(actors.width - 2 * SLACK_M, 0.05)
    boxes = boxes_corners(actors.x, actors.y, actors.yaw, length, width)
    i, j = np.triu_indices(len(boxes), 1)
    rolls = np.isin(actors.kind, (Kind.VEHICLE, Kind.CYCLIST))
    near = (np.hypot(actors.x[i] - actors.x[j], actors.y[i] - actors.y[j]) < 15.0) & (rolls[i] | rolls[j])
    i, j = i[near], j[near]
    hits = boxes_overlap(boxes[i], boxes[j]) if len(i) else np.zeros(0, dtype=np.bool_)
    return [(actors.ids[a], actors.ids[b]) for a, b in zip(i[hits].tolist(), j[hits].tolist(), strict=True)]
