"""Right turn across a cyclist who rides on the pavement behind a row of parked vans; a mast at the corner sees it.

No CAV can: the row hides the cyclist from the road, and the corner house from the side street.
"""

from dataclasses import dataclass

from mdrive_sumo.generate.hard.family import (
    FamilyParameter,
    FamilyScene,
    ScenarioFamily,
    Values,
    load_network,
)
from mdrive_sumo.generate.hard.family_streets import CORRIDORS, Corridor
from mdrive_sumo.generate.rejection import PipelineStage, ProposalRejected
from mdrive_sumo.roads import RoadMap, find_lane_path
from mdrive_sumo.scenario.scenario import Ego
from mdrive_sumo.scenario.scenario_part import Pose
from mdrive_sumo.scenario.scripted_actor import Actor
from mdrive_sumo.worlds.placement.bodies import BODIES, build_mast, build_rider
from mdrive_sumo.worlds.placement.cavs import build_platoon
from mdrive_sumo.worlds.placement.lane_chains import (
    Lanes,
    build_pose_line,
    compute_chain_length,
    compute_pose,
    find_lane_start,
    find_station,
    find_station_beside,
)
from mdrive_sumo.worlds.placement.parked_vehicles import KERB_ROW_M, PAVEMENT_M, ParkedRow, build_parked_row
from mdrive_sumo.worlds.streams.edge_streams import build_traffic

SITES = ((0, 1, 1), (0, 2, 1), (1, 1, 1), (1, 2, 1), (1, 3, 1), (2, 1, 2))
"""Corridor, junction, and SUMO index of the side street's lane. Green or without a light in the first seconds."""
MEAN_SPEED = 9.0
"""[m/s] Of a CAV that slows down for the turn."""
BEYOND_STOP_LINE_M = 30.0
"""[m] The cyclist's path, the mast and the searched crossing reach this far beyond the stop line."""
ROW_M = 70.0
"""[m] Length of the row of parked vehicles."""


@dataclass(frozen=True, slots=True)
class _Corner:
    """The corner of a candidate."""

    corridor: Corridor
    roads: RoadMap
    straight: Lanes
    turn: Lanes
    stop_m: float
    """Station [m] of the stop line on both chains."""
    crossing_m: float
    """Station [m] on the turn where it crosses the cyclist's path."""


def _find_corner(site: float) -> _Corner:
    corridor_index, junction, side_lane = SITES[min(int(site), len(SITES) - 1)]
    corridor = CORRIDORS[corridor_index]
    roads, lane = load_network(corridor.network), corridor.lanes[0]
    straight = corridor.find_chain(roads, "east", lane)
    turn = find_lane_path(roads, f"east_0_{lane}", f"south_{junction}_out_{side_lane}")
    last = f"east_{junction - 1}_{lane}"
    stop = find_lane_start(roads, straight, last) + roads.lanes[last].centre.length
    ride = _build_ride(roads, straight, (stop - 20.0, stop + BEYOND_STOP_LINE_M))
    bend = [compute_pose(roads, turn, stop + d) for d in range(int(BEYOND_STOP_LINE_M))]
    met = build_pose_line(ride).intersection(build_pose_line(bend))
    if met.is_empty:
        raise ProposalRejected(PipelineStage.WAYS, f"network {roads.name}: expected a turn that crosses the pavement")
    return _Corner(corridor, roads, straight, turn, stop, find_station(roads, turn, met.centroid.x, met.centroid.y))


def _build_ride(roads: RoadMap, straight: Lanes, between: tuple[float, float]) -> list[Pose]:
    """Return poses on the pavement beside a chain of lanes, about every 3 m."""
    count = max(int((between[1] - between[0]) / 3.0), 2)
    stations = [between[0] + (between[1] - between[0]) * i / (count - 1) for i in range(count)]
    return [compute_pose(roads, straight, station, -PAVEMENT_M) for station in stations]


def stage_right_turn_cyclist(values: Values, seed: str) -> FamilyScene:
    """Return the scene of a candidate: CAV 0 turns right, a mast at the corner sees the cyclist."""
    corner = _find_corner(values["site"])
    roads = corner.roads
    start = max(corner.crossing_m - values["own_m"], 3.0)
    goal = min(corner.crossing_m + 50.0, compute_chain_length(roads, corner.turn) - 3.0)
    needed_s = (corner.crossing_m - start) / MEAN_SPEED + values["gap_s"]
    cyclist = _build_cyclist(corner, max(needed_s, 1.0), values["cycling_speed"])
    end = corner.stop_m - values["row_end_m"]
    row = ParkedRow(corner.straight, (max(end - ROW_M, 3.0), end), -KERB_ROW_M, van_share=0.7)
    parked = build_parked_row(roads, row, seed, "row")
    own, *names = (str(k) for k in range(round(values["cavs"])))
    line = build_platoon(roads, [own, *names[::2]], corner.turn, (start, 20.0), (goal, values["own_speed"]))
    egos = (*line, *_build_oncoming(corner, names[1::2]))
    vehicles = build_traffic(roads, corner.corridor.all_streams, round(values["vehicles"]), seed, egos)
    mast = build_mast("mast", compute_pose(roads, corner.straight, corner.stop_m + BEYOND_STOP_LINE_M, -PAVEMENT_M))
    return FamilyScene(roads, egos, vehicles, (cyclist, *parked), (mast,), signals=True)


def _build_cyclist(corner: _Corner, needed_s: float, speed: float) -> Actor:
    """Return a cyclist who rides from the start on and reaches the crossing after `needed_s`, or as late as it can."""
    crossing = find_station_beside(corner.roads, corner.straight, corner.turn, corner.crossing_m)
    begin = max(crossing - speed * needed_s, 1.0)
    poses = _build_ride(corner.roads, corner.straight, (begin, crossing + BEYOND_STOP_LINE_M))
    return build_rider("cyclist", BODIES["bicycle"], poses, round(speed, 2))


def _build_oncoming(corner: _Corner, names: list[str]) -> list[Ego]:
    roads, lane = corner.roads, corner.corridor.lanes[-1]
    lanes = corner.corridor.find_chain(roads, "west", lane)
    beside = find_station_beside(roads, lanes, corner.straight, corner.stop_m)
    return build_platoon(roads, names, lanes, (max(beside - 80.0, 3.0), 22.0), (beside + 50.0, 11.0))


FAMILY = ScenarioFamily(
    category="right-turn-cyclist",
    description="Right turn across a cyclist who rides on the pavement behind a row of parked vans.",
    parameters=(
        FamilyParameter("site", 0.0, float(len(SITES)), "", "corridor and junction"),
        FamilyParameter("own_m", 40.0, 110.0, "m", "distance of CAV 0 from the cyclist's path"),
        FamilyParameter("own_speed", 5.0, 13.8, "m/s", "start speed of CAV 0"),
        FamilyParameter("gap_s", -2.0, 2.0, "s", "how much later than CAV 0 the cyclist reaches the crossing"),
        FamilyParameter("cycling_speed", 3.5, 8.0, "m/s", "speed of the cyclist"),
        FamilyParameter("row_end_m", 1.0, 12.0, "m", "distance of the parked row from the stop line"),
        FamilyParameter("cavs", 2.0, 5.0, "", "number of CAVs"),
        FamilyParameter("vehicles", 0.0, 120.0, "", "number of reactive vehicles"),
    ),
    stage=stage_right_turn_cyclist,
)
