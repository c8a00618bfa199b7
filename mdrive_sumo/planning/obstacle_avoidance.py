"""When the car leaves its path for obstacles, and where it waits until it can."""

import math
from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np

from mdrive_sumo.contract import Briefing, Cause, Objects, Observation, OwnState, Reason
from mdrive_sumo.core import portable
from mdrive_sumo.core.compiled import twin
from mdrive_sumo.core.geometry import Bool, Float, Int, boxes_corners
from mdrive_sumo.core.state import Kind
from mdrive_sumo.perception.static_object_tracker import StaticObjectTracker
from mdrive_sumo.planning.detour import Detour, compute_box_extents, find_detour, find_obstructing_boxes
from mdrive_sumo.planning.parameters import AvoidanceParameters
from mdrive_sumo.planning.path_overlap import compute_footprints, compute_overlaps, find_cells
from mdrive_sumo.planning.planning_scale import PROTOCOL_SCALE, PlanningScale
from mdrive_sumo.planning.reference_path import ReferencePath
from mdrive_sumo.planning.stop_lines import StopPoint


class ReplaceablePath(Protocol):
    """A path that a car drives along, and that may be replaced: a `SpaceTimePlanner` or a `PathFollower`."""

    @property
    def path(self) -> ReferencePath:
        """The present path."""
        ...

    @property
    def s(self) -> float:
        """Station [m] of the car on it."""
        ...

    def replace_path(self, path: ReferencePath) -> None:
        """Continue along another path, which begins as the present one does."""
        ...


class _DetourConflict(NamedTuple):
    """Where the area begins that another road user sweeps when the car arrives on its detour."""

    station: float
    """[m] Infinity if there is no conflict."""
    other: str
    position: tuple[float, float] | None


NO_CONFLICT = _DetourConflict(math.inf, "", None)


