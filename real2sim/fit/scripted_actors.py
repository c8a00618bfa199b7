"""Objects of a log that SUMO does not drive: static ones, pedestrians and cyclists, vehicles without a usable route."""

from collections.abc import Sequence

import numpy as np
import shapely

from mdrive_sumo.core.geometry import box_corners, boxes_corners, boxes_overlap
from mdrive_sumo.core.state import Kind
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario_part import Pose
from mdrive_sumo.scenario.scripted_actor import KIND_BY_NAME, Actor, KindName, Motion, ReplayMotion, StandingMotion
from real2sim.fit.background_vehicle import RoutedTrack, median_size, timed_poses
from real2sim.fit.centreline_traffic import CentrelineTraffic, find_vehicles_through
from real2sim.recording import RecordedTrack

MAX_LANE_WIDTH_M = 6.0
"""[m] Widths of recovered lanes are at most this (`network_builder.PLAUSIBLE_WIDTHS_M`)."""
NAMES: dict[Kind, KindName] = {kind: name for name, kind in KIND_BY_NAME.items()}


def build_replay_actor(
    track: RecordedTrack, name: str, traffic: CentrelineTraffic, roads: RoadMap, dt_s: float
) -> tuple[Actor, str]:
    """Return an actor that repeats the track and stops for obstacles, and a remark.

    If the log ends before it leaves, it stays where it is, unless that is on a lane: there it would stand for ever in
    the way of traffic that drives on, so it leaves as everything does that the log loses.
    """
    timed = timed_poses(track, dt_s)
    x, y, yaw = timed[0][1:]
    length, width = median_size(track)
    corners = boxes_corners(track.x, track.y, np.nan_to_num(track.yaw), np.array(length), np.array(width))
    around = find_vehicles_through(traffic, track.valid, corners)
    is_cut_off = bool(track.valid[-1])
    is_in_the_way = is_cut_off and is_on_lane(roads, float(track.x[-1]), float(track.y[-1]), width)
    actor = Actor(
        id=name,
        kind=NAMES[track.category.kind],
        model=track.category.value,
        start=Pose(x=x, y=y, yaw=yaw),
        length=length,
        width=width,
        motion=ReplayMotion(poses=_unwrap_yaws(timed), stays=is_cut_off and not is_in_the_way),
        mirrored=not around,
    )
    leaves = "leaves with the end of the log, which it spends on a lane" if is_in_the_way else ""
    return actor, "; ".join(part for part in (_describe_passing_vehicles(around), leaves) if part)


def is_on_lane(roads: RoadMap, x: float, y: float, width: float) -> bool:
    """Return whether an object of this width [m] at (x, y) [m] is in the corridor of a driving lane."""
    point = shapely.Point(x, y)
    return any(
        shapely.LineString(lane.centre.xy).distance(point) < (lane.width + width) / 2
        for lane in roads.find_lanes_near(x, y, (MAX_LANE_WIDTH_M + width) / 2)
    )


def _describe_passing_vehicles(around: Sequence[str]) -> str:
    if not around:
        return ""
    return f"not seen by SUMO's traffic: passed by {', '.join(around[:3])}{', ...' if len(around) > 3 else ''}"


def _unwrap_yaws(timed: Sequence[tuple[float, float, float, float]]) -> tuple[tuple[float, float, float, float], ...]:
    """Unwrap the yaws: replays interpolate linearly from one pose to the next."""
    yaw = np.round(np.unwrap([pose[3] for pose in timed]), 4)
    return tuple((t, x, y, float(a)) for (t, x, y, _), a in zip(timed, yaw, strict=True))


def build_standing_actor(track: RecordedTrack, name: str, traffic: CentrelineTraffic, dt_s: float) -> tuple[Actor, str]:
    """Return an actor that never moves, and a remark.

    Where a vehicle of the log drives through its place at another time, the actor is present only while the log shows
    it. Where a vehicle drove around it, SUMO's traffic, which cannot, ignores it.
    """
    x, y = (round(float(np.median(values[track.valid])), 3) for values in (track.x, track.y))
    yaw = track.yaw[track.valid]
    heading = round(float(np.arctan2(np.nan_to_num(np.sin(yaw)).sum(), np.nan_to_num(np.cos(yaw)).sum())), 4)
    length, width = median_size(track)
    box = box_corners(x, y, heading, length, width)
    motion: Motion = StandingMotion()
    said: list[str] = []
    if any(_is_driven_through(box, driver, track) for driver in traffic.drivers):
        first, last = int(track.valid_frames[0]) * dt_s, (int(track.valid_frames[-1]) + 1) * dt_s
        motion = ReplayMotion(
            poses=((round(first, 3), x, y, heading), (round(last, 3), x, y, heading)), stays=bool(track.valid[-1])
        )
        said.append("there only while the log shows it: a vehicle drives through its place at another time")
    around = find_vehicles_through(
        traffic, np.ones(len(track.valid), dtype=np.bool_), np.tile(box, (len(track.valid), 1, 1))
    )
    said.append(_describe_passing_vehicles(around))
    actor = Actor(
        id=name,
        kind=NAMES[track.category.kind],
        model=track.category.value,
        start=Pose(x=x, y=y, yaw=heading),
        motion=motion,
        mirrored=not around,
        length=length,
        width=width,
    )
    return actor, "; ".join(part for part in said if part)


def _is_driven_through(box: np.ndarray, driver: RoutedTrack, track: RecordedTrack) -> bool:
    """Return whether the vehicle overlaps the box in a frame in which the object is not seen."""
    rows = driver.track.valid & ~track.valid
    if not rows.any():
        return False
    moving = driver.track
    near = rows & (np.hypot(moving.x - box[:, 0].mean(), moving.y - box[:, 1].mean()) < 30.0)
    if not near.any():
        return False
    yaw = np.nan_to_num(moving.yaw[near])
    boxes = boxes_corners(moving.x[near], moving.y[near], yaw, np.array(driver.length), np.array(driver.width))
    return bool(boxes_overlap(boxes, box[None]).any())
