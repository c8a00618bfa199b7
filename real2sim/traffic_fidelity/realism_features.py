"""Features of the motion of road users that realism is judged by: motion, others around, the lane.

They are those of the Waymo Open Sim Agents Challenge (Montali et al., NeurIPS 2023), computed by its published
definitions; what differs is said at each. Arrays are (T, N): T samples `dt_s` apart, N road users; NaN: absent.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mdrive_sumo.core.geometry import Bool, Float, Int, wrap_angles
from mdrive_sumo.roads import RoadMap

MOST_TTC_S = 5.0
"""[s] Time to collision of a road user that follows nothing, or closes in on nothing, as in the challenge."""
MOST_GAP_M = 40.0
"""[m] Gap of a road user that follows nothing, and the largest distance to the nearest one: the challenge's range."""
FOLLOW_RAD, FOLLOW_CLOSELY_RAD, SMALL_OVERLAP_M = math.radians(75), math.radians(10), 0.5
"""A road user follows one ahead that its straight trail meets if their headings differ by at most the first angle; by
at most the second if the trail meets less than `SMALL_OVERLAP_M` of it. The challenge's numbers."""


@dataclass(frozen=True)
class RoadUserStates:
    """Poses x, y [m], yaw [rad] (T, N) of road users, and their sizes (N,) [m]."""

    x: Float
    y: Float
    yaw: Float
    length: Float
    width: Float
    dt_s: float


def compute_features(states: RoadUserStates, judged: Int, roads: RoadMap) -> Mapping[str, Float]:
    """Return the samples (T, E) of every feature by name, of the road users with the indices `judged` (E,).

    NaN where a road user is absent, or, for rates, too short a time there.
    """
    x, y, yaw = (values[:, judged] for values in (states.x, states.y, states.yaw))
    speed = np.hypot(_differentiate(x, states.dt_s), _differentiate(y, states.dt_s))
    turn_rate = _differentiate_angle(yaw, states.dt_s)
    distance, gap, ttc = _compute_surroundings(states, judged)
    return {
        "speed": speed,
        "acceleration": _differentiate(speed, states.dt_s),
        "turn_rate": turn_rate,
        "turn_acceleration": _differentiate(turn_rate, states.dt_s),
        "nearest": distance,
        "gap": gap,
        "ttc": ttc,
        "lateral_offset": _compute_lateral_offset(x, y, roads),
    }


def find_collisions(features: Mapping[str, Float]) -> Bool:
    """Return whether each judged road user (E,) ever overlaps another."""
    with np.errstate(invalid="ignore"):
        return np.asarray((features["nearest"] < 0.0).any(axis=0))


def _differentiate(values: Float, dt_s: float) -> Float:
    """Return central differences (T, E), NaN at the ends."""
    rate = np.full_like(values, np.nan)
    rate[1:-1] = (values[2:] - values[:-2]) / (2 * dt_s)
    return rate


def _differentiate_angle(yaw: Float, dt_s: float) -> Float:
    rate = np.full_like(yaw, np.nan)
    turned = yaw[2:] - yaw[:-2]
    there = np.isfinite(turned)
    rate[1:-1] = np.where(there, wrap_angles(np.where(there, turned, 0.0)), np.nan) / (2 * dt_s)
    return rate


def _compute_lateral_offset(x: Float, y: Float, roads: RoadMap) -> Float:
    """Return the distance [m] from the centre line of the nearest lane.

    In the place of the challenge's distance to the road's edge, which networks of logs do not have.
    """
    there = np.isfinite(x)
    offset = np.full_like(x, np.nan)
    if there.any():
        offset[there] = roads.find_nearest_lanes(np.column_stack((x[there], y[there]))).distance
    return offset


def _compute_surroundings(states: RoadUserStates, judged: Int) -> tuple[Float, Float, Float]:
    """Return the signed distance [m] to the nearest road user, the gap [m] to the one ahead, the time [s] to collision
    with it, all (T, E)."""
    shape = (len(states.x), len(judged))
    nearest, gap, ttc = np.full(shape, MOST_GAP_M), np.full(shape, MOST_GAP_M), np.full(shape, MOST_TTC_S)
    speed = np.hypot(_differentiate(states.x, states.dt_s), _differentiate(states.y, states.dt_s))
    for column, k in enumerate(judged.tolist()):
        others = np.arange(states.x.shape[1]) != k
        if others.any():
            pair = _PairGeometry.from_states(states, k, others)
            nearest[:, column] = np.minimum(pair.compute_nearest(), MOST_GAP_M)
            gap[:, column], ttc[:, column] = pair.compute_following(speed[:, k], speed[:, others])
    absent = ~np.isfinite(states.x[:, judged])
    for values in (nearest, gap, ttc):
        values[absent] = np.nan
    return nearest, gap, ttc