class ObstacleAvoidance:
    """Tracks standing objects, decides which vehicles are parked, and replaces the path by a detour when it is free."""

    def __init__(self, briefing: Briefing, scale: PlanningScale = PROTOCOL_SCALE) -> None:
        self._vehicle, self._briefing, self._parameters = briefing.vehicle, briefing, scale.avoidance
        self._detour_parameters = scale.detour
        self._tracker = StaticObjectTracker()
        self._passed_ids: frozenset[str] = frozenset()
        self._detour: Detour | None = None
        self._last_conflict, self._last_conflict_tick = NO_CONFLICT, -self._parameters.memory_ticks

    def update(
        self, seen: Observation, objects: Objects, planner: ReplaceablePath, stop_stations: Sequence[float]
    ) -> tuple[Objects, list[StopPoint]]:
        """Replace the planner's path if there is a free detour; return the refined objects and where to wait.

        stop_stations: arc lengths [m] of red lights and stop signs: a vehicle that stands before one is not parked.
        """
        objects, standstill_s, never_moved = self._tracker.update(seen.tick, objects, self._parameters.confirmation_s)
        fixed = self._find_fixed_objects(objects, standstill_s)
        objects = self._tracker.replace_by_means(objects, fixed)
        waits = self._find_oncoming_stops(seen.tick, objects, ~fixed, seen.own, planner)
        queued = find_queued(objects, standstill_s, self._parameters)
        # A vehicle that has never moved may be parked, queued or not; too close to it the car could not turn out.
        suspected = ~queued | never_moved
        still = (objects.kind == Kind.VEHICLE) & (standstill_s >= self._parameters.suspected_s) & suspected
        if not (fixed | still).any():
            return objects, waits
        boxes = boxes_corners(objects.x, objects.y, objects.yaw, objects.length, objects.width)
        obstructing = (fixed | still) & find_obstructing_boxes(
            planner.path, planner.s, boxes, self._vehicle, self._detour_parameters
        )
        if not obstructing.any():
            return objects, waits
        first_s = compute_box_extents(planner.path, planner.s, boxes, self._detour_parameters)[:, 0]
        still &= ~_find_stopped_at_lines(first_s, stop_stations, self._detour_parameters.look_ahead_m)
        parked = fixed | (obstructing & still & ~queued & (standstill_s >= self._parameters.parked_s))
        if self._take_detour(seen.own, objects, parked, boxes, planner):
            return self._tracker.replace_by_means(objects, parked), waits
        blocking = np.flatnonzero(obstructing & (fixed | still))
        return objects, waits + self._build_waiting_points(objects, blocking, first_s, planner.s, seen.own.speed)

    def _find_fixed_objects(self, objects: Objects, standstill_s: Float) -> Bool:
        """Return a mask (N,): static objects, and vehicles that the car passes already."""
        passed = np.array([name in self._passed_ids for name in objects.ids], dtype=np.bool_)
        return ((objects.kind == Kind.STATIC) | passed) & (standstill_s >= self._parameters.confirmation_s)

    def _take_detour(
        self, own: OwnState, objects: Objects, parked: Bool, boxes: Float, planner: ReplaceablePath
    ) -> bool:
        """Replace the path if there is a free detour around the parked objects (N,); return whether there is one."""
        detour = find_detour(
            planner.path, planner.s, max(own.speed, 0.0), boxes[parked], self._briefing, self._detour_parameters
        )
        if detour is None:
            return False
        others, reserve_s = objects.take(~parked), self._parameters.time_reserve_s
        if self._find_detour_conflict(detour, others, own, planner.s, reserve_s) is not NO_CONFLICT:
            return False
        planner.replace_path(detour.path)
        last_s = max(detour.last_s, self._detour.last_s) if self._detour else detour.last_s
        self._detour = detour._replace(last_s=last_s)
        self._passed_ids |= {name for name, is_parked in zip(objects.ids, parked.tolist(), strict=True) if is_parked}
        return True

    def _find_oncoming_stops(
        self, tick: int, objects: Objects, moves: Bool, own: OwnState, planner: ReplaceablePath
    ) -> list[StopPoint]:
        """Return where to wait for traffic that crosses the detour; empty if the car is already in its way.

        moves: (N,) which objects may cross it.
        """
        if self._detour is None or planner.s > self._detour.last_s:
            return []
        parameters = self._parameters
        reserve_s, others = parameters.time_reserve_s / 2, objects.take(moves)
        conflict = self._find_detour_conflict(self._detour, others, own, planner.s, reserve_s)
        if conflict is not NO_CONFLICT:
            self._last_conflict, self._last_conflict_tick = conflict, tick
        elif tick - self._last_conflict_tick <= parameters.memory_ticks:
            conflict = self._last_conflict
        soonest = planner.s + (own.speed * own.speed) / (2 * parameters.hard_braking)
        can_stop = own.speed < parameters.creeping_speed or soonest < conflict.station
        if not can_stop or conflict is NO_CONFLICT:
            return []
        wait_s = max(conflict.station - parameters.yield_gap_m, soonest)
        reason = Reason(Cause.ONCOMING, (conflict.other,), conflict.position, max(wait_s - planner.s, 0.0))
        return [StopPoint(wait_s, reason)]

    def _find_detour_conflict(
        self, detour: Detour, others: Objects, own: OwnState, s: float, reserve_s: float
    ) -> _DetourConflict:
        """Return the first conflict ahead of s [m] with others, which are all predicted to go straight on."""
        parameters = self._parameters
        stations = np.arange(s, detour.last_s, parameters.stride_m)
        size = self._vehicle.length, self._vehicle.width + 2 * parameters.side_gap_m
        mine = compute_footprints(detour.path, *size, find_cells(detour.path, stations))
        travelled, moving_speed = parameters.travelled, parameters.moving_speed
        rows = np.flatnonzero(~self._find_same_lane_traffic(others, own))
        speed = np.where(others.speed[rows] > moving_speed, others.speed[rows], 0.0)[:, None]
        arrives_s = np.where(speed > 0, travelled / np.maximum(speed, moving_speed), 0.0)
        swept = _sweep_boxes(others, rows, np.where(speed > 0, travelled, 0.0))
        met = compute_overlaps(mine, swept.reshape(-1, 4, 2)).reshape(len(mine), len(rows), len(travelled))
        ramp_s = max(parameters.passing_speed - own.speed, 0.0) / (2 * parameters.passing_acceleration)
        own_s = (stations - s) / max(own.speed, parameters.passing_speed) + ramp_s
        conflict = met & (arrives_s <= own_s[:, None, None] + reserve_s)
        conflicting = conflict.any((0, 2))
        blocked = met[:, conflicting].any((1, 2))
        if not blocked.any():
            return NO_CONFLICT
        station = int(blocked.argmax())
        row = int(rows[(met[station].any(1) & conflicting).argmax()])
        return _DetourConflict(float(stations[station]), others.ids[row], (float(others.x[row]), float(others.y[row])))

    def _find_same_lane_traffic(self, others: Objects, own: OwnState) -> Bool:
        """Return a mask (N,): road users that drive ahead in the own direction, or follow the car."""
        parameters = self._parameters
        dx, dy = others.x - own.x, others.y - own.y
        cos, sin = portable.cos_sin(own.yaw)
        lead, lateral = dx * cos + dy * sin, dy * cos - dx * sin
        leads = (lead > 0) & (others.speed > parameters.moving_speed)
        follows = (lead < 0) & (np.abs(lateral) < parameters.follower_lateral_m)
        return (portable.cos(others.yaw - own.yaw) > parameters.same_direction_cos) & (leads | follows)

    def _build_waiting_points(
        self, objects: Objects, rows: Int, first_s: Float, s: float, speed: float
    ) -> list[StopPoint]:
        """Return where to wait behind the obstacles `rows`, which begin at first_s (N,) [m], with room to turn out.

        Empty if the car can no longer stop there.
        """
        if not len(rows):
            return []
        nearest = int(rows[first_s[rows].argmin()])
        stop = float(first_s[nearest]) - self._vehicle.length / 2 - self._parameters.turn_out_m
        soonest = s + (speed * speed) / (2 * self._parameters.hard_braking)
        if soonest >= stop + self._parameters.max_overshoot_m:
            return []
        position = float(objects.x[nearest]), float(objects.y[nearest])
        gap_m = max(float(first_s[nearest]) - self._vehicle.length / 2 - s, 0.0)
        return [StopPoint(max(stop, soonest), Reason(Cause.OBSTACLE, (objects.ids[nearest],), position, gap_m))]


