"""The frames of one drive: what its CAVs see and send at some ticks, with the truth. Scans are cast after the drive.

Own states and scans are those that the CAVs would have had in the drive: they depend on the episode's seed and on the
recorded states, which are rounded to 1 mm and 0.1 mrad.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from mdrive_sumo.agents.learned.fusion_spec import CLASSES, DELAYS_TICKS, GRID_REACH_M, MAX_CAVS
from mdrive_sumo.agents.learned.network_inputs import LIDAR_ID
from mdrive_sumo.agents.learned.point_grid import SCAN_SENSOR, Cells, build_point_cells, find_points_inside
from mdrive_sumo.contract import PointCloud
from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float, Int
from mdrive_sumo.core.seeding import draw_first_uniform
from mdrive_sumo.core.state import TICKS_PER_SECOND, RoadUsers
from mdrive_sumo.episode import EpisodeRecord, rebuild_frame
from mdrive_sumo.learning.drive_episode import CollectedDrive
from mdrive_sumo.learning.fusion.frames import ARRAYS, MAX_BOXES, MOTION_S, FusionFrames
from mdrive_sumo.learning.scene_labels import to_ego_poses
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.sensing.camera.road_user_models import RoadUserModel, choose_models
from mdrive_sumo.sensing.observation_builder import ObservationBuilder, build_sensing_frame
from mdrive_sumo.sensing.sensing_frame import derive_track_name
from mdrive_sumo.v2x.comm_settings import PRESETS
from mdrive_sumo.v2x.messages import FEATURE

SCAN_TICKS = 2
"""Between two turns of the LiDAR."""
SENDER_RANGE_M = PRESETS["realistic"].find_link(FEATURE).range_m
"""Cars farther away are no senders."""
SAME_VIEW_M = 1.0
"""Cars that have moved less than that see the same again: a quarter of a car's length. Chosen."""
POINTS_SHARE = 0.05
"""Share of the sampled ticks of which points are kept."""
CLASS_OF_MODEL = np.full(len(RoadUserModel), -1, np.int8)
"""Index into `CLASSES` by `RoadUserModel`; -1: no target."""
for _model, _name in (
    *((model, "vehicle") for model in (RoadUserModel.CAR, RoadUserModel.VAN, RoadUserModel.TRUCK, RoadUserModel.BUS)),
    *((model, "rider") for model in (RoadUserModel.MOTORCYCLE, RoadUserModel.CYCLIST)),
    (RoadUserModel.PEDESTRIAN, "pedestrian"),
):
    CLASS_OF_MODEL[_model] = CLASSES.index(_name)


@dataclass(frozen=True, slots=True)
class FrameSampling:
    """Which scenarios and which of their ticks become frames."""

    interval_ticks: int = 2 * TICKS_PER_SECOND
    """Between two sampled ticks; an even number above the greatest delay."""
    least_cavs: int = 2
    """Scenarios with fewer CAVs are not driven."""
    least_others: int = 0
    """Scenarios with fewer other road users are not driven."""

    def fits(self, scenario: Scenario) -> bool:
        """Return whether a scenario is driven."""
        others = len(scenario.background.vehicles) + len(scenario.actors)
        return len(scenario.egos) >= self.least_cavs and others >= self.least_others


@dataclass(frozen=True, slots=True)
class KeptPoints:
    """The points of some scans, for detectors that do not see through the point grid."""

    scan: npt.NDArray[np.int32]
    """(P,) numbers of the scans in the frames."""
    starts: npt.NDArray[np.int64]
    """(P + 1,) where in `points` each scan begins, and its end."""
    points: npt.NDArray[np.int16]
    """(M, 3) x, y, z [cm] in the frame of the sensor, those within the point grid."""
    intensity: npt.NDArray[np.uint8]
    """(M,) 255: all light comes back."""


@dataclass(frozen=True, slots=True)
class DriveFrames:
    """What becomes of a drive."""

    frames: FusionFrames
    points: KeptPoints
    left_out: int
    """Own cars at sampled ticks that had no sender, or saw the same again."""


