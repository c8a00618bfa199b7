"""A detour around obstacles: the same path, shifted laterally for as long as necessary."""

import math
from typing import NamedTuple

import numpy as np

from mdrive_sumo.contract import Briefing, VehicleFacts
from mdrive_sumo.core import portable
from mdrive_sumo.core.compiled import twin
from mdrive_sumo.core.geometry import Bool, Float, Int, build_polyline
from mdrive_sumo.planning.parameters import DETOUR, DetourParameters
from mdrive_sumo.planning.path_overlap import compute_footprints, compute_overlaps, find_cells
from mdrive_sumo.planning.reference_path import (
    SPACING_M,
    ReferencePath,
    build_path_through_points,
    compute_curve_speeds,
)

PEAK = 10 / math.sqrt(3)
"""Greatest second derivative of the quintic step 10 u³ - 15 u⁴ + 6 u⁵."""


class Detour(NamedTuple):
    """A path, and the arc lengths [m] on it between which it differs from the previous one."""

    path: ReferencePath
    first_s: float
    last_s: float


class LateralShift(NamedTuple):
    """A shift by `left` [m] between the arc lengths `hold` [m], with transitions of length `ramps` [m] at both ends."""

    left: float
    hold: tuple[float, float]
    ramps: tuple[float, float]

    def evaluate(self, s: Float) -> Float:
        """Return the shift (M,) [m] at arc lengths s (M,)."""
        rise = (s - self.hold[0] + self.ramps[0]) / self.ramps[0]
        fall = (self.hold[1] + self.ramps[1] - s) / self.ramps[1]
        u = np.clip(np.minimum(rise, fall), 0.0, 1.0)
        return self.left * (u * u * u) * (10 - 15 * u + 6 * (u * u))


@twin
def find_obstructing_boxes(
    path: ReferencePath, s: float, boxes: Float, vehicle: VehicleFacts, parameters: DetourParameters = DETOUR, /
) -> Bool:
    """Return a mask (K,): which boxes (K, 4, 2) [m] the car would touch within `look_ahead_m` of arc length s [m]."""
    cells = find_cells(path, np.arange(s, min(s + parameters.look_ahead_m, path.length), 2 * SPACING_M))
    width = vehicle.width + 2 * parameters.obstructing_gap_m
    return np.any(compute_overlaps(compute_footprints(path, vehicle.length, width, cells), boxes), axis=0)


def compute_box_extents(path: ReferencePath, s: float, boxes: Float, parameters: DetourParameters = DETOUR) -> Float:
    """Return the extents (K, 4) [m] of boxes (K, 4, 2) along the path near s.

    Columns: first and last arc length, rightmost and leftmost offset from the path (left positive).
    """
    look_m = parameters.look_ahead_m
    window = slice(max(int((s - look_m) / SPACING_M), 0), int((s + 2 * look_m) / SPACING_M))
    i, along, left = to_frenet(path.xy[window], path.yaw[window], boxes)
    stations = (window.start + i) * SPACING_M + along
    return np.column_stack((stations.min(1), stations.max(1), left.min(1), left.max(1)))


@twin
def to_frenet(xy: Float, yaw: Float, points: Float, /) -> tuple[Int, Float, Float]:
    """Return for points (..., 2) the nearest point of the chain xy (N, 2) and the offsets ahead and left of it [m]."""
    i = portable.square(points[..., None, :] - xy).sum(-1).argmin(-1)
    gap = points - xy[i]
    cos, sin = portable.cos_sin(yaw[i])
    return i, gap[..., 0] * cos + gap[..., 1] * sin, gap[..., 1] * cos - gap[..., 0] * sin


def find_detour(
    path: ReferencePath,
    s: float,
    speed: float,
    boxes: Float,
    briefing: Briefing,
    parameters: DetourParameters = DETOUR,
) -> Detour | None:
    """Return the smallest shift of the path ahead of s [m] that passes the boxes (K, 4, 2) [m] that obstruct it.

    The detour keeps `clearance_m` to the boxes and `edge_clearance_m` to the edge of the road, is no sharper than
    `max_curvature`, and a car at that speed [m/s] can slow down for it. None if nothing obstructs the path or no shift
    meets these limits.
    """
    obstructing = find_obstructing_boxes(path, s, boxes, briefing.vehicle, parameters)
    if not obstructing.any() or not len(briefing.route_room):
        return None
    search = _DetourSearch(path, s, speed, boxes, briefing, parameters)
    nearest = obstructing & (search.extents[:, 0] == search.extents[obstructing, 0].min())
    return search.find_smallest(obstructing) or search.find_smallest(nearest)  # boxes further on may be passed later


