"""Detects what SUMO's one-dimensional lanes cannot represent: two vehicles abreast in one lane, and objects that were
driven around.

SUMO keeps vehicles on the centre line. So every vehicle of the log is placed there; where boxes that were apart in the
log overlap then, one of them must be invisible to SUMO's traffic.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mdrive_sumo.core.geometry import Bool, Float, Int, boxes_corners, boxes_overlap
from mdrive_sumo.roads import RoadMap
from real2sim.fit.background_vehicle import RoutedTrack

PASSING_GAP_M = 0.3
"""[m] Free space on both sides of a box that SUMO's traffic passes."""
DEEP_M, LEAST_S = 0.25, 0.5
"""[m], [s] Vehicles in one lane are abreast if their boxes, each side moved inwards by this, overlap for that long."""
OVERLAP_RANGE_M = 30.0
"""[m] Boxes whose centres are further apart never overlap."""


@dataclass(frozen=True)
class CentrelineTraffic:
    """Vehicles on the centre lines of their lanes: poses (K, T, 3) x, y [m], yaw [rad], NaN without a lane."""

    drivers: Sequence[RoutedTrack]
    poses: Float

    @cached_property
    def lanes(self) -> Int:
        """The number (K, T) of the lane, -1 without one."""
        numbers = {"": -1}
        rows = [[numbers.setdefault(lane, len(numbers)) for lane in driver.match.lanes] for driver in self.drivers]
        return np.array(rows, dtype=np.int64)

    def corners(self, k: int, frames: np.ndarray, grown: float) -> Float:
        """Return the corners (N, 4, 2) of a vehicle's box in frames (N,), each side moved outwards by `grown` [m]."""
        driver, poses = self.drivers[k], self.poses[k, frames]
        length, width = max(driver.length + 2 * min(grown, 0.0), 0.1), max(driver.width + 2 * grown, 0.1)
        return boxes_corners(poses[:, 0], poses[:, 1], poses[:, 2], np.array(length), np.array(width))


def place_on_centrelines(drivers: Sequence[RoutedTrack], roads: RoadMap) -> CentrelineTraffic:
    """Place every vehicle on the centre line at its matched arc length."""
    frames = len(drivers[0].match.lanes) if drivers else 0
    poses = np.full((len(drivers), frames, 3), np.nan)
    for k, driver in enumerate(drivers):
        for frame in np.flatnonzero(np.isfinite(driver.progress) & np.isfinite(driver.match.s)).tolist():
            line, s = roads.lanes[driver.match.lanes[frame]].centre, float(driver.match.s[frame])
            poses[k, frame] = (*line.at(s), line.yaw_at(s))
    return CentrelineTraffic(drivers, poses)


def find_abreast(traffic: CentrelineTraffic, dt_s: float) -> dict[str, str]:
    """Return, by track id, why a vehicle cannot be in a lane: another one is beside it, nearer to the centre line."""
    reasons: dict[str, str] = {}
    drivers = traffic.drivers
    for k, candidate in enumerate(drivers):
        in_one_lane = (traffic.lanes[:k] == traffic.lanes[k]) & (traffic.lanes[k] >= 0)
        for n in np.flatnonzero(in_one_lane.any(axis=1)).tolist():
            other = drivers[n]
            if candidate.track.id in reasons or other.track.id in reasons:
                continue
            frames = _find_overlap_frames(traffic, k, n, in_one_lane[n])
            if len(frames) * dt_s < LEAST_S:
                continue
            off = [float(np.mean(np.abs(driver.match.offset[frames]))) for driver in (candidate, other)]
            out, stays = (candidate, other) if off[0] >= off[1] else (other, candidate)
            reasons[out.track.id] = f"beside {stays.track.id} in one lane, {max(off):.1f} m from its centre line"
    return reasons


def _find_overlap_frames(traffic: CentrelineTraffic, k: int, n: int, in_one_lane: Bool) -> np.ndarray:
    frames = _find_near_frames(traffic, k, in_one_lane, traffic.poses[n, :, :2])
    if not len(frames):
        return frames
    boxes = (traffic.corners(i, frames, -DEEP_M) for i in (k, n))
    return frames[boxes_overlap(*boxes)]


def find_vehicles_through(traffic: CentrelineTraffic, there: Bool, corners: Float) -> list[str]:
    """Return the track ids of vehicles that pass through the boxes of an object with corners (T, 4, 2), in frames when
    it is `there`."""
    abreast: list[str] = []
    centres = corners.mean(axis=1)
    for k, driver in enumerate(traffic.drivers):
        frames = _find_near_frames(traffic, k, there, centres)
        if len(frames) and boxes_overlap(traffic.corners(k, frames, PASSING_GAP_M), corners[frames]).any():
            abreast.append(driver.track.id)
    return abreast


def _find_near_frames(traffic: CentrelineTraffic, k: int, rows: Bool, xy: Float) -> np.ndarray:
    """Return the frames among `rows` (T,) in which a vehicle is near points (T, 2) [m]."""
    apart = np.hypot(*(traffic.poses[k, :, :2] - xy).T)
    return np.flatnonzero(rows & (apart < OVERLAP_RANGE_M))  # NaN compares false
