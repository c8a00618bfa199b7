"""Background vehicles that SUMO drives: departures, schedules, and standing still after an impact."""

# pyright: basic
# Because libsumo has no type information.
from collections.abc import Callable, Collection, Sequence

import libsumo
import numpy as np

from mdrive_sumo.core.state import DT, STRUCK_HOLD_TICKS, Actors
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.background import Background, BackgroundVehicle
from mdrive_sumo.sumo.conflict import MovingBox, find_conflicts
from mdrive_sumo.sumo.insertion import (
    InsertionPoint,
    add_vehicle_type,
    build_type_id,
    find_departure_point,
    insert_vehicle,
    is_free,
)
from mdrive_sumo.sumo.lane_change import RoadUsersProvider
from mdrive_sumo.sumo.parked_departure import ParkedDepartures
from mdrive_sumo.sumo.planned_poses import build_planned_poses
from mdrive_sumo.sumo.scheduled_driving import FREE, ScheduleFollower

NO_CHANGES = 0b10_0000_0000
"""SUMO's lane change mode without any change of its own."""
CONFLICT_SEARCH_TICKS = 4
"""Interval of the search for conflicts of vehicles on schedule with others: 0.2 s."""


class BackgroundTraffic:
    """The background vehicles of one episode, from their departure on."""

    def __init__(self, background: Background, roads: RoadMap) -> None:
        self._background, self._roads = background, roads
        self._held: dict[str, int] = {}
        self._waiting: list[tuple[BackgroundVehicle, InsertionPoint]] = []
        self._followers: dict[str, ScheduleFollower] = {}
        self._just_departed: list[str] = []
        self._disturbed: set[str] = set()
        self._parked = ParkedDepartures(roads, background.action_step_s)
        self.has_vehicles = False
        """Whether SUMO drives any vehicle, now or later."""

    def add_vehicles(self) -> None:
        """Add the vehicles to SUMO, once after its start. Those with a schedule are inserted when they depart."""
        for vehicle in self._background.vehicles:
            if self._background.mode != "reactive" and vehicle.log:
                continue
            self._register(vehicle)
            if vehicle.schedule is None:
                _add_reactive(vehicle)
                if vehicle.parked is not None:
                    self._parked.add(vehicle)
            else:
                self._waiting.append((vehicle, find_departure_point(vehicle, self._roads)))

        self._planned_poses = build_planned_poses(self._background.vehicles, self._roads)

    def _register(self, vehicle: BackgroundVehicle) -> None:
        self.has_vehicles = True
        add_vehicle_type(vehicle)
        libsumo.route.add(vehicle.id, list(vehicle.edges))

    def take_over(self, vehicle: BackgroundVehicle, point: InsertionPoint) -> None:
        """Take over a vehicle that leaves its log."""
        self._register(vehicle)
        self._waiting.append((vehicle, point))

    def prepare(self, tick: int, road_users: RoadUsersProvider, unscheduled: Callable[[], Sequence[MovingBox]]) -> None:
        """Insert departing vehicles and command speeds before the step that produces frame `tick`.

        `road_users`: all road users of the last tick; `unscheduled`: the moving ones that follow no schedule.
        """
        if not (self._waiting or self._followers or self._just_departed):
            return
        for arrived in libsumo.simulation.getArrivedIDList():
            self._followers.pop(arrived, None)
        if tick % CONFLICT_SEARCH_TICKS == 0:
            self._disturbed = self._find_in_conflict(tick, unscheduled())
        for name, follower in list(self._followers.items()):
            if name not in self._held and not follower.drive(tick, road_users, name in self._disturbed):
                del self._followers[name]
        for name in self._just_departed:
            libsumo.vehicle.setSpeed(name, -1)
            libsumo.vehicle.setSpeedMode(name, FREE)
            libsumo.vehicle.setSpeedFactor(name, 1.0)
        self._just_departed.clear()
        due = [one for one in self._waiting if one[0].depart_s < (tick + 0.5) * DT]
        if due:
            self._insert_due(due, road_users())

    def _find_in_conflict(self, tick: int, unscheduled: Sequence[MovingBox]) -> set[str]:
        """Return the ids of vehicles on schedule whose planned path leads into an unscheduled or late road user."""
        plans = self._planned_poses
        if tick >= plans.present.shape[1]:
            return set()
        is_on_schedule = [one.id in self._followers and not self._followers[one.id].is_late for one in plans.vehicles]
        is_candidate = plans.present[:, tick] & np.array(is_on_schedule, dtype=np.bool_)
        in_conflict = np.zeros_like(is_candidate)
        for mover in unscheduled:
            in_conflict |= find_conflicts(plans, tick, is_candidate & ~in_conflict, mover)
        return {plans.vehicles[i].id for i in np.flatnonzero(in_conflict)}

    @property
    def on_schedule_ids(self) -> set[str]:
        """Ids of the vehicles that are at the position of their schedule."""
        return {name for name, follower in self._followers.items() if not follower.is_late}

    def _insert_due(self, due: list[tuple[BackgroundVehicle, InsertionPoint]], road_users: Actors) -> None:
        for vehicle, point in due:
            if not is_free(point, road_users):
                continue
            insert_vehicle(vehicle, point)
            self._waiting.remove((vehicle, point))
            if vehicle.schedule is not None:
                self._followers[vehicle.id] = ScheduleFollower(
                    vehicle, point.route_offset_m, self._roads, self._background.action_step_s
                )
            else:
                self._just_departed.append(vehicle.id)

    def show_parked(self, driven: Actors) -> None:
        """Put vehicles that are parked or pull out in their place, in newly read actors."""
        self._parked.show(driven)

    @property
    def lane_change_offsets(self) -> dict[str, tuple[float, float]]:
        """Lateral offset [m] from the position in SUMO, and its rate [m/s], by vehicle that changes lanes."""
        followers = self._followers.items()
        return {name: offset for name, follower in followers if (offset := follower.offset) is not None}

    def hold(self, struck: Collection[str], tick: int) -> None:
        """Stop struck vehicles for `STRUCK_HOLD_TICKS`: a surrogate, because SUMO models no impact."""
        if struck:
            background_ids = {vehicle.id for vehicle in self._background.vehicles}
            self._held |= dict.fromkeys(background_ids.intersection(struck), tick + STRUCK_HOLD_TICKS)
        if not self._held:
            return
        present = set(libsumo.vehicle.getIDList())
        for vehicle, until in sorted(self._held.items()):
            if vehicle not in present or tick >= until:
                del self._held[vehicle]
                if vehicle in present:
                    libsumo.vehicle.setSpeed(vehicle, -1)
            else:
                libsumo.vehicle.setPreviousSpeed(vehicle, 0.0)
                libsumo.vehicle.setSpeed(vehicle, 0.0)


def _add_reactive(vehicle: BackgroundVehicle) -> None:
    """Let SUMO insert the vehicle as soon as that is safe."""
    libsumo.vehicle.add(
        vehicle.id, vehicle.id, typeID=build_type_id(vehicle), depart=f"{vehicle.depart_s:.3f}",
        departLane=str(vehicle.depart_lane), departPos=str(vehicle.depart_pos_m), departSpeed=str(vehicle.depart_speed),
    )  # fmt: skip
    if vehicle.keeps_lane:
        libsumo.vehicle.setLaneChangeMode(vehicle.id, NO_CHANGES)
    for stop in vehicle.stops:
        libsumo.vehicle.setStop(vehicle.id, stop.edge, stop.pos_m, stop.lane, stop.duration_s)
