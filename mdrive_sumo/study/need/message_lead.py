"""Which stations see a road user, what a message tells of it, and when, in the reference drive."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mdrive_sumo.contract import Objects
from mdrive_sumo.core.geometry import Bool, Int
from mdrive_sumo.core.state import DT, Kind
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.weather import WEATHERS
from mdrive_sumo.sensing.sensing_frame import SensingFrame, SensorPose
from mdrive_sumo.sensing.visibility import BuildingEdges, SightView
from mdrive_sumo.study.need.approach import OVERRUN_M
from mdrive_sumo.study.need.occluders import BIN_TICKS, SightBox, find_opaque
from mdrive_sumo.study.need.sight_tables import SightTables

RANGE_M = 80.0
"""Range of vision of a CAV that tells others, as in occlusion certificates."""
MIN_VISIBLE_SHARE = 0.1
"""A station tells of a road user of which it sees this share of its angular width or more."""
MESSAGE_TICKS = 4
"""From the measurement until the message can change what its receiver does: 0.1 s between CPMs, a tick on the way, one
to decide."""


@dataclass(frozen=True)
class Witnesses:
    """The stations that could tell a CAV of a road user. CAVs move and all road users stand as in the recording."""

    tables: SightTables
    scenario: Scenario
    buildings: BuildingEdges

    @property
    def tells_of_itself(self) -> bool:
        """Whether the road user is a CAV, which knows where it is."""
        return self.tables.zone.road_user < self.tables.record.egos

    def see(self, number: int, tick: int) -> bool:
        """Return whether a station sees the road user early enough before every commitment in a bin of time.

        tick: of the road user's drive at the commitment.
        """
        return self.tells_of_itself or any(self.list_seeing(number, tick))

    def list_seeing(self, number: int, tick: int) -> Iterator[str]:
        """Yield the stations that do, the road user itself first if it is a CAV."""
        tables = self.tables
        if self.tells_of_itself:
            yield tables.record.ids[tables.zone.road_user]
        told = tick - MESSAGE_TICKS
        if told < tables.first_tick:
            return
        cell = int(tables.find_cells(np.array(told)))
        ends = (number * BIN_TICKS - MESSAGE_TICKS, (number + 1) * BIN_TICKS - 1 - MESSAGE_TICKS)
        for name in self._stations:
            if all(end >= 0 and bool(self._look(name, end)[cell]) for end in ends):
                yield name

    def list_seeing_at(self, tick: int) -> Iterator[str]:
        """Yield the stations that know of the road user at a tick of the recording."""
        tables = self.tables
        if self.tells_of_itself:
            yield tables.record.ids[tables.zone.road_user]
        cell = int(tables.find_cells(np.array(tick)))
        yield from (name for name in self._stations if bool(self._look(name, tick)[cell]))

    @cached_property
    def _stations(self) -> list[str]:
        tables = self.tables
        cavs = [name for i, name in enumerate(tables.record.ego_ids) if i not in (tables.ego, tables.zone.road_user)]
        return [*cavs, *(unit.id for unit in self.scenario.rsus)]

    @cached_property
    def _seen(self) -> dict[tuple[str, int], Bool]:
        return {}

    def _look(self, name: str, tick: int) -> Bool:
        """Return (K,) the cells of the road user's drive that a station sees at a tick of the recording."""
        if (name, tick) not in self._seen:
            self._seen[name, tick] = self._compute_view(name, tick)
        return self._seen[name, tick]

    def _compute_view(self, name: str, tick: int) -> Bool:
        e, tables = self.tables.record, self.tables
        unit = next((candidate for candidate in self.scenario.rsus if candidate.id == name), None)
        last_tick = min(tick, e.ticks - 1)
        none = np.zeros(len(tables.cells), dtype=np.bool_)
        if unit is None and (tick >= e.ticks or not e.valid[tick, e.ids.index(name)]):
            return none
        present = np.flatnonzero(e.valid[last_tick])
        present = present[(present != tables.ego) & (present != tables.zone.road_user)]
        x, y, yaw, length, width = np.array(tables.cells).T
        count = len(none)
        boxes = Objects(
            ("",) * (count + len(present)),
            np.concatenate((np.full(count, Kind.PEDESTRIAN, dtype=np.uint8), e.kind[present])),
            np.concatenate((x, e.x[last_tick, present])),
            np.concatenate((y, e.y[last_tick, present])),
            np.concatenate((yaw, e.yaw[last_tick, present])),
            np.zeros(count + len(present)),
            np.concatenate((np.minimum(length, e.length[tables.zone.road_user]), e.length[present])),
            np.concatenate((np.minimum(width, e.width[tables.zone.road_user]), e.width[present])),
        )
        weather = WEATHERS[self.scenario.weather].objects_range
        if unit is not None:
            eye, reach = SensorPose(unit.x, unit.y, 0.0, None), unit.range_m * weather
        else:
            i = e.ids.index(name)
            row = count + int(np.flatnonzero(present == i)[0])
            eye, reach = SensorPose(float(e.x[last_tick, i]), float(e.y[last_tick, i]), 0.0, row), RANGE_M * weather
        view = SightView(eye, SensingFrame(last_tick, boxes, {}), self.buildings, reach)
        return view.visible_rows(MIN_VISIBLE_SHARE)[:count]


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

    @cached_property
    def is_told(self) -> bool:
        """Whether a station can tell the CAV of the road user while the CAV can stop before the zone."""
        if self.witnesses.tells_of_itself:
            return True
        last = min(max(self.find_stopping_tick(), self.tables.first_tick), self.tables.zone.enter)
        return any(any(self.witnesses.list_seeing_at(tick)) for tick in range(last, self.tables.first_tick - 1, -2))

    def find_stopping_tick(self) -> int:
        """Return the last tick at which the CAV could have stopped before the zone."""
        e, motion, zone = self.tables.record, self.tables.motion, self.tables.zone
        last_tick = 0
        for tick in np.flatnonzero(e.valid[:, self.tables.ego]).tolist():
            station = motion.line.project(float(e.x[tick, self.tables.ego]), float(e.y[tick, self.tables.ego]))[0]
            speed = float(e.speed[tick, self.tables.ego])
            if station + speed * speed / (2.0 * motion.deceleration) > zone.enter_m + OVERRUN_M:
                break
            last_tick = tick
        return last_tick

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
