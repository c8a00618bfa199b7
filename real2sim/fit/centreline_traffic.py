"""What SUMO's one dimension cannot hold: two vehicles abreast in one lane, and things that were driven around.

SUMO's vehicles stay on the centre line. So a log is looked at with every vehicle put there: where boxes that were apart
in the log meet then, one of them must not be there for SUMO.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mdrive_sumo.core.geometry import Bool, Float, boxes_corners, boxes_overlap
from mdrive_sumo.roads import RoadMap
from real2sim.fit.background_vehicle import RoutedTrack

MARGIN_M = 0.3
"""Free space on both sides of a box that SUMO's traffic passes."""
DEEP_M, LEAST_S = 0.25, 0.5
"""Vehicles in one lane are abreast if their boxes, that much smaller on each side, meet for that long."""
NEAR_M = 30.0
"""No two boxes whose centres are further apart meet."""


@dataclass(frozen=True)
class CentrelineTraffic:
    """Drivers put on the centre lines of their lanes: (K, T, 3) x, y [m], yaw [rad], NaN where they have no lane."""

    drivers: Sequence[RoutedTrack]
    poses: Float

    def corners(self, k: int, frames: np.ndarray, grown: float) -> Float:
        """Corners (N, 4, 2) of a driver's box in frames (N,), each side `grown` [m] wider."""
        one, at = self.drivers[k], self.poses[k, frames]
        length, width = max(one.length + 2 * min(grown, 0.0), 0.1), max(one.width + 2 * grown, 0.1)
        return boxes_corners(at[:, 0], at[:, 1], at[:, 2], np.array(length), np.array(width))


def place_on_centrelines(drivers: Sequence[RoutedTrack], roads: RoadMap) -> CentrelineTraffic:
    """Puts every driver where its match has it along its lane."""
    frames = len(drivers[0].match.lanes) if drivers else 0
    poses = np.full((len(drivers), frames, 3), np.nan)
    for k, one in enumerate(drivers):
        for frame in np.flatnonzero(np.isfinite(one.progress) & np.isfinite(one.match.s)).tolist():
            line, s = roads.lanes[one.match.lanes[frame]].centre, float(one.match.s[frame])
            poses[k, frame] = (*line.at(s), line.yaw_at(s))
    return CentrelineTraffic(drivers, poses)


def find_abreast(all_of_them: CentrelineTraffic, dt_s: float) -> dict[str, str]:
    """By track id, why it cannot be in a lane: beside another one there, and further from the centre line."""
    found: dict[str, str] = {}
    drivers = all_of_them.drivers
    for k, one in enumerate(drivers):
        for n in range(k):
            other = drivers[n]
            if one.track.id in found or other.track.id in found:
                continue
            frames = _side_by_side(all_of_them, k, n)
            if len(frames) * dt_s < LEAST_S:
                continue
            off = [float(np.mean(np.abs(driver.match.offset[frames]))) for driver in (one, other)]
            out, stays = (one, other) if off[0] >= off[1] else (other, one)
            found[out.track.id] = f"beside {stays.track.id} in one lane, {max(off):.1f} m from its centre line"
    return found


def _side_by_side(all_of_them: CentrelineTraffic, k: int, n: int) -> np.ndarray:
    one, other = (all_of_them.drivers[i].match.lanes for i in (k, n))
    same = np.array([a == b != "" for a, b in zip(one, other, strict=True)], dtype=np.bool_)
    frames = _near(all_of_them, k, same, all_of_them.poses[n, :, :2])
    if not len(frames):
        return frames
    boxes = (all_of_them.corners(i, frames, -DEEP_M) for i in (k, n))
    return frames[boxes_overlap(*boxes)]


def find_vehicles_through(all_of_them: CentrelineTraffic, there: Bool, corners: Float) -> list[str]:
    """Ids of the drivers who pass through the boxes of a thing: corners (T, 4, 2) in the frames when it is `there`."""
    found: list[str] = []
    for k, one in enumerate(all_of_them.drivers):
        frames = _near(all_of_them, k, there, corners.mean(axis=1))
        if len(frames) and boxes_overlap(all_of_them.corners(k, frames, MARGIN_M), corners[frames]).any():
            found.append(one.track.id)
    return found


def _near(all_of_them: CentrelineTraffic, k: int, rows: Bool, xy: Float) -> np.ndarray:
    """Frames among `rows` (T,) in which a driver is near points (T, 2) [m]."""
    apart = np.hypot(*(all_of_them.poses[k, :, :2] - xy).T)
    return np.flatnonzero(rows & (np.nan_to_num(apart, nan=np.inf) < NEAR_M))
