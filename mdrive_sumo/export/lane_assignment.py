"""The lane of every vehicle in every tick, which a recording does not have."""

from collections import defaultdict
from typing import Any

import numpy as np
import shapely

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float, Int
from mdrive_sumo.core.state import Kind
from mdrive_sumo.export.scored_recording import ScoredRecording
from mdrive_sumo.roads import Lane, RoadMap

NEARBY_M = 4.0
"""[m] A vehicle farther from every centre line is off the road."""
AGAINST_M = 4.0
"""[m] What a direction across the lane's counts in distance; one against it counts twice."""
ROUTE_M = 2.0
"""[m] By how much the lanes of a CAV's route count as nearer."""
NO_LANE = -1
"""Index of the lane of a road user that is on none."""


def assign_lanes(recording: ScoredRecording, x: Float, y: Float) -> tuple[Int, Float]:
    """Return the lane, an index into `roads.driving`, and the position along it [m] of points x, y (T, N).

    The lane is the nearest one that leads where the vehicle points; `NO_LANE` for pedestrians, the absent, and off the
    road.
    """
    record, roads = recording.record, recording.roads
    lane = np.full(record.valid.shape, NO_LANE, dtype=np.int64)
    position = np.zeros(record.valid.shape)
    is_vehicle = record.kind != Kind.PEDESTRIAN
    ticks, columns = np.nonzero(record.valid & is_vehicle)
    points: Any = shapely.points(x[ticks, columns], y[ticks, columns])
    lines = np.array([shapely.LineString(driving_lane.centre.xy) for driving_lane in roads.driving], dtype=object)
    rows, near_lanes = shapely.STRtree(lines).query(points, predicate="dwithin", distance=NEARBY_M)
    if not len(rows):
        return lane, position
    stations = shapely.line_locate_point(lines[near_lanes], points[rows])
    yaws = np.empty(len(near_lanes))
    for index in np.unique(near_lanes):
        yaws[near_lanes == index] = roads.driving[index].centre.yaws_at(stations[near_lanes == index])
    turn = portable.cos(yaws - record.yaw[ticks[rows], columns[rows]])
    cost = shapely.distance(lines[near_lanes], points[rows]) + AGAINST_M * (1.0 - turn)
    cost -= ROUTE_M * _lies_on_route(recording)[columns[rows], near_lanes]
    order = np.lexsort((near_lanes, cost, rows))
    first = order[np.unique(rows[order], return_index=True)[1]]
    chosen = rows[first]
    lane[ticks[chosen], columns[chosen]] = near_lanes[first]
    position[ticks[chosen], columns[chosen]] = stations[first]
    return lane, position


def _lies_on_route(recording: ScoredRecording) -> np.ndarray:
    """Return whether each lane (L,) is one of the route of each column, (N, L); never for others than CAVs."""
    record, roads = recording.record, recording.roads
    index = {lane.id: n for n, lane in enumerate(roads.driving)}
    mask = np.zeros((len(record.ids), len(roads.driving)), dtype=np.bool_)
    for column, ego in enumerate(recording.scenario.egos):
        mask[column, [index[lane] for lane in ego.lanes if lane in index]] = True
    return mask


def offset_points(points: Float, left_m: float) -> Float:
    """Return points (N, 2) shifted to the left, perpendicular to the mean direction of their two segments."""
    ahead = np.diff(points, axis=0)
    ahead /= portable.hypot(ahead[:, 0], ahead[:, 1])[:, None]
    mean = np.concatenate((ahead[:1], ahead)) + np.concatenate((ahead, ahead[-1:]))
    mean /= np.maximum(portable.hypot(mean[:, 0], mean[:, 1]), 1e-9)[:, None]
    return points + left_m * np.column_stack((-mean[:, 1], mean[:, 0]))


def compute_bounds(lane: Lane) -> tuple[Float, Float]:
    """Return the left and the right bound (N, 2) [m], with as many points as the centre line."""
    return offset_points(lane.centre.xy, lane.width / 2), offset_points(lane.centre.xy, -lane.width / 2)


def compute_outline(lane: Lane) -> Float:
    """Return the corners (2 N, 2) [m] of a lane's area: the left bound, then the right one backwards."""
    left, right = compute_bounds(lane)
    return np.concatenate((left, right[::-1]))


def find_predecessors(roads: RoadMap) -> dict[str, tuple[str, ...]]:
    """Return the ids of the lanes that lead into each lane, by its id."""
    entries: defaultdict[str, list[str]] = defaultdict(list)
    for lane in roads.driving:
        for successor in lane.successors:
            entries[successor].append(lane.id)
    return {lane.id: tuple(entries[lane.id]) for lane in roads.driving}