class _DetourSearch:
    """The detours around one set of boxes."""

    def __init__(
        self,
        path: ReferencePath,
        s: float,
        speed: float,
        boxes: Float,
        briefing: Briefing,
        parameters: DetourParameters,
    ) -> None:
        self._path, self._s, self._speed, self._boxes = path, s, speed, boxes
        self._briefing, self._parameters = briefing, parameters
        self.extents = compute_box_extents(path, s, boxes, parameters)

    def find_smallest(self, group: Bool) -> Detour | None:
        """Return the smallest detour around the boxes of `group` (K,) and any other box that the shift runs into."""
        extra_shifts = self._parameters.extra_shifts_m
        shifts = [self._build_shift(group, side, extra) for side in (1, -1) for extra in extra_shifts]
        best, smallest = None, math.inf
        for shift in sorted(shifts, key=lambda shift: abs(shift.left)):
            if abs(shift.left) < smallest and (tried := self._try_shift(shift, group)) is not None:
                detour, size = tried
                best, smallest = (detour, size) if size < smallest else (best, smallest)
        return best

    def _build_shift(self, group: Bool, side: int, extra: float) -> LateralShift:
        """Return the shift that passes the group on one side (1: left, -1: right) with an extra gap [m]."""
        vehicle, parameters = self._briefing.vehicle, self._parameters
        first, last, right, left = self.extents[group].T
        gap = side * vehicle.width / 2 + side * (parameters.clearance_m + extra)
        offset = gap + (float(left.max()) if side > 0 else float(right.min()))
        half = vehicle.length / 2 + parameters.hold_margin_m
        hold = float(first.min()) - half, float(last.max()) + half
        comfortable_m = self._speed * math.sqrt(PEAK * abs(offset) / parameters.lateral_acceleration)
        ramp_m = max(comfortable_m, parameters.min_ramp_m)
        return LateralShift(offset, hold, (min(ramp_m, hold[0] - self._s), ramp_m))

    def _try_shift(self, shift: LateralShift, group: Bool) -> tuple[Detour, float] | None:
        """Return the detour and its shift [m], enlarged where it meets further boxes; None if it is not drivable."""
        while shift.ramps[0] > 0:
            detour = apply_shift(self._path, shift, self._briefing.vehicle.rear_to_centre)
            if not self._is_drivable(detour):
                return None
            more = self._find_touched_boxes(detour) & ~group
            if not more.any():
                return (detour, abs(shift.left)) if not self._find_touched_boxes(detour).any() else None
            group = group | more
            shift = self._build_shift(group, 1 if shift.left > 0 else -1, 0.0)
        return None

    def _find_touched_boxes(self, detour: Detour) -> Bool:
        """Return a mask (K,): which boxes violate the clearance (less `rounding_m`)."""
        vehicle, parameters = self._briefing.vehicle, self._parameters
        length = vehicle.length + parameters.hold_margin_m / 2
        width = vehicle.width + 2 * parameters.clearance_m - parameters.rounding_m
        mine = compute_footprints(detour.path, length, width, _find_detour_cells(detour, 1))
        return np.any(compute_overlaps(mine, self._boxes), axis=0)

    def _is_drivable(self, detour: Detour) -> bool:
        """Return whether the curvature, the present speed and the edges of the road allow the detour."""
        path, parameters = detour.path, self._parameters
        if np.abs(path.curvature[_find_detour_cells(detour, 1)]).max() > parameters.max_curvature:
            return False
        own_cell = find_cells(path, np.array((self._s,)))
        max_speed, braking = self._briefing.vehicle.max_speed, parameters.braking
        if compute_curve_speeds(path, max_speed, braking, braking)[own_cell][0] < self._speed:
            return False
        return self._is_on_road(detour)

    def _is_on_road(self, detour: Detour) -> bool:
        """Return whether the car's corners stay on the road wherever the path is shifted."""
        briefing, cells = self._briefing, _find_detour_cells(detour, 2)
        shift = np.abs(to_frenet(self._path.xy, self._path.yaw, detour.path.xy[cells])[2])
        shifted = cells[shift > self._parameters.shifted_m]
        corners = compute_footprints(detour.path, briefing.vehicle.length, briefing.vehicle.width, shifted)
        # The path goes on beyond the goal, the route does not: its last point stands for the road there.
        first = min(max(int(detour.first_s) - 10, 0), len(briefing.route_xy) - 1)
        near = slice(first, int(detour.last_s) + 20)
        i, _, left = to_frenet(briefing.route_xy[near], briefing.route_yaw[near], corners)
        room = _take_minimum_of_neighbours(briefing.route_room[near])[i] - self._parameters.edge_clearance_m
        return bool(((left <= room[..., 0]) & (-left <= room[..., 1])).all())


def _find_detour_cells(detour: Detour, stride: int) -> Int:
    """Return every `stride`-th cell of the part of the path that differs."""
    return find_cells(detour.path, np.arange(detour.first_s, detour.last_s, stride * SPACING_M))


def _take_minimum_of_neighbours(room: Float) -> Float:
    """Return (N, 2) the minimum of each row and its neighbours: edges of the road are known at every metre only."""
    padded = np.concatenate((room[:1], room, room[-1:]))
    return np.minimum(np.minimum(padded[:-2], padded[1:-1]), padded[2:])


@twin
def apply_shift(path: ReferencePath, shift: LateralShift, rear_to_centre: float, /) -> Detour:
    """Return the shifted path, resampled to `SPACING_M`; rear_to_centre: [m] of the car."""
    left = shift.evaluate(np.arange(len(path.xy), dtype=np.float64) * SPACING_M)
    cos, sin = portable.cos_sin(path.yaw)
    shifted = build_polyline(path.xy + left[:, None] * np.column_stack((-sin, cos)))
    old_stations = np.arange(len(shifted.s)) * SPACING_M
    begin, end = shift.hold[0] - shift.ramps[0], shift.hold[1] + shift.ramps[1]
    goal_s, first_s, last_s = np.interp((path.goal_s, begin, end), old_stations, shifted.s).tolist()
    xy = shifted.resample(SPACING_M).xy[:-1]
    start_yaw = float(path.body_yaw[0])
    return Detour(build_path_through_points(xy, rear_to_centre, start_yaw, goal_s), first_s, last_s)