@dataclass(frozen=True, slots=True)
class View:
    """One frame: a tick, and the columns of its cars, the own one first."""

    tick: int
    cars: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class _Scan:
    """What a car sees and believes in a tick."""

    cells: Cells
    cloud: PointCloud | None
    """Where points are kept."""
    estimate: Float
    """(3,) x, y [m], yaw [rad]: its estimated pose in the world."""
    box_points: Int
    """(N,) points within the grid on the road user of each column."""


def build_drive_frames(drive: CollectedDrive, sampling: FrameSampling) -> DriveFrames:
    """Return the frames of a drive, in the order of ticks and CAVs."""
    seed = drive.config.sensor_context.seed
    views, left_out = choose_views(drive.episode, sampling, seed)
    ticks = {view.tick for view in views}
    kept_ticks = frozenset(tick for tick in ticks if draw_first_uniform(seed, "points", tick) < POINTS_SHARE)
    scans = _cast_scans(drive, _list_needed(drive.episode, views), kept_ticks)
    return DriveFrames(_assemble(drive, views, scans), _keep_points(list(scans.values())), left_out)


def choose_views(episode: EpisodeRecord, sampling: FrameSampling, seed: int) -> tuple[list[View], int]:
    """Return the frames of an episode, and how many were left out.

    At a sampled tick every CAV is the own car of a frame, unless it has no sender, or neither it nor any of its senders
    has moved since its last frame with the same senders. The seed draws the first tick.
    """
    steps = int(draw_first_uniform(seed, "frames") * sampling.interval_ticks / SCAN_TICKS)
    views: list[View] = []
    left_out = 0
    latest: dict[int, View] = {}
    for tick in range(DELAYS_TICKS[-1] + SCAN_TICKS * steps, episode.ticks, sampling.interval_ticks):
        for own in np.flatnonzero(episode.valid[tick, : episode.egos]).tolist():
            view = View(tick, (own, *_find_senders(episode, tick, own)))
            if len(view.cars) == 1 or (own in latest and _is_same(episode, latest[own], view)):
                left_out += 1
                continue
            latest[own] = view
            views.append(view)
    return views, left_out


def _find_senders(episode: EpisodeRecord, tick: int, own: int) -> list[int]:
    """Return the columns of the nearest other CAVs in range, the nearest one first."""
    x, y = episode.x[tick, : episode.egos], episode.y[tick, : episode.egos]
    distance = np.where(episode.valid[tick, : episode.egos], portable.hypot(x - x[own], y - y[own]), np.inf)
    distance[own] = np.inf
    order = np.argsort(distance, kind="stable")[: MAX_CAVS - 1]
    return order[distance[order] <= SENDER_RANGE_M].tolist()


def _is_same(episode: EpisodeRecord, before: View, view: View) -> bool:
    if set(before.cars) != set(view.cars):
        return False
    cars = list(view.cars)
    dx, dy = (values[view.tick, cars] - values[before.tick, cars] for values in (episode.x, episode.y))
    return bool((portable.hypot(dx, dy) < SAME_VIEW_M).all())


_Key = tuple[int, int]
"""Tick and column of a scan."""


def _list_needed(episode: EpisodeRecord, views: Sequence[View]) -> dict[int, list[int]]:
    """Return the columns of the cars that scan, by tick, in ascending order."""
    needed: set[_Key] = set()
    for view in views:
        for slot, car in enumerate(view.cars):
            needed |= {(view.tick - delay, car) for delay in (DELAYS_TICKS if slot else DELAYS_TICKS[:1])}
    columns: dict[int, list[int]] = {}
    for tick, car in sorted(needed):
        if episode.valid[tick, car]:
            columns.setdefault(tick, []).append(car)
    return columns


