"""Left turn across oncoming traffic of 70 km/h that trucks in the opposite left-turn lane hide."""

import random

from mdrive_sumo.generate.hard.family import (
    FamilyParameter,
    FamilyScene,
    ScenarioFamily,
    Values,
    build_encounter_parameters,
    load_network,
)
from mdrive_sumo.roads import RoadMap, find_lane_path
from mdrive_sumo.scenario.scripted_actor import Actor
from mdrive_sumo.worlds.encounters.hidden_vehicle import Encounter, place_encounter
from mdrive_sumo.worlds.placement.bodies import build_parked_vehicle, space_vehicles
from mdrive_sumo.worlds.placement.lane_chains import build_pose
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


def stage_unprotected_left(values: Values, seed: str) -> FamilyScene:
    """Return the scene of a candidate: CAV 0 turns left, CAV 1 drives beside and behind the hidden vehicle."""
    roads, rng = load_network(NETWORK), random.Random(seed)
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
    vehicles = build_traffic(roads, STREAMS, round(values["vehicles"]), seed, (*egos, *actors))
    return FamilyScene(roads, egos, vehicles, actors, signals=True)


def _build_trucks(roads: RoadMap, count: int, values: Values) -> list[Actor]:
    """Return trucks in the opposite left-turn lane, the first of them with its front `truck_ahead_m` past the line.

    It waits with straight wheels, as drivers are taught, `truck_aside_m` to the right of its lane's centre.
    """
    centre = roads.lanes["west_1_3"].centre
    places = space_vehicles(["truck"] * count, centre.length + values["truck_ahead_m"], TRUCK_GAP_M)
    yaw, aside = centre.yaw_at(centre.length), values["truck_aside_m"]
    poses = [build_pose(*centre.at(middle), yaw, -aside) for _, middle in places]
    return [build_parked_vehicle(f"truck{i}", "truck", pose) for i, pose in enumerate(poses)]


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
    stage=stage_unprotected_left,
)
