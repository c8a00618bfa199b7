"""Placement on a network that is not packaged: a place that was drawn into a folder of its own."""

import random
from pathlib import Path

import pytest

from mdrive_sumo.roads import RoadMap, load_road_map
from mdrive_sumo.scenario.background import Background
from mdrive_sumo.scenario.checks import check_scenario
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.spawn_overlaps import find_spawn_overlaps
from mdrive_sumo.worlds.encounters.crossing_users import CrossingRequest, build_crossing_users, build_leading_cyclist
from mdrive_sumo.worlds.lane_routes import find_lane_routes
from mdrive_sumo.worlds.network_features import Topology, extract_features
from mdrive_sumo.worlds.placement.cavs import NoRoomError
from mdrive_sumo.worlds.placement.occupancy import select_free_actors
from mdrive_sumo.worlds.placement.parked_vehicles import build_parked_vehicles
from mdrive_sumo.worlds.placement.route_cavs import build_route_cavs
from mdrive_sumo.worlds.places import draw_place, write_place
from mdrive_sumo.worlds.signalled_crossings import find_signalled_crossings
from mdrive_sumo.worlds.streams.near_traffic import TrafficRequest, build_near_traffic


@pytest.fixture(scope="module")
def roads(tmp_path_factory: pytest.TempPathFactory) -> RoadMap:
    folder: Path = tmp_path_factory.mktemp("places") / "own"
    return load_road_map(write_place(draw_place("crossing", 3), folder))


def draw_scenario(roads: RoadMap, seed: int) -> Scenario:
    rng = random.Random(seed)
    ways = {f"Vehicle {n}": rng.choice(find_lane_routes(roads)) for n in (1, 2)}
    egos = tuple(build_route_cavs(ways, (40.0, 90.0), roads, rng).values())
    actors = [
        *build_crossing_users(roads, egos, [CrossingRequest("adult", True), CrossingRequest("bicycle", False)], rng)
    ]
    actors += [cyclist for cyclist in (build_leading_cyclist(roads, egos[0], rng),) if cyclist]
    actors += build_parked_vehicles(roads, egos, 4, rng)
    chosen = select_free_actors(roads, egos, actors)
    vehicles = build_near_traffic(roads, egos, chosen, TrafficRequest(1, 12), rng)
    background = Background(vehicles=vehicles)
    return Scenario(
        id="own", bucket="b", category="c", network=roads.name, egos=egos, actors=chosen, background=background
    )


def test_everything_that_is_placed_on_an_own_network_is_sound(roads: RoadMap) -> None:
    made: list[Scenario] = []
    for seed in range(12):
        try:
            made.append(draw_scenario(roads, seed))
            assert draw_scenario(roads, seed) == made[-1]
        except NoRoomError:
            continue
    assert len(made) >= 6
    for scenario in made:
        check_scenario(scenario, roads)
        assert list(find_spawn_overlaps(scenario, roads)) == []
    assert max(len(scenario.background.vehicles) for scenario in made) >= 8
    kinds = {actor.kind for scenario in made for actor in scenario.actors}
    assert kinds >= {"pedestrian", "cyclist", "vehicle"}


def test_an_own_network_has_features_and_crossings(roads: RoadMap) -> None:
    features = extract_features(roads)
    assert features.topology in (Topology.INTERSECTION, Topology.T_JUNCTION) and features.oncoming
    assert len(find_signalled_crossings(roads)) == len(roads.crossings)
