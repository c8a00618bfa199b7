"""Columns of CAVs that are due at a place of a way at a given time."""

from collections.abc import Iterable
from dataclasses import dataclass

from mdrive_sumo.generate.hard.sites.junction_ways import compute_timing
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import Ego
from mdrive_sumo.scenario.start_boxes import CAR
from mdrive_sumo.worlds.placement.cavs import NoRoomError, build_cav
from mdrive_sumo.worlds.placement.lane_chains import Lanes, compute_chain_length

RIM_M = 5.0
"""[m] Least distance of a vehicle's centre from the beginning of its lanes, and of a goal from their end."""
GOAL_M = 45.0
"""[m] From the conflict to the goals: a CAV has left the junction and a wreck in it by then."""
SLOW_MPS = 4.0
"""[m/s] Least speed of a car in a bend of a junction by which its place in a column is reckoned."""
LEAST_LEAD_S = 1.5
"""[s] A column that would be due earlier has no room: a driver could not react."""


@dataclass(frozen=True, slots=True)
class CavColumn:
    """CAVs one behind the other on a chain of lanes, that drive at the limits as long as nothing is in their way."""

    lanes: Lanes
    at_m: float
    """Station [m] at which they are due."""
    count: int
    due_s: float
    """[s] After which the first one is due there."""
    headway_s: float
    """[s] From a rear bumper to the next front bumper."""


def build_columns(roads: RoadMap, columns: Iterable[CavColumn]) -> tuple[Ego, ...]:
    """Return the CAVs of all columns, with ids "0", "1", ... in their order; as many as have room on the lanes.

    Raises NoRoomError for a column with no room for its first CAV.
    """
    egos: list[Ego] = []
    for column in columns:
        timing = compute_timing(roads, column.lanes)
        goal_m = min(column.at_m + GOAL_M, compute_chain_length(roads, column.lanes) - RIM_M)
        first_s = max(column.due_s, LEAST_LEAD_S)
        pitch_s = column.headway_s + CAR.length / max(timing.find_speed(column.at_m), SLOW_MPS)
        for k in range(column.count):
            lead_s = first_s + k * pitch_s
            start_m = timing.find_start(column.at_m, lead_s)
            if start_m < RIM_M:
                if k == 0:
                    raise NoRoomError(
                        f"lanes {column.lanes[0]}: expected room for a CAV {lead_s:.1f} s ahead, found none"
                    )
                break
            start_speed = timing.find_speed(start_m)
            egos.append(build_cav(roads, str(len(egos)), column.lanes, (start_m, goal_m), start_speed))
    return tuple(egos)
