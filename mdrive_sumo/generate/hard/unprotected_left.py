"""Left turn across oncoming traffic of 70 km/h that trucks in the opposite left-turn lane hide."""

import random
from collections.abc import Mapping

from mdrive_sumo.core import portable
from mdrive_sumo.generate.hard.family import (
    FamilyCandidate,
    FamilyParameter,
    ScenarioFamily,
    build_encounter_parameters,
)
from mdrive_sumo.generate.hard.family_scenario import FamilyTraffic, build_scenario, load_network, read_values
from mdrive_sumo.roads import RoadMap, find_lane_path
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.scenario_part import Pose
from mdrive_sumo.scenario.scripted_actor import Actor
from mdrive_sumo.worlds.encounters.hidden_vehicle import Encounter, place_encounter
from mdrive_sumo.worlds.placement.bodies import BODY_SIZES, build_parked_vehicle
from mdrive_sumo.worlds.streams.edge_streams import TrafficStream, build_traffic

NETWORK = "hard_arterial"
MEAN_SPEED = 10.0
"""[m/s] Of a car that slows down for the bend."""
STREAMS = (
    TrafficStream(("east_0", "east_1"), (1, 2), 1.0),
    TrafficStream(("west_1", "west_0"), (1,), 0.3),
    TrafficStream(("north_1_in", "south_1_out"), (1, 2), 0.6),
    TrafficStream(("south_1_in", "north_1_out"), (1, 2), 0.6),
)
"""Those of the crossing road wait at red."""
TRUCK_GAP_M = 1.5
"""[m] Between the waiting trucks."""


def build_unprotected_left(candidate: FamilyCandidate) -> Scenario:
    """Return the scenario of a candidate: CAV 0 turns left, CAV 1 drives beside and behind the hidden vehicle."""
    values, roads, rng = read_values(FAMILY, candidate), load_network(NETWORK), random.Random(candidate.seed)
    lane = rng.choice((2, 2, 1))
    encounter = Encounter(
        own=find_lane_path(roads, "east_0_3", "north_1_out_2"),
        hidden=find_lane_path(roads, f"west_1_{lane}", f"west_0_{lane}"),
        witness=find_lane_path(roads, f"west_1_{3 - lane}", f"west_0_{3 - lane}"),
        mean_speed=MEAN_SPEED,
        follower_speed=13.0,
    )
    placed = place_encounter(roads, encounter, values)
    egos = placed.egos
    actors = (*placed.actors, *_build_trucks(roads, round(values["trucks"]), values))
    vehicles = build_traffic(roads, STREAMS, round(values["vehicles"]), candidate.seed, (*egos, *actors))
    return build_scenario(FAMILY, candidate, roads, egos, FamilyTraffic(vehicles, actors, signals=True))


def _build_trucks(roads: RoadMap, count: int, values: Mapping[str, float]) -> list[Actor]:
    """Return trucks in the opposite left-turn lane, the first of them with its front `truck_ahead_m` past the line.

    It waits with straight wheels, as drivers are taught, `truck_aside_m` to the right of its lane's centre.
    """
    centre, length = roads.lanes["west_1_3"].centre, BODY_SIZES["truck"][0]
    front, made = centre.length + values["truck_ahead_m"], list[Actor]()
    aside = values["truck_aside_m"]
    for i in range(count):
        (x, y), yaw = centre.at(front - length / 2), centre.yaw_at(centre.length)
        x, y = x + aside * portable.sin(yaw), y - aside * portable.cos(yaw)
        pose = Pose(x=round(x, 3), y=round(y, 3), yaw=round(yaw, 4))
        made.append(build_parked_vehicle(f"truck{i}", "truck", pose))
        front -= length + TRUCK_GAP_M
    return made


FAMILY = ScenarioFamily(
    category="unprotected-left-turn",
    description="Left turn across fast oncoming traffic that trucks in the opposite left-turn lane hide.",
    parameters=(
        *build_encounter_parameters((30.0, 120.0), (5.0, 14.0), (11.0, 19.4)),
        FamilyParameter("truck_ahead_m", 4.0, 16.2, "m", "how far the first truck has driven into the junction"),
        FamilyParameter("truck_aside_m", 0.0, 0.4, "m", "how far right of its lane's centre the first truck stands"),
        FamilyParameter("trucks", 1.0, 4.0, "", "number of trucks in the opposite left-turn lane"),
        FamilyParameter("cavs", 2.0, 6.0, "", "number of CAVs"),
        FamilyParameter("vehicles", 0.0, 90.0, "", "number of reactive vehicles"),
    ),
    build=build_unprotected_left,
)
