"""Crossing traffic behind buildings at crossings with narrow one-way streets, from the left and from the right."""

from dataclasses import dataclass

from mdrive_sumo.generate.hard.family import (
    FamilyParameter,
    FamilyScene,
    ScenarioFamily,
    Values,
    build_encounter_parameters,
    load_network,
)
from mdrive_sumo.generate.hard.family_streets import is_corridor_network
from mdrive_sumo.roads import RoadMap, find_lane_path
from mdrive_sumo.scenario.scripted_actor import Actor
from mdrive_sumo.worlds.encounters.hidden_vehicle import Encounter, place_encounter
from mdrive_sumo.worlds.placement.bodies import build_parked_vehicle, space_vehicles
from mdrive_sumo.worlds.placement.lane_chains import compute_pose, find_conflict
from mdrive_sumo.worlds.streams.edge_streams import TrafficStream, build_traffic

MOUTH_M = 4.4
"""[m] From the path of CAV 0 over its own half width and the side road's other lane to where a van may stand."""

VAN_GAP_M = 1.0
"""[m] Between parked vans."""


@dataclass(frozen=True, slots=True)
class CrossingSite:
    """A junction: first and last lanes of CAV 0 and of the hidden vehicle."""

    network: str
    own: tuple[str, str]
    hidden: tuple[str, str]
    mean_speed: float
    """[m/s] Of CAV 0 until the conflict."""
    corner_m: float
    """[m] Lateral distance from the hidden vehicle's lane to a van parked at its kerb; 0: no place for it."""


SITES = (
    CrossingSite("hard_blind_crossing", ("south_1_in_0", "north_1_out_0"), ("east_0_1", "east_1_1"),
                 13.0, 0.0),
    CrossingSite("hard_blind_crossing", ("east_0_1", "east_1_1"), ("south_1_in_0", "north_1_out_0"),
                 13.0, 0.0),
    CrossingSite("hard_barn_crossing", ("south_1_in_0", "north_1_out_0"), ("east_0_0", "east_1_0"),
                 13.0, 0.0),
    CrossingSite("hard_barn_crossing", ("east_0_0", "east_1_0"), ("south_1_in_0", "north_1_out_0"),
                 15.0, 0.0),
    CrossingSite("hard_corridor_narrow", ("north_3_in_1", "south_3_out_1"), ("east_0_2", "east_4_2"),
                 11.0, 2.8),
)  # fmt: skip
STREAMS_BY_NETWORK = {
    "hard_blind_crossing": (
        TrafficStream(("east_0", "east_1"), (1,), 0.5, large=False),
        TrafficStream(("west_1", "west_0"), (1,), 0.5, large=False),
    ),
    "hard_barn_crossing": (
        TrafficStream(("east_0", "east_1"), (0,), 0.4),
        TrafficStream(("west_1", "west_0"), (0,), 0.4),
    ),
    "hard_corridor_narrow": (
        TrafficStream(("east_0", "east_1", "east_2", "east_3", "east_4"), (2,), 0.6),
        TrafficStream(("west_4", "west_3", "west_2", "west_1", "west_0"), (2,), 0.6),
        TrafficStream(("south_2_in", "north_2_out"), (1,), 0.4, large=False),
        TrafficStream(("north_4_in", "south_4_out"), (1,), 0.4, large=False),
    ),
    "hard_corridor_market": (
        TrafficStream(("east_0", "east_1", "east_2", "east_3", "east_4", "east_5"), (2, 3), 0.8),
        TrafficStream(("west_5", "west_4", "west_3", "west_2", "west_1", "west_0"), (2, 3), 0.8),
        TrafficStream(("south_3_in", "north_3_out"), (1,), 0.4, large=False),
        TrafficStream(("north_5_in", "south_5_out"), (1,), 0.4, large=False),
    ),
}
"""Reactive traffic by network; the corridors' streams also serve other families."""


def stage_blind_crossing(values: Values, seed: str) -> FamilyScene:
    """Return the scene of a candidate: CAV 0 meets a hidden vehicle, which CAV 1 follows or a mast sees."""
    site = SITES[min(int(values["site"]), len(SITES) - 1)]
    roads = load_network(site.network)
    hidden = find_lane_path(roads, *site.hidden)
    own = find_lane_path(roads, *site.own)
    encounter = Encounter(own, hidden, hidden, site.mean_speed, values["hidden_speed"])
    placed = place_encounter(roads, encounter, values)
    actors = (*placed.actors, *_build_corner_vans(roads, encounter, site, values))
    streams = STREAMS_BY_NETWORK[site.network]
    vehicles = build_traffic(roads, streams, round(values["vehicles"]), seed, (*placed.egos, *actors))
    return FamilyScene(roads, placed.egos, vehicles, actors, placed.rsus, is_corridor_network(site.network))


def _build_corner_vans(roads: RoadMap, encounter: Encounter, site: CrossingSite, values: Values) -> list[Actor]:
    """Return vans parked at the hidden vehicle's kerb, the first `corner_gap_m` from the mouth of the side road."""
    if not site.corner_m:
        return []
    _, at = find_conflict(roads, encounter.own, encounter.hidden)
    places = space_vehicles(["van"] * round(values["vans"]), at - MOUTH_M - values["corner_gap_m"], VAN_GAP_M)
    poses = [compute_pose(roads, encounter.hidden, middle, -site.corner_m) for _, middle in places]
    return [build_parked_vehicle(f"van{i}", "van", pose, mirrored=False) for i, pose in enumerate(poses)]


FAMILY = ScenarioFamily(
    category="blind-crossing",
    description="Fast traffic crosses from behind buildings that stand at the corner.",
    parameters=(
        FamilyParameter("site", 0.0, float(len(SITES)), "", "junction and directions"),
        *build_encounter_parameters((50.0, 150.0), (9.0, 16.6), (9.0, 22.2)),
        FamilyParameter("vans", 0.0, 8.0, "", "number of vans parked at the corner, where there is a kerb for them"),
        FamilyParameter("corner_gap_m", 0.0, 8.0, "m", "distance of the first van from the mouth of the side road"),
        FamilyParameter("mast", 0.0, 1.0, "", "whether a roadside unit hangs above the junction (from 0.5 on)"),
        FamilyParameter("cavs", 2.0, 10.0, "", "number of CAVs"),
        FamilyParameter("vehicles", 0.0, 60.0, "", "number of reactive vehicles"),
    ),
    stage=stage_blind_crossing,
)