def _cast_scans(
    drive: CollectedDrive, columns: Mapping[int, Sequence[int]], kept_ticks: frozenset[int]
) -> dict[_Key, _Scan]:
    """Return the scans of cars (columns by tick) by tick and column, in that order; kept_ticks: of kept points."""
    episode, context = drive.episode, drive.config.sensor_context
    named = replace(SCAN_SENSOR, options={**SCAN_SENSOR.options, "hit_ids": True})
    # Lights are not recorded, the free room beside a route takes long to measure, and a LiDAR needs neither.
    briefings = {
        ego: replace(one, traffic_lights=(), route_room=np.zeros((0, 2))) for ego, one in drive.briefings.items()
    }
    builder = ObservationBuilder(dict.fromkeys(briefings, (named,)), briefings, context)
    column_by_name: list[dict[str, int]] = []
    for ego in episode.ego_ids:
        salt = context.derive_track_salt(ego)
        column_by_name.append({derive_track_name(ego, name, salt): i for i, name in enumerate(episode.ids)})
    sizes = _list_sizes(episode)
    scans: dict[_Key, _Scan] = {}
    for tick, cars in columns.items():
        frame = rebuild_frame(episode, tick)
        egos = [episode.ids[car] for car in cars]
        seen = builder.build_observations(frame, build_sensing_frame(frame, sizes), {}, dict.fromkeys(egos, ()))
        for car, ego in zip(cars, egos, strict=True):
            cloud, own = seen[ego].lidar[LIDAR_ID], seen[ego].own
            points = _count_on_boxes(cloud, column_by_name[car], len(episode.ids))
            estimate = np.array((own.x, own.y, own.yaw))
            cells, kept = build_point_cells(cloud.points), cloud if tick in kept_ticks else None
            scans[tick, car] = _Scan(cells, kept, estimate, points)
    return scans


def _list_sizes(episode: EpisodeRecord) -> dict[str, tuple[float, float]]:
    """Return length and width [m] by CAV."""
    return {ego: (float(episode.length[i]), float(episode.width[i])) for i, ego in enumerate(episode.ego_ids)}


def _count_on_boxes(cloud: PointCloud, column_by_name: Mapping[str, int], columns: int) -> Int:
    """Return the points within the grid on each road user (columns,)."""
    on_thing = np.flatnonzero(cloud.hit >= 0)
    hit = cloud.hit[on_thing[find_points_inside(cloud.points[on_thing])]]
    counts = np.zeros(columns, np.int64)
    for name, count in zip(cloud.names, np.bincount(hit, minlength=len(cloud.names)).tolist(), strict=True):
        if name in column_by_name:  # buildings are no road users
            counts[column_by_name[name]] = count
    return counts


def _keep_points(scans: Sequence[_Scan]) -> KeptPoints:
    numbers = [number for number, scan in enumerate(scans) if scan.cloud is not None]
    clouds = [scan.cloud.points for scan in scans if scan.cloud is not None]
    kept = [cloud[find_points_inside(cloud)] for cloud in clouds]
    points = np.concatenate([np.zeros((0, 4), np.float32), *kept])
    return KeptPoints(
        scan=np.array(numbers, np.int32),
        starts=np.cumsum([0, *map(len, kept)], dtype=np.int64),
        points=np.rint(100.0 * points[:, :3]).astype(np.int16),
        intensity=np.rint(255.0 * np.clip(points[:, 3], 0.0, 1.0)).astype(np.uint8),
    )