@twin
def find_queued(objects: Objects, standstill_s: Float, parameters: AvoidanceParameters, /) -> Bool:
    """Return a mask (N,): objects near a moving one, which may be waiting for it; standstill_s: (N,)."""
    moves = np.flatnonzero((standstill_s < parameters.suspected_s) & (np.abs(objects.speed) > parameters.moving_speed))
    gaps = portable.hypot(objects.x[:, None] - objects.x[moves], objects.y[:, None] - objects.y[moves])
    return np.any(gaps < parameters.queue_radius_m, axis=1)


def _find_stopped_at_lines(first_s: Float, stop_stations: Sequence[float], look_m: float) -> Bool:
    """Return a mask (N,): which objects that begin at first_s [m] have a stop line shortly ahead."""
    return np.array([any(s < line < s + look_m for line in stop_stations) for s in first_s], dtype=np.bool_)


def _sweep_boxes(others: Objects, rows: Int, travelled: Float) -> Float:
    """Return the corners (R, D, 4, 2) [m] of boxes moved straight on by `travelled` (R, D) [m]."""
    yaw = others.yaw[rows, None]
    cos, sin = portable.cos_sin(yaw)
    x, y = others.x[rows, None] + travelled * cos, others.y[rows, None] + travelled * sin
    return boxes_corners(x, y, yaw, others.length[rows, None], others.width[rows, None])
