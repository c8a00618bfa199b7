"""Connected vehicles: merge their own pose with the boxes in which observers list them."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from mdrive_sumo.core.geometry import Float, wrap_angles
from mdrive_sumo.core.state import Kind
from real2sim.clean.observer_fusion import FusedTrack, fuse_segments
from real2sim.clean.track_repair import compute_motion_directions
from real2sim.clean.track_segments import TrackSegments
from real2sim.percentile import compute_median, compute_percentile
from real2sim.recording import ObserverView, Recording

EGO_M = 2.2
"""[m] The sensor is this close to the box centre; the next car is further away."""
EGO_SPREAD = 1.4
"""Factor by which the 90th percentile of the distance may exceed `EGO_M`, because single boxes jump."""


def _empty_track() -> FusedTrack:
    return FusedTrack(np.zeros(0, dtype=np.bool_), np.zeros(0), np.zeros(0), np.zeros(0))


@dataclass(frozen=True)
class TrackedObject:
    """An object and the segments that show it; with an observer it is that connected vehicle."""

    observer: str
    ghost_members: tuple[int, ...]
    """Segments that were listed as another road user."""
    members: Sequence[int]
    fused: FusedTrack = field(default_factory=_empty_track)


def extract_cavs(
    recording: Recording, segments: TrackSegments, groups: list[list[int]]
) -> tuple[list[TrackedObject], list[list[int]]]:
    """Return the connected vehicles that have a pose of their own, and the groups that belong to none of them."""
    egos: list[TrackedObject] = []
    sights = [fuse_segments(segments, group) for group in groups]
    free = set(range(len(groups)))
    for view in recording.views:
        if view.is_infrastructure or len(view.pose) != recording.frame_count or not np.isfinite(view.pose).all(1).any():
            continue
        ghosts = [a for a in sorted(free) if _is_ego(segments, groups[a], sights[a], view.pose)]
        free -= set(ghosts)
        members = sorted(i for a in ghosts for i in groups[a])
        egos.append(
            TrackedObject(
                view.observer, tuple(members), members, _fuse_own_pose(segments, members, view, recording.dt_s)
            )
        )
    return egos, [group for a, group in enumerate(groups) if a in free]


def _is_ego(segments: TrackSegments, group: Sequence[int], sight: FusedTrack, pose: Float) -> bool:
    if all(segments.categories[i].kind is not Kind.VEHICLE for i in group):
        return False
    away = np.hypot(sight.x - pose[:, 0], sight.y - pose[:, 1])
    away = away[np.isfinite(away)]
    return bool(len(away)) and compute_median(away) < EGO_M and compute_percentile(away, 90) < EGO_SPREAD * EGO_M


def _fuse_own_pose(segments: TrackSegments, members: Sequence[int], view: ObserverView, dt_s: float) -> FusedTrack:
    """Fuse a CAV's own pose, shifted and rotated from the sensor to the box that others see.

    The sensor is neither at the box centre nor aligned with the vehicle. Without any box the direction of motion gives
    the mounting angle.
    """
    x, y, yaw = view.pose.T
    valid = np.asarray(np.isfinite(view.pose).all(1))
    course, speed = compute_motion_directions(valid, x, y, dt_s)
    mount = _compute_median_angle((course - yaw)[valid & (speed > 2.0)])
    if not members:
        return FusedTrack(valid, x.copy(), y.copy(), wrap_angles(yaw + mount))
    box = fuse_segments(segments, members)
    both = valid & box.valid
    mount = _compute_median_angle(2 * (box.axis - yaw)[both]) / 2
    dx, dy = (box.x - x)[both], (box.y - y)[both]
    cos, sin = np.cos(yaw), np.sin(yaw)
    ahead, left = np.median(dx * cos[both] + dy * sin[both]), np.median(dy * cos[both] - dx * sin[both])
    inside = FusedTrack(valid, x + ahead * cos - left * sin, y + ahead * sin + left * cos, wrap_angles(yaw + mount))
    only = box.valid & ~valid
    return FusedTrack(
        valid | only,
        np.where(only, box.x, inside.x),
        np.where(only, box.y, inside.y),
        np.where(only, box.axis, inside.axis),
    )


def _compute_median_angle(angles: Float) -> float:
    """Return the median of clustered angles [rad]; 0 for none."""
    angles = angles[np.isfinite(angles)]
    if len(angles) == 0:
        return 0.0
    centre = float(np.arctan2(np.sin(angles).mean(), np.cos(angles).mean()))
    return centre + float(np.median(wrap_angles(angles - centre)))
