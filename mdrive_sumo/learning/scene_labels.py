"""What is true around a CAV at a decision: boxes, their futures, occupancy, lanes. Read from the finished recording."""

from collections.abc import Mapping
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from mdrive_sumo.agents.learned.ego_frame import convert_to_frame
from mdrive_sumo.agents.learned.system_spec import (
    LIDAR_BEHIND_M,
    LIDAR_CELL_M,
    LIDAR_CELLS,
    PLAN_INTERVAL_S,
    PLAN_POINTS,
)
from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Bool, Float, Int, boxes_corners, wrap_angles
from mdrive_sumo.core.state import DT, TICKS_PER_SECOND
from mdrive_sumo.episode import EpisodeRecord, rebuild_frame
from mdrive_sumo.learning.sample_format import LANE_POINTS, MAX_LANES, OCCUPANCY_LAYERS
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.sensing.camera.road_user_models import choose_models
from mdrive_sumo.sensing.objects_sensor import load_building_edges
from mdrive_sumo.sensing.observation_builder import build_sensing_frame
from mdrive_sumo.sensing.polygon_fill import box_edges, fill_polygons
from mdrive_sumo.sensing.sensing_frame import SensorPose
from mdrive_sumo.sensing.visibility import SightView

LABELLED_RANGE_M = 60.0
"""Boxes farther away from the box centre are left out."""
REMEMBERED_TICKS = 2 * TICKS_PER_SECOND
"""Occupancy has what was visible at a decision of the last 2 s: what a network with memory can know."""
LATER_TICKS = round(PLAN_INTERVAL_S * TICKS_PER_SECOND) * np.arange(1, PLAN_POINTS + 1)
"""(PLAN_POINTS,) ticks from the decision to the points of a plan."""
Labels = dict[str, npt.NDArray[np.generic]]


