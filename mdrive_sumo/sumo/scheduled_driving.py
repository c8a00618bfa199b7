"""Scheduled driving: the commands to SUMO on every step for a vehicle that has a schedule."""

# pyright: basic
# Because libsumo has no type information.
import math

import libsumo

from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.background import BackgroundVehicle
from mdrive_sumo.sumo.lane_change import DURATION_S, RoadUsersProvider, ScheduledLaneChange
from mdrive_sumo.sumo.schedule import ARRIVAL_TOLERANCE_M, LATE_M, ScheduleTable

_distance, _speed, _set_speed, _set_mode = (
    getattr(libsumo.libsumo._libsumo, f"vehicle_{what}")
    for what in ("getDistance", "getSpeed", "setSpeed", "setSpeedMode")
)
HELD_BACK_SPEED = 0.5
"""[m/s] A vehicle slower than desired by this is left to SUMO: with a commanded speed it brakes comfortably at most."""
RULES, NO_RIGHT_OF_WAY, FREE = 31 | 64, 55 | 64, 31
"""Speed modes: all checks but the speed limit (64); the same without right of way before (8) and on (32) junctions,
which the log determines; SUMO's default."""
COMMANDED, AUTONOMOUS = 0b01_00_00_00_00, 0b01_10_01_01_01_01
"""Lane-change modes: only commanded changes; SUMO's default."""
EDGE_M = 0.5
"""[m] A lane change nearer than this to the end of an edge belongs to the next edge."""


class ScheduleFollower:
    """Makes one vehicle follow its schedule, from its departure on."""

    def __init__(self, vehicle: BackgroundVehicle, route_offset_m: float, roads: RoadMap, action_step_s: float) -> None:
        """`route_offset_m`: distance along its route at departure. `action_step_s`: applies after the schedule."""
        assert vehicle.schedule is not None
        self._roads, self._action_step_s = roads, action_step_s
        self._lane_change: ScheduledLaneChange | None = None
        self._name = vehicle.id
        self._schedule = ScheduleTable(vehicle.schedule)
        self._leaves_at_end = vehicle.schedule.leaves
        self._lanes = [one for one in vehicle.schedule.lanes if one[0] > route_offset_m]
        self._route_offset_m = route_offset_m
        self._mode, self._is_late = -1, False
        libsumo.vehicle.setLaneChangeMode(self._name, COMMANDED)

    @property
    def offset(self) -> tuple[float, float] | None:
        """Offset and rate of the lane change in progress, see `ScheduledLaneChange.offset`; None without one."""
        return self._lane_change.offset if self._lane_change else None

    @property
    def is_late(self) -> bool:
        """Whether it is so late that it observes right of way."""
        return self._is_late

    def drive(self, tick: int, road_users: RoadUsersProvider, disturbed: bool) -> bool:
        """Command the step that produces frame `tick`; return False once the schedule has ended."""
        name, schedule = self._name, self._schedule
        position = self._route_offset_m + _distance(name)
        if tick > schedule.ends_tick and position >= schedule.ends_m - ARRIVAL_TOLERANCE_M:
            if self._lane_change is None or self._leaves_at_end:
                self._end()
                return False
            return self._finish_lane_change(position, road_users)
        self._is_late = schedule.find_position(tick - 1) - position > LATE_M
        self._set_speed_mode(self._is_late or disturbed)
        speed = schedule.compute_desired_speed(tick - 1, position)
        _set_speed(name, speed if speed - _speed(name) < HELD_BACK_SPEED else -1)
        if self._lane_change or (self._lanes and position + speed * DURATION_S / 2 >= self._lanes[0][0]):
            self._advance_lane_change(position, road_users)
        return True

    def _finish_lane_change(self, position: float, road_users: RoadUsersProvider) -> bool:
        """Complete the lane change in progress before SUMO takes over, lest the vehicle jumps to the lane's centre."""
        _set_speed(self._name, -1)
        self._set_speed_mode(observes_right_of_way=True)
        self._advance_lane_change(position, road_users)
        return True

    def _set_speed_mode(self, observes_right_of_way: bool) -> None:
        mode = RULES if observes_right_of_way else NO_RIGHT_OF_WAY
        if mode != self._mode:
            _set_mode(self._name, mode)
            self._mode = mode

    def _advance_lane_change(self, position: float, road_users: RoadUsersProvider) -> None:
        """Continue the lane change in progress, or begin the one that is due."""
        if self._lane_change is None:
            self._lane_change = self._start_lane_change(position)
        if self._lane_change is not None:
            self._lane_change.advance(road_users)
            if self._lane_change.is_done:
                self._lane_change = None

    def _start_lane_change(self, position: float) -> ScheduledLaneChange | None:
        """Return the next lane change, once the vehicle is on its edge; else None."""
        while len(self._lanes) > 1 and position >= self._lanes[1][0]:
            self._lanes.pop(0)
        change_m, wanted = self._lanes[0]
        lane = self._roads.lanes.get(libsumo.vehicle.getLaneID(self._name))
        if lane is None or lane.junction:
            return None
        if change_m > position + libsumo.lane.getLength(lane.id) - libsumo.vehicle.getLanePosition(self._name) - EDGE_M:
            return None
        adjacent = lane.left if wanted > lane.index else lane.right
        if wanted == lane.index or not adjacent:
            self._lanes.pop(0)
            return None
        target = self._roads.lanes[adjacent]
        return ScheduledLaneChange(
            self._name, target, math.copysign((lane.width + target.width) / 2, wanted - lane.index)
        )

    def _end(self) -> None:
        if self._leaves_at_end:
            libsumo.vehicle.remove(self._name)
        else:
            _set_speed(self._name, -1)
            _set_mode(self._name, FREE)
            libsumo.vehicle.setLaneChangeMode(self._name, AUTONOMOUS)
            libsumo.vehicle.setActionStepLength(self._name, self._action_step_s)
            libsumo.vehicle.setSpeedFactor(self._name, 1.0)  # last: a new action step brings the type's factor back
