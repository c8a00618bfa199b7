"""Traffic that is drawn: the same bytes for the same seed, room for everything at the start, what each demand holds."""

import random
from collections import Counter
from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest
from testing.drawn_drives import place_roads, scenario_of

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.roads import RoadMap, find_network_folder, load_road_map
from mdrive_sumo.scenario.checks import check_scenario
from mdrive_sumo.scenario.scenario import Ego
from mdrive_sumo.scenario.scenario_part import Pose
from mdrive_sumo.scenario.scripted_actor import Actor, GapTrigger, PathMotion
from mdrive_sumo.scenario.spawn_overlaps import find_spawn_overlaps
from mdrive_sumo.worlds.traffic import DEMANDS, Traffic, TrafficDemand, draw_traffic, find_demand

NETWORKS = ("town_crossing", "city_corridor", "motorway", "old_town")
PLACES = (("crossing", 3), ("town_block", 1), ("corridor", 3), ("corridor", 2))
"""With cycle lanes; with parked rows; with cycle lanes, zebra crossings and parked rows; with bus stops."""


def roads_of(name: str) -> RoadMap:
    return load_road_map(find_network_folder(name))


@pytest.fixture(scope="module")
def places(tmp_path_factory: pytest.TempPathFactory) -> dict[tuple[str, int], RoadMap]:
    folder: Path = tmp_path_factory.mktemp("places")
    return {(kind, seed): place_roads(kind, seed, folder) for kind, seed in PLACES}


def drawn(roads: RoadMap, demand: str | TrafficDemand, seed: int, *egos: Ego) -> Traffic:
    wanted = find_demand(demand) if isinstance(demand, str) else demand
    return draw_traffic(roads, egos, (), wanted, random.Random(seed))


@cache
def ego_on(name: str) -> Ego:
    """A CAV in the middle of the longest lane."""
    roads = roads_of(name)
    lane = max((lane for lane in roads.driving if not lane.junction), key=lambda one: one.centre.length)
    stations = [lane.centre.length / 2 + k for k in range(20)]
    points = tuple((*lane.centre.at(s), lane.centre.yaw_at(s)) for s in stations)
    x, y, yaw = points[0]
    return Ego(id="0", start=Pose(x=x, y=y, yaw=yaw), start_speed=8.0, lanes=(lane.id,), route=points)


@pytest.mark.parametrize("name", NETWORKS)
@pytest.mark.parametrize("demand", DEMANDS)
def test_the_same_seed_draws_the_same_traffic_and_another_one_other_traffic(name: str, demand: str) -> None:
    roads = roads_of(name)
    assert drawn(roads, demand, 1) == drawn(roads, demand, 1)
    assert drawn(roads, demand, 1) != drawn(roads, demand, 2)


@pytest.mark.parametrize("name", NETWORKS)
@pytest.mark.parametrize("seed", range(4))
def test_nothing_overlaps_at_the_start_and_cavs_have_room(name: str, seed: int) -> None:
    roads, ego = roads_of(name), ego_on(name)
    for demand in ("town-busy", "arterial"):
        some = scenario_of(roads, drawn(roads, demand, seed, ego), ego)
        check_scenario(some, roads)
        assert list(find_spawn_overlaps(some, roads)) == []
        assert len(some.background.vehicles) > 5


@pytest.mark.parametrize("seed", range(3))
def test_nothing_overlaps_at_the_start_on_drawn_places(places: dict[tuple[str, int], RoadMap], seed: int) -> None:
    for roads in places.values():
        some = scenario_of(roads, drawn(roads, "town-busy", seed))
        assert list(find_spawn_overlaps(some, roads)) == []


def count(*traffics: Traffic) -> Counter[str]:
    """How many there are of each kind of road user."""
    kinds: Counter[str] = Counter()
    for traffic in traffics:
        kinds.update(actor.id.rstrip("0123456789") for actor in traffic.actors)
        for vehicle in traffic.vehicles:
            name = "pulls out" if vehicle.parked else "stops" if vehicle.stops else vehicle.kind
            kinds[name] += 1
    return kinds


@pytest.mark.slow
def test_a_busy_town_has_everything_that_streets_have(places: dict[tuple[str, int], RoadMap]) -> None:
    kinds = count(*(drawn(roads, "town-busy", seed) for roads in places.values() for seed in range(6)))
    wanted = {"vehicle", "cyclist", "stops", "pulls out", "parked", "door", "driver", "walker", "crosser", "stander"}
    assert wanted <= set(kinds), wanted - set(kinds)


def test_a_motorway_has_neither_people_nor_cyclists_nor_parked_vehicles() -> None:
    kinds = count(*(drawn(roads_of("motorway"), "motorway", seed) for seed in range(3)))
    assert set(kinds) == {"vehicle"}


def test_busier_demands_draw_more() -> None:
    roads = roads_of("city_corridor")
    quiet, busy = (count(*(drawn(roads, demand, seed) for seed in range(4))) for demand in ("town-quiet", "town-busy"))
    assert busy["vehicle"] > 1.5 * quiet["vehicle"]
    assert busy["walker"] > 1.5 * quiet["walker"]


def test_buses_stop_at_the_stops_of_the_network(places: dict[tuple[str, int], RoadMap]) -> None:
    roads = places["corridor", 2]
    traffic = drawn(roads, replace(find_demand("arterial"), bus_stop_share=1.0, deliveries_per_km=0.0), 1)
    halts = {(stop.edge, stop.lane) for vehicle in traffic.vehicles for stop in vehicle.stops}
    stops = {(roads.lanes[one.lane].edge, roads.lanes[one.lane].index) for one in roads.bus_stops}
    assert halts
    assert halts <= stops


def test_cyclists_ride_on_cycle_lanes_where_there_are_some(places: dict[tuple[str, int], RoadMap]) -> None:
    roads = places["crossing", 3]
    riders = [one for seed in range(8) for one in drawn(roads, "town-busy", seed).vehicles if one.kind == "cyclist"]
    lanes = {f"{one.edges[0]}_{one.depart_lane}" for one in riders}
    assert lanes
    assert lanes <= set(roads.cycle_lanes)


def test_whoever_crosses_waits_for_a_gap_and_all_people_have_a_long_way(places: dict[tuple[str, int], RoadMap]) -> None:
    people: list[Actor] = []
    for roads in places.values():
        people += [one for one in drawn(roads, "old-town", 3).actors if one.id.startswith(("crosser", "walker"))]
    assert people
    for one in people:
        assert isinstance(one.motion, PathMotion)
        assert isinstance(one.trigger, GapTrigger) is one.id.startswith("crosser")
        assert 0.6 <= one.motion.speed <= 2.2


def test_ids_that_the_scenario_uses_already_are_not_used_again() -> None:
    roads = roads_of("town_crossing")
    before = drawn(roads, "town-busy", 1).actors[:1]
    after = draw_traffic(roads, (), before, find_demand("town-busy"), random.Random(1)).actors
    assert after[0] == before[0]
    assert len({actor.id for actor in after}) == len(after)


def test_an_unknown_demand_names_the_known_ones_and_the_one_that_was_meant() -> None:
    with pytest.raises(InputError, match=r"^demand: expected one of town-quiet, .*did you mean 'town-busy'\?$"):
        find_demand("town-bussy")
