"""Riders of e-scooters who come out of a passage between barns on a fast road; used by `occluded-pedestrian`.

The barns stand close to the road, so a CAV sees into a passage only when it is near.
"""

from dataclasses import dataclass

import shapely

from mdrive_sumo.generate.hard.blind_crossing import STREAMS_BY_NETWORK
from mdrive_sumo.generate.hard.family import FamilyScene, Values, load_network
from mdrive_sumo.generate.rejection import PipelineStage, ProposalRejected
from mdrive_sumo.roads import RoadMap, find_lane_path
from mdrive_sumo.worlds.encounters.crossing_users import StepOut
from mdrive_sumo.worlds.placement.bodies import BODIES, build_mast
from mdrive_sumo.worlds.placement.cavs import build_platoon
from mdrive_sumo.worlds.placement.lane_chains import Lanes, compute_chain_length, compute_pose, find_station_beside
from mdrive_sumo.worlds.streams.edge_streams import TrafficStream, build_traffic

WALL_M = 3.65
"""[m] From the centre of the lane just behind the fronts of barns that stand close to the road."""
FREE_M = 2.0
"""[m] Least width of a passage."""
BESIDE_M = 0.5
"""[m] Riders keep this far from the wall of a passage."""
DEEP_M = 22.0
"""[m] From the centre of the lane to where they begin, in the passage."""
JUNCTION_M = 14.0
"""[m] No passage is closer to the middle of the network, where the side street is."""
APPROACH_M, RIM_M = 45.0, 3.0
"""[m] Least distances of a passage from the begin of the lanes, and of a goal from their end."""
SPACING_M = 20.0
"""[m] Least distance between two riders."""
MEAN_SPEED = 16.0
"""[m/s] Start speed of the oncoming CAVs."""
SPEED_FACTOR = 1.5
"""Start speed of CAV 0 as a multiple of that in corridors: the limit is 80 km/h, not 50 to 60 km/h."""


@dataclass(frozen=True, slots=True)
class PassageStreet:
    """A straight road between barns."""

    network: str
    own: tuple[str, str]
    """First and last lane of CAV 0, at the kerb."""
    oncoming: tuple[str, str]
    across_m: float
    """[m] From the centre of the lane of CAV 0 to the verge on the other side."""
    streams: tuple[TrafficStream, ...]


EAST, WEST = ("east_0_0", "east_1_0"), ("west_1_0", "west_0_0")
STREETS = tuple(
    PassageStreet("hard_barn_crossing", own, oncoming, 6.2, STREAMS_BY_NETWORK["hard_barn_crossing"])
    for own, oncoming in ((EAST, WEST), (WEST, EAST))
)


def find_passages(roads: RoadMap, lanes: Lanes) -> list[float]:
    """Return the stations [m] at which riders come out of passages to the right of a chain of lanes."""
    houses = shapely.union_all(roads.building_shapes)
    found: list[float] = []
    for station in range(int(APPROACH_M), int(compute_chain_length(roads, lanes) - APPROACH_M)):
        here = compute_pose(roads, lanes, station, -WALL_M)
        if abs(here.x) < JUNCTION_M:
            continue
        wall, *free = (_is_inside(roads, houses, lanes, station + ahead) for ahead in (0.0, 1.0, FREE_M + 1.0))
        if wall and not any(free):
            found.append(_find_wall_end(roads, houses, lanes, station) + BESIDE_M)
    return found


def _is_inside(roads: RoadMap, houses: shapely.Geometry, lanes: Lanes, station: float) -> bool:
    """Return whether the place right behind the fronts of barns lies in one."""
    pose = compute_pose(roads, lanes, station, -WALL_M - 0.2)
    return bool(shapely.contains(houses, shapely.Point(pose.x, pose.y)))


def _find_wall_end(roads: RoadMap, houses: shapely.Geometry, lanes: Lanes, station: float) -> float:
    """Return the station [m] of the end of a house, to 0.1 m."""
    return next(
        station + k / 10 for k in range(11) if k == 10 or not _is_inside(roads, houses, lanes, station + k / 10)
    )


def build_passage_scene(street: PassageStreet, values: Values, seed: str) -> FamilyScene:
    """Return the scene of a candidate of `occluded-pedestrian`. Raises ProposalRejected."""
    roads = load_network(street.network)
    own, oncoming = (find_lane_path(roads, *ends) for ends in (street.own, street.oncoming))
    places = _choose_places(find_passages(roads, own), values)
    start = max(places[0] - values["own_m"], RIM_M)
    goal = min(places[-1] + values["beyond_m"], compute_chain_length(roads, own) - RIM_M)
    speed = SPEED_FACTOR * values["own_speed"]
    has_witness = values["mast"] < 0.5
    beside = find_station_beside(roads, oncoming, own, places[0])
    front = max(beside - values["witness_m"] - (places[0] - start) * 0.7, RIM_M)
    names = ["oncoming"] if has_witness else []
    witnesses = build_platoon(roads, names, oncoming, (front, 26.0), (beside + 40.0, MEAN_SPEED))
    names = [str(k) for k in range(round(values["cavs"]) - has_witness)]
    line = build_platoon(roads, names, own, (start, 30.0), (goal, speed))
    egos = (*line, *witnesses)
    offsets, rider = (-DEEP_M, street.across_m), (values["riding_speed"], values["lead_m"])
    riders = tuple(
        StepOut(BODIES["e-scooter"], place, offsets, *rider).build(roads, own, f"rider{k}", line[k % len(line)])
        for k, place in enumerate(places)
    )
    vehicles = build_traffic(roads, street.streams, round(values["vehicles"]), seed, (*egos, *riders))
    poses = [compute_pose(roads, own, place, street.across_m) for place in places]
    masts = tuple(build_mast(f"mast{k}", pose) for k, pose in enumerate(poses))
    return FamilyScene(roads, egos, vehicles, riders, () if has_witness else masts)


def _choose_places(passages: list[float], values: Values) -> list[float]:
    """Return the stations [m] of the riders, the first at the share `place` of the passages."""
    if not passages:
        raise ProposalRejected(PipelineStage.WAYS, "expected a passage between houses, found none")
    chosen = [passages[min(int(values["place"] * len(passages)), len(passages) - 1)]]
    for station in passages:
        if station - chosen[-1] >= SPACING_M:
            chosen.append(station)
    return chosen[: round(values["pedestrians"])]
