"""Poses beside the lanes of a network: where people walk, wait and ride."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from mdrive_sumo.roads import Lane, RoadMap
from mdrive_sumo.scenario.scenario_part import Pose
from mdrive_sumo.worlds.placement.lane_chains import compute_lane_pose

LEAST_LANE_M = 20.0
"""[m] Shorter lanes, such as those beside a turning lane, have no people of their own."""
REACH_M = 14.0
"""[m] From a lane's centre to the far edge of its pavement: a parking lane and a cycle lane may lie between."""
LEAST_PAVEMENT_M = 1.2
"""[m] People do not walk on less."""
CYCLE_LANE_M = (1.2, 2.6)
"""[m] Width of the strip between lane and pavement that is a cycle lane, if nothing parks there."""


@dataclass(frozen=True)
class KerbSide:
    """A kerb lane with what lies to its right, measured at its middle."""

    lane: Lane
    near_m: float
    """[m] From the lane's centre to the near edge of the pavement."""
    far_m: float
    can_cycle: bool
    """Whether a cycle lane lies between lane and pavement."""


def find_kerb_sides(roads: RoadMap) -> list[KerbSide]:
    """Return the sides with a pavement along the rightmost car lanes that are long enough."""
    pavement = shapely.union_all([shapely.Polygon(outline).buffer(0) for outline in roads.pavements])
    parked = [shapely.LineString(row.xy) for row in roads.parking]
    kerbs = [lane for lane in roads.driving if not lane.junction and not lane.right]
    found = (_measure_side(lane, pavement, parked) for lane in kerbs if lane.centre.length >= LEAST_LANE_M)
    return [side for side in found if side is not None]


def _measure_side(lane: Lane, pavement: shapely.Geometry, parked: Sequence[shapely.LineString]) -> KerbSide | None:
    begin = shapely.Point(lane.centre.at(lane.centre.length / 2))
    parts = shapely.get_parts(shapely.intersection(_draw_across(lane, REACH_M), pavement))
    if not len(parts):
        return None
    near = shapely.distance(begin, parts)
    first = int(np.argmin(near))
    near_m = float(near[first])
    far_m = near_m + float(shapely.length(parts[first]))
    if far_m - near_m < LEAST_PAVEMENT_M:
        return None
    gap_m = near_m - lane.width / 2
    is_free = not any(shapely.dwithin(row, _draw_across(lane, near_m), REACH_M) for row in parked)
    return KerbSide(lane, near_m, far_m, is_free and CYCLE_LANE_M[0] <= gap_m <= CYCLE_LANE_M[1])


def _draw_across(lane: Lane, right_m: float) -> shapely.LineString:
    """Return a line from the middle of a lane's centre to its right."""
    middle = lane.centre.length / 2
    end = compute_lane_pose(lane, middle, -right_m)
    return shapely.LineString([lane.centre.at(middle), (end.x, end.y)])


def compute_cycling_pose(side: KerbSide, s: float) -> Pose:
    """Return a pose in the middle of the cycle lane."""
    return compute_lane_pose(side.lane, s, -(side.lane.width / 2 + side.near_m) / 2)


def compute_walking_pose(side: KerbSide, s: float, aside: float) -> Pose:
    """Return a pose on the pavement, `aside` from -1 (at the kerb) to 1 (at the houses)."""
    half_m = (side.far_m - side.near_m) / 2
    return compute_lane_pose(side.lane, s, -(side.near_m + half_m * (1 + 0.7 * aside)))