class SceneLabels:
    """Labels of one episode. Ask in the order of ticks: it remembers what each CAV has seen."""

    def __init__(self, episode: EpisodeRecord, roads: RoadMap) -> None:
        self._episode, self._roads = episode, roads
        self._poses: Float = np.stack((episode.x, episode.y, episode.yaw), axis=-1)
        """(T, N, 3)"""
        self._sizes: Float = np.stack((episode.length, episode.width), axis=-1)
        self._seen_tick: dict[int, Int] = {}
        """(N,) tick in which each column was last visible, by column of the CAV."""

    def build(self, tick: int, cavs: list[int]) -> Mapping[int, Labels]:
        """Return the labels of a tick by column of the CAV; cavs: columns of CAVs that are in the world."""
        episode = self._episode
        frame = rebuild_frame(episode, tick)
        columns = np.flatnonzero(episode.valid[tick])
        sizes = {ego: (float(self._sizes[i, 0]), float(self._sizes[i, 1])) for i, ego in enumerate(episode.ego_ids)}
        scene = build_sensing_frame(frame, sizes)
        classes, edges = choose_models(scene.boxes), load_building_edges(self._roads)
        rows = {column: row for row, column in enumerate(columns.tolist())}
        eyes = {cav: _build_eye(self._poses[tick, cav], rows[cav]) for cav in cavs}
        labels_by_cav: dict[int, Labels] = {}
        for cav, eye in eyes.items():
            view = SightView(eye, scene, edges, LABELLED_RANGE_M)
            distances = view.distances()
            near = np.flatnonzero(distances <= LABELLED_RANGE_M)
            near = near[np.argsort(distances[near], kind="stable")]
            visible = view.visible_rows(0.0)[near]
            labels_by_cav[cav] = self._build_one(tick, cav, columns[near], visible, classes[near])
        return labels_by_cav

    def _build_one(self, tick: int, cav: int, columns: Int, visible: Bool, classes: Int) -> Labels:
        own = self._poses[tick, cav]
        now = to_ego_poses(self._poses[tick, columns], own)
        later = self._find_futures(tick, columns, own)
        boxes = np.column_stack(
            (now, self._sizes[columns], self._episode.speed[tick, columns], classes, visible, columns)
        )
        lanes = load_lane_graph(self._roads).find_lines(float(own[0]), float(own[1]))
        is_remembered = self._remember(tick, cav, columns, visible)
        return {
            "boxes": boxes.astype(np.float32),
            "futures": later.astype(np.float32),
            "occupancy": self._rasterize(tick, columns[is_remembered], now[is_remembered], later[is_remembered], own),
            "lane_graph": convert_to_frame(lanes, own).astype(np.float32),
        }

    def _find_futures(self, tick: int, columns: Int, own: Float) -> Float:
        """Return the poses (N, PLAN_POINTS, 3) at the plan's times in the ego frame of now; NaN: not in the world."""
        ticks = tick + LATER_TICKS
        recorded = np.minimum(ticks, self._episode.ticks - 1)[:, None]
        is_there = self._episode.valid[recorded, columns] & (ticks < self._episode.ticks)[:, None]
        poses = np.where(is_there[..., None], to_ego_poses(self._poses[recorded, columns], own), np.nan)
        return poses.transpose(1, 0, 2)

    def _remember(self, tick: int, cav: int, columns: Int, visible: Bool) -> Bool:
        """Return which of the columns the CAV sees or saw in the last `REMEMBERED_TICKS`."""
        seen = self._seen_tick.setdefault(cav, np.full(len(self._episode.ids), -REMEMBERED_TICKS - 1, dtype=np.int64))
        seen[columns[visible]] = tick
        return tick - seen[columns] <= REMEMBERED_TICKS

    def _rasterize(self, tick: int, columns: Int, now: Float, later: Float, own: Float) -> npt.NDArray[np.uint8]:
        """Return the packed occupancy. Beyond the end of the recording boxes go on at their last speed."""
        last = self._episode.ticks - 1
        after_s = np.maximum(tick + LATER_TICKS - last, 0) * DT
        if (after_s > 0.0).any():
            later = self._extrapolate(columns, later, after_s, own)
        poses = np.concatenate((now[:, None], later), axis=1)
        box, layer = np.nonzero(~np.isnan(poses[..., 0]))
        cells = rasterize_boxes(poses[box, layer], self._sizes[columns[box]], layer, OCCUPANCY_LAYERS)
        return np.packbits(cells)

    def _extrapolate(self, columns: Int, later: Float, after_s: Float, own: Float) -> Float:
        """Return futures in which times beyond the recording have poses, too."""
        last = self._episode.ticks - 1
        poses = np.repeat(to_ego_poses(self._poses[last, columns], own)[:, None], PLAN_POINTS, axis=1)
        driven_m = self._episode.speed[last, columns][:, None] * after_s
        cos, sin = portable.cos_sin(poses[..., 2])
        poses[..., 0] += cos * driven_m
        poses[..., 1] += sin * driven_m
        is_after = (after_s > 0.0) & self._episode.valid[last, columns][:, None]
        return np.where(is_after[..., None], poses, later)


def _build_eye(pose: Float, row: int) -> SensorPose:
    x, y, yaw = pose.tolist()
    return SensorPose(x, y, yaw, row)


def to_ego_poses(poses: Float, own: Float) -> Float:
    """Return poses (..., 3) x, y, yaw of the world in the ego frame of a pose (3,); yaw in [-pi, pi)."""
    return np.concatenate((convert_to_frame(poses[..., :2], own), wrap_angles(poses[..., 2:] - own[2])), axis=-1)


PARTS = 3
"""A cell is covered if one of 3 x 3 points in it is: points 0.25 m apart, because people are smaller than cells."""
POINT_M = LIDAR_CELL_M / PARTS
GRID_AHEAD_M, GRID_LEFT_M = LIDAR_CELLS * LIDAR_CELL_M - LIDAR_BEHIND_M, LIDAR_CELLS * LIDAR_CELL_M / 2
"""Upper and left edge of the grid from the box centre."""


