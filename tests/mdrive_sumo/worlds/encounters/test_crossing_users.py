"""Road users that cross: they start because of the CAV that they meet. A vehicle that is hidden from another one."""

import math

import pytest

from mdrive_sumo.roads import RoadMap, find_lane_path, find_network_folder, load_road_map
from mdrive_sumo.scenario.scripted_actor import PathMotion, PositionTrigger
from mdrive_sumo.worlds.encounters.crossing_users import StepOut
from mdrive_sumo.worlds.encounters.hidden_vehicle import Encounter, place_encounter
from mdrive_sumo.worlds.placement.bodies import BODIES
from mdrive_sumo.worlds.placement.cavs import build_cav
from mdrive_sumo.worlds.placement.lane_chains import find_conflict, find_station

VALUES = {
    "own_m": 60.0,
    "own_speed": 10.0,
    "hidden_speed": 12.0,
    "gap_s": 0.0,
    "connected": 0.0,
    "behind_m": 15.0,
    "cavs": 4.0,
}


def load() -> RoadMap:
    return load_road_map(find_network_folder("hard_blind_crossing"))


def test_a_pedestrian_steps_out_when_the_cav_is_as_near_as_asked() -> None:
    roads = load()
    lanes = find_lane_path(roads, "east_0_1", "east_1_1")
    cav = build_cav(roads, "0", lanes, (20.0, 120.0), 8.0)
    walker = StepOut(BODIES["adult"], 90.0, (-4.0, 5.0), 1.5, 25.0).build(roads, lanes, "w", cav)
    assert isinstance(walker.motion, PathMotion) and isinstance(walker.trigger, PositionTrigger)
    assert find_station(roads, lanes, walker.trigger.x, walker.trigger.y) == pytest.approx(90.0 - 25.0, abs=0.6)
    (x0, y0), (x1, y1) = walker.motion.points
    assert math.hypot(x1 - x0, y1 - y0) == pytest.approx(9.0, abs=0.01)
    assert walker.start.yaw == pytest.approx(math.atan2(y1 - y0, x1 - x0), abs=1e-3)


@pytest.mark.parametrize(
    ("changes", "cavs", "actors", "rsus"),
    [
        ({}, ["0", "1", "2", "3"], ["hidden"], []),
        ({"connected": 1.0}, ["0", "hidden", "1", "2"], [], []),
        ({"mast": 1.0}, ["0", "2", "3", "4"], ["hidden"], ["rsu"]),
        ({"mast": 1.0, "connected": 1.0, "cavs": 2.0}, ["0", "hidden"], [], ["rsu"]),
    ],
)
def test_a_hidden_vehicle_is_due_with_the_cav_and_seen_by_a_witness_or_a_mast(
    changes: dict[str, float], cavs: list[str], actors: list[str], rsus: list[str]
) -> None:
    roads = load()
    own = find_lane_path(roads, "south_1_in_0", "north_1_out_0")
    hidden = find_lane_path(roads, "east_0_1", "east_1_1")
    placed = place_encounter(roads, Encounter(own, hidden, hidden, 10.0, 11.0), VALUES | changes)
    assert [ego.id for ego in placed.egos] == cavs
    assert [actor.id for actor in placed.actors] == actors
    assert [rsu.id for rsu in placed.rsus] == rsus
    at_own, at_hidden = find_conflict(roads, own, hidden)
    user = placed.actors[0] if actors else placed.egos[1]
    start = placed.egos[0].start
    due_s = (at_own - find_station(roads, own, start.x, start.y)) / 10.0
    assert (at_hidden - find_station(roads, hidden, user.start.x, user.start.y)) / 12.0 == pytest.approx(due_s, abs=0.1)