@dataclass(frozen=True)
class _PairGeometry:
    """Others (T, M) in the frame of one road user: x ahead of its centre, y to its left, its half sizes a, b [m]."""

    x: Float
    y: Float
    yaw: Float
    half_length: Float
    half_width: Float
    a: float
    b: float

    @classmethod
    def from_states(cls, states: RoadUserStates, k: int, others: Bool) -> "_PairGeometry":
        dx, dy = (values[:, others] - values[:, [k]] for values in (states.x, states.y))
        cos, sin = np.cos(states.yaw[:, [k]]), np.sin(states.yaw[:, [k]])
        return cls(
            x=cos * dx + sin * dy,
            y=cos * dy - sin * dx,
            yaw=states.yaw[:, others] - states.yaw[:, [k]],
            half_length=states.length[others] / 2,
            half_width=states.width[others] / 2,
            a=float(states.length[k]) / 2,
            b=float(states.width[k]) / 2,
        )

    @property
    def _extents(self) -> tuple[Float, Float]:
        """Half extents (T, M) [m] of the other boxes along and across this one."""
        cos, sin = np.abs(np.cos(self.yaw)), np.abs(np.sin(self.yaw))
        return cos * self.half_length + sin * self.half_width, sin * self.half_length + cos * self.half_width

    def compute_nearest(self) -> Float:
        """Return the distance (T,) [m] to the nearest box; negative: the depth by which the boxes overlap."""
        along, across = self._extents
        # depth on the four axes of both boxes: the largest of the separations decides whether they are apart
        cos, sin = np.cos(self.yaw), np.sin(self.yaw)
        own_along, own_across = np.abs(cos) * self.a + np.abs(sin) * self.b, np.abs(sin) * self.a + np.abs(cos) * self.b
        seen_x, seen_y = -(cos * self.x + sin * self.y), -(cos * self.y - sin * self.x)
        separation = np.max(
            (
                np.abs(self.x) - self.a - along,
                np.abs(self.y) - self.b - across,
                np.abs(seen_x) - self.half_length - own_along,
                np.abs(seen_y) - self.half_width - own_across,
            ),
            axis=0,
        )
        apart = np.minimum(
            _measure_corners((self.x, self.y, self.yaw), (self.half_length, self.half_width), (self.a, self.b)),
            _measure_corners((seen_x, seen_y, -self.yaw), (self.a, self.b), (self.half_length, self.half_width)),
        )
        distance = np.where(separation > 0.0, apart, separation)
        return np.where(np.isfinite(distance), distance, np.inf).min(axis=1)

    def compute_following(self, speed: Float, other_speed: Float) -> tuple[Float, Float]:
        """Return gap [m] and time to collision [s], both (T,), to the nearest box ahead on the straight trail."""
        along, across = self._extents
        ahead = self.x - self.a - along
        overlap = self.b + across - np.abs(self.y)
        turned = np.abs(wrap_angles(np.where(np.isfinite(self.yaw), self.yaw, 0.0)))
        limit = np.where(overlap < SMALL_OVERLAP_M, FOLLOW_CLOSELY_RAD, FOLLOW_RAD)
        with np.errstate(invalid="ignore"):
            follows = np.isfinite(ahead) & (ahead > 0.0) & (overlap > 0.0) & (turned <= limit)
        ahead = np.where(follows, ahead, np.inf)
        leader = np.argmin(ahead, axis=1)[:, None]
        gap = np.take_along_axis(ahead, leader, axis=1)[:, 0]
        closing = speed - np.take_along_axis(other_speed, leader, axis=1)[:, 0]
        with np.errstate(invalid="ignore", divide="ignore"):
            ttc = np.where(np.isfinite(gap) & (closing > 0.0), gap / closing, MOST_TTC_S)
        return np.minimum(gap, MOST_GAP_M), np.minimum(ttc, MOST_TTC_S)


def _measure_corners(
    pose: tuple[Float, Float, Float],
    half: tuple[Float | float, Float | float],
    own: tuple[Float | float, Float | float],
) -> Float:
    """Return the least distance (T, M) [m] of the corners of boxes to the box `own` around the origin."""
    (x, y, yaw), (half_length, half_width), (a, b) = pose, half, own
    cos, sin = np.cos(yaw), np.sin(yaw)
    least = np.full_like(x, np.inf)
    for i, j in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        corner_x = x + i * half_length * cos - j * half_width * sin
        corner_y = y + i * half_length * sin + j * half_width * cos
        beyond_x, beyond_y = np.maximum(np.abs(corner_x) - a, 0.0), np.maximum(np.abs(corner_y) - b, 0.0)
        least = np.fmin(least, np.hypot(beyond_x, beyond_y))
    return least