def _assemble(drive: CollectedDrive, views: Sequence[View], scans: Mapping[_Key, _Scan]) -> FusionFrames:
    """Return the arrays of frames; scans are numbered in their order."""
    numbers = {key: number for number, key in enumerate(scans)}
    episode = drive.episode
    frames = _build_empty(len(views), drive.config.roads.name)
    poses = np.stack((episode.x, episode.y, episode.yaw), axis=-1)
    classes = _choose_classes(episode)
    for i, view in enumerate(views):
        frames.tick[i] = view.tick
        own_pose, own_estimate = poses[view.tick, view.cars[0]], scans[view.tick, view.cars[0]].estimate
        for slot, car in enumerate(view.cars):
            for j, delay in enumerate(DELAYS_TICKS if slot else DELAYS_TICKS[:1]):
                key = view.tick - delay, car
                if key in scans:  # a car may have come into the world since
                    frames.scan[i, slot, j] = numbers[key]
                    frames.true_pose[i, slot, j] = to_ego_poses(poses[key], own_pose)
                    frames.estimated_pose[i, slot, j] = to_ego_poses(scans[key].estimate, own_estimate)
        columns = np.flatnonzero(episode.valid[view.tick] & (classes >= 0))
        columns = columns[columns != view.cars[0]]
        boxes = np.column_stack(
            (to_ego_poses(poses[view.tick, columns], own_pose), episode.length[columns], episode.width[columns])
        )
        points = np.stack([scans[view.tick, car].box_points for car in view.cars], axis=-1)
        motion = _follow_boxes(episode, poses, view.tick, columns, own_pose)
        _fill_boxes(frames, i, _Boxes(columns, boxes, classes[columns], points[columns], motion))
    cells = [scan.cells for scan in scans.values()]
    return replace(
        frames,
        cells=np.concatenate([np.zeros(0, np.uint32), *cells]),
        scan_starts=np.cumsum([0, *map(len, cells)], dtype=np.int64),
    )


def _follow_boxes(episode: EpisodeRecord, poses: Float, tick: int, columns: Int, own_pose: Float) -> Float:
    """Return the poses (M, len(MOTION_S), 3) of road users (M,) at MOTION_S after a tick, in the frame of a pose.

    poses: (ticks, road users, 3) in the world. NaN: not in the world, or not in the time of the drive.
    """
    ticks = tick + np.rint(TICKS_PER_SECOND * np.array(MOTION_S)).astype(np.int64)
    is_driven = (ticks >= 0) & (ticks < episode.ticks)
    ticks = np.where(is_driven, ticks, 0)
    is_there = is_driven & episode.valid[ticks][:, columns].T
    return np.where(is_there[..., None], to_ego_poses(poses[ticks][:, columns].swapaxes(0, 1), own_pose), np.nan)


def _choose_classes(episode: EpisodeRecord) -> npt.NDArray[np.int8]:
    """Return the class (N,) of each road user of an episode; -1: no target."""
    e = episode
    return CLASS_OF_MODEL[
        choose_models(RoadUsers(e.ids, e.kind, e.x[0], e.y[0], e.yaw[0], e.speed[0], e.length, e.width))
    ]


def _build_empty(count: int, place: str) -> FusionFrames:
    """Return frames without scans and boxes."""
    fill: dict[str, float] = {"scan": -1, "true_pose": np.nan, "estimated_pose": np.nan, "boxes": np.nan}
    fill |= {"box_class": -1, "box_id": -1, "box_motion": np.nan}
    sizes = {"frames": count, "scans + 1": 1, "cells": 0}
    arrays: dict[str, Any] = {}
    for name, one in ARRAYS.items():
        shape = [size if isinstance(size, int) else sizes[size] for size in one.shape]
        arrays[name] = np.full(shape, fill.get(name, 0), one.dtype)
    return FusionFrames((place,), **arrays)


@dataclass(frozen=True, slots=True)
class _Boxes:
    """Road users around a car (M,)."""

    columns: Int
    boxes: Float
    """(M, 5) in the car's frame."""
    classes: npt.NDArray[np.int8]
    points: Int
    """(M, cars)"""
    motion: Float
    """(M, len(MOTION_S), 3) in the car's frame."""


def _fill_boxes(frames: FusionFrames, i: int, found: _Boxes) -> None:
    """Write the boxes of a frame: those within the grid, those with points first, then the nearest ones."""
    distance = portable.hypot(found.boxes[:, 0], found.boxes[:, 1])
    order = np.lexsort((distance, found.points.sum(axis=1) == 0))
    order = order[(np.abs(found.boxes[order, :2]) < GRID_REACH_M).all(axis=1)][:MAX_BOXES]
    count = len(order)
    frames.boxes[i, :count] = found.boxes[order]
    frames.box_class[i, :count] = found.classes[order]
    frames.box_id[i, :count] = found.columns[order]
    frames.box_points[i, :count, : found.points.shape[1]] = found.points[order]
    assert frames.box_motion is not None
    frames.box_motion[i, :count] = found.motion[order]
