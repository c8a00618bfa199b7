"""Driving by schedule: what SUMO is told on every step about a vehicle that has one."""

# pyright: basic
import math

import libsumo

from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.background import BackgroundVehicle
from mdrive_sumo.sumo.lane_change import DURATION_S, LaneChange, Others
from mdrive_sumo.sumo.schedule import LATE_M, THERE_M, Timetable

_distance, _speed, _set_speed, _set_mode = (
    getattr(libsumo.libsumo._libsumo, f"vehicle_{what}")
    for what in ("getDistance", "getSpeed", "setSpeed", "setSpeedMode")
)
HELD_BACK_MPS = 0.5
"""Who is slower than it desires is left to SUMO: a vehicle with a commanded speed never brakes harder than comfortable.
"""
BOUND, BY_LOG, FREE = 31 | 64, 55 | 64, 31
"""Speed modes. All but the speed limit (64) bind: following, acceleration, right of way, red lights; the same without
right of way at junctions (8) and on them (32), which the log has settled; SUMO's default."""
ORDERED, AUTONOMOUS = 0b01_00_00_00_00, 0b01_10_01_01_01_01
"""Lane-change modes: none of its own; SUMO's default."""
EDGE_M = 0.5
"""A change whose place is nearer than this to the end of an edge belongs to the next one."""


class Scheduled:
    """A vehicle that is on the road and follows its schedule."""

    def __init__(self, vehicle: BackgroundVehicle, since: float, roads: RoadMap, action_step_s: float) -> None:
        """`since`: where along its route [m] it came onto the road. `action_step_s`: once its schedule has ended."""
        assert vehicle.schedule is not None
        self._roads, self._action_step_s = roads, action_step_s
        self._changing: LaneChange | None = None
        self._name = vehicle.id
        self._table = Timetable(vehicle.schedule)
        self._leaves = vehicle.schedule.leaves
        self._lanes = [one for one in vehicle.schedule.lanes if one[0] > since]
        self._since = since
        self._mode, self._late = -1, False
        libsumo.vehicle.setLaneChangeMode(self._name, ORDERED)

    @property
    def offset(self) -> tuple[float, float] | None:
        """How far a lane change has taken it aside, and how fast, as `LaneChange.offset`; None without one."""
        return self._changing.offset if self._changing else None

    @property
    def late(self) -> bool:
        """Whether it is so late that right of way is to be settled anew."""
        return self._late

    def drive(self, tick: int, others: Others, disturbed: bool) -> bool:
        """Commands it for the step that makes frame `tick`; False once its schedule has ended."""
        name, table = self._name, self._table
        place = self._since + _distance(name)
        if tick > table.ends_tick and place >= table.ends_m - THERE_M:
            self._end()
            return False
        self._late = table.place(tick - 1) - place > LATE_M
        self._bind(self._late or disturbed)
        speed = table.desired(tick - 1, place)
        _set_speed(name, speed if speed - _speed(name) < HELD_BACK_MPS else -1)
        if self._changing or (self._lanes and place + speed * DURATION_S / 2 >= self._lanes[0][0]):
            self._change(place, others)
        return True

    def _bind(self, bound: bool) -> None:
        mode = BOUND if bound else BY_LOG
        if mode != self._mode:
            _set_mode(self._name, mode)
            self._mode = mode

    def _change(self, place: float, others: Others) -> None:
        """Goes on with the lane change, or begins the one that is due."""
        if self._changing is None:
            self._changing = self._begun(place)
        if self._changing is not None:
            self._changing.advance(others)
            if self._changing.done:
                self._changing = None

    def _begun(self, place: float) -> LaneChange | None:
        """The next lane change, once the vehicle is on the edge where it is meant."""
        while len(self._lanes) > 1 and place >= self._lanes[1][0]:
            self._lanes.pop(0)
        at, wanted = self._lanes[0]
        lane = self._roads.lanes.get(libsumo.vehicle.getLaneID(self._name))
        if lane is None or lane.junction:
            return None
        if at > place + libsumo.lane.getLength(lane.id) - libsumo.vehicle.getLanePosition(self._name) - EDGE_M:
            return None
        beside = lane.left if wanted > lane.index else lane.right
        if wanted == lane.index or not beside:
            self._lanes.pop(0)
            return None
        target = self._roads.lanes[beside]
        return LaneChange(self._name, target, math.copysign((lane.width + target.width) / 2, wanted - lane.index))

    def _end(self) -> None:
        if self._leaves:
            libsumo.vehicle.remove(self._name)
        else:
            _set_speed(self._name, -1)
            _set_mode(self._name, FREE)
            libsumo.vehicle.setLaneChangeMode(self._name, AUTONOMOUS)
            libsumo.vehicle.setActionStepLength(self._name, self._action_step_s)
            libsumo.vehicle.setSpeedFactor(self._name, 1.0)  # last: a new action step brings the type's factor back
