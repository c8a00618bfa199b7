"""Vehicles that are parked beside their lane at the start and pull out.

SUMO lets them wait off the road and come back to the lane when there is a gap. It has no pose for that, so they are
shown at their place, and move over onto the lane along the first metres that they drive.
"""

# pyright: basic
# Because libsumo has no type information.
from dataclasses import dataclass, replace

import libsumo

from mdrive_sumo.core import portable
from mdrive_sumo.core.state import DT, Actors
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.background import BackgroundVehicle

PARKING_FLAG = 1
"""SUMO's stop flag: beside the road."""
PARKING_STATE = 2
"""Bit of SUMO's stop state: it stands beside the road."""
OUT_M = 14.0
"""[m] Way along which a vehicle moves over onto its lane: a little more than a car's length of turning out and back."""


@dataclass(frozen=True, slots=True)
class _Parked:
    """Pose x, y [m], yaw [rad] of the box; how far it has driven [m], and its first offset [m] from the lane."""

    x: float
    y: float
    yaw: float
    has_parked: bool = False
    driven_m: float = 0.0
    offset_m: float | None = None
    """None while it is parked."""


class ParkedDepartures:
    """The vehicles of an episode that are parked or pull out."""

    def __init__(self, roads: RoadMap, action_step_s: float) -> None:
        self._roads, self._action_step_s = roads, action_step_s
        self._parked: dict[str, _Parked] = {}

    def add(self, vehicle: BackgroundVehicle) -> None:
        """Park a vehicle that has just been added to SUMO."""
        assert vehicle.parked is not None
        lane = self._roads.lanes[f"{vehicle.edges[0]}_{vehicle.depart_lane}"]
        station = vehicle.depart_pos_m * lane.centre.length / libsumo.lane.getLength(lane.id) - vehicle.length / 2
        (x, y), yaw = lane.centre.at(station), lane.centre.yaw_at(station)
        cos, sin = portable.cos_sin(yaw)
        offset = vehicle.parked.offset_m
        self._parked[vehicle.id] = _Parked(x - sin * offset, y + cos * offset, yaw)
        # Off the road SUMO 1.x takes a whole action step from the duration in every step; and a vehicle that is told
        # to resume is gone until there is a gap, one whose time is over waits in its place.
        duration_s = vehicle.parked.leaves_s / DT * self._action_step_s
        libsumo.vehicle.setStop(vehicle.id, lane.edge, vehicle.depart_pos_m, lane.index, duration_s, PARKING_FLAG)

    def show(self, driven: Actors) -> None:
        """Put the vehicles where they are parked or as far as they have pulled out, in place."""
        for name, state in list(self._parked.items()):
            if name not in driven.ids:
                continue
            i = driven.ids.index(name)
            is_parked = bool(libsumo.vehicle.getStopState(name) & PARKING_STATE)
            if is_parked or not state.has_parked:
                self._parked[name] = replace(state, has_parked=is_parked)
                driven.x[i], driven.y[i], driven.yaw[i], driven.speed[i] = state.x, state.y, state.yaw, 0.0
                continue
            after = _move_over(driven, i, state)
            if after.driven_m < OUT_M:
                self._parked[name] = after
            else:
                del self._parked[name]


def _move_over(driven: Actors, i: int, state: _Parked) -> _Parked:
    """Shift a vehicle that pulls out towards its place, in place; return its state."""
    cos, sin = portable.cos_sin(driven.yaw[i])
    first = state.offset_m
    if first is None:
        first = float(-sin * (state.x - driven.x[i]) + cos * (state.y - driven.y[i]))
    share = min(state.driven_m / OUT_M, 1.0)
    offset = first * (1.0 - share * share * (3.0 - 2.0 * share))
    slope = -first * 6.0 * share * (1.0 - share) / OUT_M
    driven.x[i] -= sin * offset
    driven.y[i] += cos * offset
    driven.yaw[i] += portable.atan2(slope, 1.0)
    return replace(state, driven_m=state.driven_m + float(driven.speed[i]) * DT, offset_m=first)
