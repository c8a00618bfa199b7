"""Drawn traffic drives for 30 s in SUMO: no teleport, and no vehicle runs into anything."""

import random
import time

import numpy as np
import pytest

from mdrive_sumo.actors import ScriptedActors
from mdrive_sumo.core.geometry import boxes_corners, boxes_overlap
from mdrive_sumo.core.state import Actors, Frame, Kind
from mdrive_sumo.roads import RoadMap, load_road_map
from mdrive_sumo.scenario.background import Background
from mdrive_sumo.scenario.scenario import Ego, Scenario
from mdrive_sumo.scenario.scenario_part import Pose
from mdrive_sumo.sumo import SumoWorld
from mdrive_sumo.worlds.places import draw_place, write_place
from mdrive_sumo.worlds.traffic import draw_traffic, find_demand

pytestmark = pytest.mark.slow
SECONDS = 30.0
SLACK_M = 0.1
DRIVES = (
    ("crossing", 1, "town-busy"),
    ("crossing", 3, "town-busy"),
    ("town_block", 1, "old-town"),
    ("corridor", 2, "arterial"),
    ("corridor", 3, "town-busy"),
    ("motorway_merge", 1, "motorway"),
)


@pytest.fixture(scope="module", params=DRIVES, ids=str)
def drive(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[RoadMap, Scenario]:
    kind, seed, demand = request.param
    roads = load_road_map(write_place(draw_place(kind, seed), tmp_path_factory.mktemp("place")))
    traffic = draw_traffic(roads, (), (), find_demand(demand), random.Random(seed))
    far = Ego(id="far", start=Pose(x=9e4, y=0, yaw=0), lanes=("x",), route=((9e4, 0, 0), (9e4 + 1, 0, 0)))
    background = Background(vehicles=traffic.vehicles)
    return roads, Scenario(
        id="drawn",
        bucket="Test",
        category="test",
        network=roads.name,
        signals="program",
        egos=(far,),
        background=background,
        actors=traffic.actors,
    )


def find_contacts(actors: Actors) -> list[tuple[str, str]]:
    """Vehicles and cyclists that overlap anything by more than rounding; people do not block each other."""
    length, width = np.maximum(actors.length - 2 * SLACK_M, 0.05), np.maximum(actors.width - 2 * SLACK_M, 0.05)
    boxes = boxes_corners(actors.x, actors.y, actors.yaw, length, width)
    i, j = np.triu_indices(len(boxes), 1)
    rolls = np.isin(actors.kind, (Kind.VEHICLE, Kind.CYCLIST))
    near = (np.hypot(actors.x[i] - actors.x[j], actors.y[i] - actors.y[j]) < 15.0) & (rolls[i] | rolls[j])
    i, j = i[near], j[near]
    hits = boxes_overlap(boxes[i], boxes[j]) if len(i) else np.zeros(0, dtype=np.bool_)
    return [(actors.ids[a], actors.ids[b]) for a, b in zip(i[hits].tolist(), j[hits].tolist(), strict=True)]


def test_nothing_runs_into_anything_and_traffic_flows(drive: tuple[RoadMap, Scenario]) -> None:
    roads, scenario = drive
    scripted, contacts, driven = ScriptedActors(scenario, roads), set[tuple[str, str]](), dict[str, float]()
    with SumoWorld(scenario, roads, {}, 1) as world:  # it raises WorldError for a teleport
        around = world.start({}, scripted.present)
        for tick in range(round(SECONDS * 20)):
            frame = Frame(tick, {}, around.actors.merge(scripted.present), around.signals)
            contacts.update(find_contacts(frame.actors))
            for name, speed in zip(around.actors.ids, around.actors.speed.tolist(), strict=True):
                driven[name] = driven.get(name, 0.0) + speed / 20
            around = world.advance({}, scripted.advance(frame, ()), ())
    assert contacts == set()
    first = [vehicle.id for vehicle in scenario.background.vehicles if vehicle.depart_s == 0.0]
    assert np.mean([name in driven for name in first]) > 0.95
    assert np.median(list(driven.values())) > 20.0


def test_a_drawing_takes_less_than_50_ms(drive: tuple[RoadMap, Scenario]) -> None:
    roads, _ = drive
    times: list[float] = []
    for seed in range(4):
        began = time.process_time()
        draw_traffic(roads, (), (), find_demand("town-busy"), random.Random(seed))
        times.append(time.process_time() - began)
    assert min(times) < 0.05
