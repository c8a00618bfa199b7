"""What a message tells, and when, in the reference drive."""

from dataclasses import dataclass

import numpy as np

from mdrive_sumo.core.geometry import Int
from mdrive_sumo.core.state import DT
from mdrive_sumo.study.need.approach import OVERRUN_M
from mdrive_sumo.study.need.occluders import SightBox, find_opaque
from mdrive_sumo.study.need.sight_tables import SightTables
from mdrive_sumo.study.need.witnesses import Witnesses


@dataclass(frozen=True, slots=True)
class MessageLead:
    """Times [s] of the reference drive."""

    stopping_s: float
    own_sight_s: float | None
    told_s: float | None
    stations: tuple[str, ...]
    lead_s: float


@dataclass(frozen=True)
class ReferenceDrive:
    """One CAV and one road user in the recording."""

    tables: SightTables
    witnesses: Witnesses

    def find_warning(self) -> MessageLead:
        """Return when the CAV could stop, when it sees the road user, and when stations could tell it."""
        stopping, zone = self.find_stopping_tick(), self.tables.zone
        seeing = self.find_own_sight()
        ticks = range(self.tables.first_tick, zone.enter + 1, 2)
        told = {name: tick for tick in reversed(ticks) for name in self.witnesses.list_seeing_at(tick)}
        in_time = sorted((tick, name) for name, tick in told.items() if tick <= max(stopping, self.tables.first_tick))
        first = in_time[0][0] if in_time else None
        until = zone.enter if seeing is None else seeing
        return MessageLead(
            stopping_s=round(stopping * DT, 2),
            own_sight_s=None if seeing is None else round(seeing * DT, 2),
            told_s=None if first is None else round(first * DT, 2),
            stations=tuple(name for _, name in in_time),
            lead_s=0.0 if first is None else round(max(until - first, 0) * DT, 2),
        )

    def find_stopping_tick(self) -> int:
        """Return the last tick at which the CAV could have stopped before the zone."""
        e, motion, zone = self.tables.record, self.tables.motion, self.tables.zone
        found = 0
        for tick in np.flatnonzero(e.valid[:, self.tables.ego]).tolist():
            station = motion.line.project(float(e.x[tick, self.tables.ego]), float(e.y[tick, self.tables.ego]))[0]
            speed = float(e.speed[tick, self.tables.ego])
            if station + speed * speed / (2.0 * motion.deceleration) > zone.enter_m + OVERRUN_M:
                break
            found = tick
        return found

    def find_own_sight(self) -> int | None:
        """Return the first tick at which the CAV sees anything of the road user, or None."""
        e, ego, user = self.tables.record, self.tables.ego, self.tables.zone.road_user
        both = np.flatnonzero(e.valid[:, ego] & e.valid[:, user])
        return next((tick for tick in both[both <= self.tables.zone.leave].tolist() if self._sees(tick)), None)

    def _sees(self, tick: int) -> bool:
        e, ego, user = self.tables.record, self.tables.ego, self.tables.zone.road_user
        eye = float(e.x[tick, ego]), float(e.y[tick, ego])
        others = tuple(self._box(tick, i) for i in self._list_opaque(tick).tolist())
        return bool(self.tables.occluders.find_visible(eye, 0.0, others, (self._box(tick, user),))[0])

    def _list_opaque(self, tick: int) -> Int:
        e = self.tables.record
        opaque = e.valid[tick] & find_opaque(e, self.tables.vehicles.over_roofs)
        opaque[[self.tables.ego, self.tables.zone.road_user]] = False
        return np.flatnonzero(opaque)

    def _box(self, tick: int, i: int) -> SightBox:
        e = self.tables.record
        x, y, yaw = (float(values[tick, i]) for values in (e.x, e.y, e.yaw))
        return SightBox(x, y, yaw, float(e.length[i]), float(e.width[i]))
