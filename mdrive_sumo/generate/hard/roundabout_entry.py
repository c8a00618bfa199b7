"""Entry into a roundabout of two lanes whose planted island and corner houses hide the traffic in the ring."""

from mdrive_sumo.generate.hard.family import (
    FamilyParameter,
    FamilyScene,
    ScenarioFamily,
    Values,
    build_encounter_parameters,
    load_network,
)
from mdrive_sumo.roads import RoadMap, find_lane_path
from mdrive_sumo.worlds.encounters.hidden_vehicle import Encounter, place_encounter
from mdrive_sumo.worlds.placement.lane_chains import Lanes
from mdrive_sumo.worlds.streams.edge_streams import TrafficStream, build_traffic

NETWORK = "hard_roundabout"
ARMS = ("east", "north", "west", "south")
"""In driving direction around the ring."""
MEAN_SPEED = 10.0
"""[m/s] Of a CAV that slows down for the ring."""
STREAMS_BY_ARM = {
    "east": TrafficStream(("east_in", "ring_2", "ring_3", "ring_4", "west_out"), (0, 1), 0.5, large=False),
    "north": TrafficStream(("north_in", "ring_4", "ring_5", "ring_6", "south_out"), (0, 1), 0.5, large=False),
    "west": TrafficStream(("west_in", "ring_6", "ring_7", "ring_8", "east_out"), (0, 1), 0.5, large=False),
    "south": TrafficStream(("south_in", "ring_8", "ring_1", "ring_2", "north_out"), (0, 1), 0.5, large=False),
}


def stage_roundabout_entry(values: Values, seed: str) -> FamilyScene:
    """Return the scene of a candidate: CAV 0 enters, the hidden vehicle comes round the island, CAV 1 behind it."""
    roads = load_network(NETWORK)
    arm = min(int(values["arm"]), 3)
    lane = 0 if values["inner"] < 0.5 else 1
    own = _find_way(roads, arm, lane, 2)
    back = 1 + (values["far"] >= 0.5)
    hidden = _find_way(roads, (arm - back) % 4, lane, 1 + back)
    placed = place_encounter(roads, Encounter(own, hidden, hidden, MEAN_SPEED, MEAN_SPEED), values)
    streams = tuple(STREAMS_BY_ARM[ARMS[k]] for k in range(4) if k != arm)
    vehicles = build_traffic(roads, streams, round(values["vehicles"]), seed, (*placed.egos, *placed.actors))
    return FamilyScene(roads, placed.egos, vehicles, placed.actors, placed.rsus)


def _find_way(roads: RoadMap, arm: int, lane: int, arms: int) -> Lanes:
    """Return the lanes from one arm to the one that lies `arms` further along the ring."""
    return find_lane_path(roads, f"{ARMS[arm]}_in_{lane}", f"{ARMS[(arm + arms) % 4]}_out_{lane}")


FAMILY = ScenarioFamily(
    category="roundabout-entry",
    description="Entry into a roundabout whose island and corner houses hide the traffic in the ring.",
    parameters=(
        *build_encounter_parameters((50.0, 140.0), (6.0, 13.8), (7.0, 11.0)),
        FamilyParameter("arm", 0.0, 4.0, "", "arm by which CAV 0 enters"),
        FamilyParameter("inner", 0.0, 1.0, "", "whether both drive in the inner lane (from 0.5 on)"),
        FamilyParameter("far", 0.0, 1.0, "", "whether the hidden vehicle comes from the opposite arm (from 0.5 on)"),
        FamilyParameter("mast", 0.0, 1.0, "", "whether a roadside unit stands at the entry (from 0.5 on)"),
        FamilyParameter("cavs", 2.0, 6.0, "", "number of CAVs"),
        FamilyParameter("vehicles", 0.0, 70.0, "", "number of reactive vehicles"),
    ),
    stage=stage_roundabout_entry,
)