def rasterize_boxes(poses: Float, sizes: Float, layer: Int, layers: int) -> npt.NDArray[np.uint8]:
    """Return a mask (layers, LIDAR_CELLS, LIDAR_CELLS) of 0 and 1: 1 where a box covers a part of a cell.

    poses: (K, 3) x, y [m], yaw [rad] in the ego frame. sizes: (K, 2) length, width [m]. layer: (K,). Row 0 is ahead,
    column 0 is left.
    """
    corners = boxes_corners(*poses.T, *sizes.T)
    pixels = np.stack(((GRID_LEFT_M - corners[..., 1]) / POINT_M, (GRID_AHEAD_M - corners[..., 0]) / POINT_M), axis=-1)
    size = LIDAR_CELLS * PARTS
    covered = fill_polygons(box_edges(pixels), np.repeat(layer, 4), (layers, size))
    rows = np.bitwise_or.reduce([covered[:, part::PARTS] for part in range(PARTS)])  # faster than any(axis)
    return np.bitwise_or.reduce([rows[:, :, part::PARTS] for part in range(PARTS)]) & np.uint8(1)


LANE_REACH_M = 40.0
SPACING_M = 1.0


class LaneGraph:
    """The centre lines of a map as points 1 m apart."""

    def __init__(self, roads: RoadMap) -> None:
        lines = [lane.centre.resample(SPACING_M).xy for lane in roads.driving]
        self._xy: Float = np.concatenate(lines)
        self._lane: Int = np.repeat(np.arange(len(lines)), [len(line) for line in lines])

    def find_lines(self, x: float, y: float) -> Float:
        """Return the lines (L, LANE_POINTS, 2) [m, world] within `LANE_REACH_M` of a place, the nearest ones first.

        A line is cut where it leaves the circle; of a lane that enters it several times the longest part counts.
        """
        distance = portable.hypot(self._xy[:, 0] - x, self._xy[:, 1] - y)
        near = np.flatnonzero(distance <= LANE_REACH_M)
        if not len(near):
            return np.zeros((0, LANE_POINTS, 2))
        breaks = np.flatnonzero((np.diff(near) != 1) | (np.diff(self._lane[near]) != 0)) + 1
        begin, end = np.concatenate(((0,), breaks)), np.concatenate((breaks, (len(near),)))
        begin, end = self._choose_longest(near, begin, end)
        gap = np.array([distance[near[i:j]].min() for i, j in zip(begin.tolist(), end.tolist(), strict=True)])
        order = np.argsort(gap, kind="stable")[:MAX_LANES]
        first, last = near[begin[order]], near[end[order] - 1]
        return self._resample(first, last)

    def _choose_longest(self, near: Int, begin: Int, end: Int) -> tuple[Int, Int]:
        """Return the longest part of every lane, without those of a single point."""
        length, lane = end - begin, self._lane[near[begin]]
        order = np.lexsort((begin, -length, lane))
        is_first = np.concatenate(((True,), np.diff(lane[order]) != 0))
        chosen = np.sort(order[is_first & (length[order] > 1)], kind="stable")
        return begin[chosen], end[chosen]

    def _resample(self, first: Int, last: Int) -> Float:
        place = first[:, None] + (last - first)[:, None] * np.linspace(0.0, 1.0, LANE_POINTS)
        low = np.minimum(place.astype(np.int64), np.maximum(last - 1, first)[:, None])
        share = (place - low)[..., None]
        return self._xy[low] * (1.0 - share) + self._xy[low + 1] * share


@lru_cache(maxsize=8)
def load_lane_graph(roads: RoadMap) -> LaneGraph:
    """Return the lane graph of a map, cached."""
    return LaneGraph(roads)
