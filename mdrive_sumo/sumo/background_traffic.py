"""SUMO's own traffic: background vehicles of a scenario with their departures and schedules, held after impacts."""

# pyright: basic
from collections.abc import Callable, Collection, Sequence

import libsumo
import numpy as np

from mdrive_sumo.core.state import DT, STRUCK_HOLD_TICKS, Actors
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.background import Background, BackgroundVehicle
from mdrive_sumo.sumo.conflict import Mover, meets
from mdrive_sumo.sumo.insertion import Berth, add_type, berth_of, depart, free, type_of
from mdrive_sumo.sumo.lane_change import Others
from mdrive_sumo.sumo.planned_poses import plans_of
from mdrive_sumo.sumo.scheduled_driving import FREE, Scheduled

LOOK_TICKS = 4
"""How often it is looked for vehicles on schedule that are in somebody's way: every 0.2 s."""


class Traffic:
    """Background vehicles from their departure on. One object an episode."""

    def __init__(self, background: Background, roads: RoadMap) -> None:
        self._background, self._roads = background, roads
        self._held: dict[str, int] = {}
        self._waiting: list[tuple[BackgroundVehicle, Berth]] = []
        self._driving: dict[str, Scheduled] = {}
        self._departed: list[str] = []
        self._disturbed: set[str] = set()
        self.drives = False
        """Whether SUMO drives anybody, now or later."""

    def add(self) -> None:
        """Hands vehicles over to SUMO, once after its start. Those with a schedule are kept back until they depart."""
        for vehicle in self._background.vehicles:
            if self._background.mode != "reactive" and vehicle.log:
                continue
            self._introduce(vehicle)
            if vehicle.schedule is None:
                _add(vehicle)
            else:
                self._waiting.append((vehicle, berth_of(vehicle, self._roads)))

        self._plans = plans_of(self._background.vehicles, self._roads)

    def _introduce(self, vehicle: BackgroundVehicle) -> None:
        self.drives = True
        add_type(vehicle)
        libsumo.route.add(vehicle.id, list(vehicle.edges))

    def take(self, vehicle: BackgroundVehicle, berth: Berth) -> None:
        """Takes over a vehicle that has been on its log."""
        self._introduce(vehicle)
        self._waiting.append((vehicle, berth))

    def prepare(self, tick: int, others: Others, movers: Callable[[], Sequence[Mover]]) -> None:
        """Before the step that makes frame `tick`: departures, speeds. `movers`: who keeps to no schedule."""
        if not (self._waiting or self._driving or self._departed):
            return
        for arrived in libsumo.simulation.getArrivedIDList():
            self._driving.pop(arrived, None)
        if tick % LOOK_TICKS == 0:
            self._disturbed = self._in_conflict(tick, movers())
        for name, scheduled in list(self._driving.items()):
            if name not in self._held and not scheduled.drive(tick, others, name in self._disturbed):
                del self._driving[name]
        for name in self._departed:
            libsumo.vehicle.setSpeed(name, -1)
            libsumo.vehicle.setSpeedMode(name, FREE)
            libsumo.vehicle.setSpeedFactor(name, 1.0)
        self._departed.clear()
        due = [one for one in self._waiting if one[0].depart_s < (tick + 0.5) * DT]
        if due:
            self._depart(due, others())

    def _in_conflict(self, tick: int, movers: Sequence[Mover]) -> set[str]:
        """Vehicles on schedule whose way leads into somebody who has none, or is off it."""
        plans = self._plans
        if tick >= plans.present.shape[1]:
            return set()
        on_time = [one.id in self._driving and not self._driving[one.id].late for one in plans.vehicles]
        there = plans.present[:, tick] & np.array(on_time, dtype=np.bool_)
        met = np.zeros_like(there)
        for mover in movers:
            met |= meets(plans, tick, there & ~met, mover)
        return {plans.vehicles[i].id for i in np.flatnonzero(met)}

    @property
    def on_time(self) -> set[str]:
        """Ids of the vehicles that are where their schedule has them."""
        return {name for name, scheduled in self._driving.items() if not scheduled.late}

    def _depart(self, due: list[tuple[BackgroundVehicle, Berth]], others: Actors) -> None:
        for vehicle, berth in due:
            if not free(berth, others):
                continue
            depart(vehicle, berth)
            self._waiting.remove((vehicle, berth))
            if vehicle.schedule is not None:
                self._driving[vehicle.id] = Scheduled(vehicle, berth.since, self._roads, self._background.action_step_s)
            else:
                self._departed.append(vehicle.id)

    @property
    def offsets(self) -> dict[str, tuple[float, float]]:
        """By id, how far lane changes have taken vehicles aside of where SUMO has them, and how fast [m, m/s]."""
        found = ((name, scheduled.offset) for name, scheduled in self._driving.items())
        return {name: offset for name, offset in found if offset is not None}

    def hold(self, struck: Collection[str], tick: int) -> None:
        """Struck vehicles stand for a while: a surrogate, SUMO knows no impact."""
        ours = {vehicle.id for vehicle in self._background.vehicles} if struck else set()
        self._held |= dict.fromkeys(ours.intersection(struck), tick + STRUCK_HOLD_TICKS)
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


def _add(vehicle: BackgroundVehicle) -> None:
    """SUMO inserts it as soon as it finds that safe."""
    libsumo.vehicle.add(
        vehicle.id, vehicle.id, typeID=type_of(vehicle), depart=f"{vehicle.depart_s:.3f}",
        departLane=str(vehicle.depart_lane), departPos=str(vehicle.depart_pos_m), departSpeed=str(vehicle.depart_speed),
    )  # fmt: skip
