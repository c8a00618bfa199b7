"""Geometry of lanes and poses that several readers need."""

import numpy as np

from mdrive_sumo.core.geometry import Float, Polyline, build_polyline
from real2sim.recording import RecordedTrack


def compute_centreline(left: Float, right: Float, spacing: float = 2.0) -> Float:
    """Return the line (N, 2) half-way between two boundaries of one direction, points about `spacing` [m] apart."""
    sides = build_polyline(left), build_polyline(right)
    count = max(2, len(left), len(right), round(max(side.length for side in sides) / spacing) + 1)
    share = np.linspace(0.0, 1.0, count)
    return sum((_sample_line(side, share) for side in sides), np.zeros((count, 2))) / 2


def _sample_line(line: Polyline, share: Float) -> Float:
    return np.column_stack([np.interp(share * line.length, line.s, line.xy[:, axis]) for axis in (0, 1)])


def build_cross_line(line: Polyline, s: float, width: float) -> Float:
    """Return a line (2, 2) [m] across a lane at arc length s [m], from left to right."""
    yaw, middle = line.yaw_at(s), np.array(line.at(s))
    left = np.array((-np.sin(yaw), np.cos(yaw))) * width / 2
    return np.stack((middle + left, middle - left))


def shift_ahead(track: RecordedTrack, distance: float) -> RecordedTrack:
    """Shift every pose of a track `distance` [m] ahead, e.g. from the rear axle to the box centre."""
    return track.replace_columns(x=track.x + distance * np.cos(track.yaw), y=track.y + distance * np.sin(track.yaw))
