"""Which other CAVs and road-side units see a road user, if it comes at another time than in the recording."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mdrive_sumo.contract import Objects
from mdrive_sumo.core.geometry import Bool
from mdrive_sumo.core.state import Kind
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.weather import WEATHERS
from mdrive_sumo.sensing.sensing_frame import SensingFrame, SensorPose
from mdrive_sumo.sensing.visibility import BuildingEdges, SightView
from mdrive_sumo.study.need.occluders import BIN_TICKS
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
            if all(at >= 0 and bool(self._look(name, at)[cell]) for at in ends):
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
        unit = next((one for one in self.scenario.rsus if one.id == name), None)
        at = min(tick, e.ticks - 1)
        none = np.zeros(len(tables.cells), dtype=np.bool_)
        if unit is None and (tick >= e.ticks or not e.valid[tick, e.ids.index(name)]):
            return none
        here = np.flatnonzero(e.valid[at])
        here = here[(here != tables.ego) & (here != tables.zone.road_user)]
        x, y, yaw, length, width = np.array(tables.cells).T
        count = len(none)
        boxes = Objects(
            ("",) * (count + len(here)),
            np.concatenate((np.full(count, Kind.PEDESTRIAN, dtype=np.uint8), e.kind[here])),
            np.concatenate((x, e.x[at, here])),
            np.concatenate((y, e.y[at, here])),
            np.concatenate((yaw, e.yaw[at, here])),
            np.zeros(count + len(here)),
            np.concatenate((np.minimum(length, e.length[tables.zone.road_user]), e.length[here])),
            np.concatenate((np.minimum(width, e.width[tables.zone.road_user]), e.width[here])),
        )
        weather = WEATHERS[self.scenario.weather].objects_range
        if unit is not None:
            eye, reach = SensorPose(unit.x, unit.y, 0.0, None), unit.range_m * weather
        else:
            i = e.ids.index(name)
            row = count + int(np.flatnonzero(here == i)[0])
            eye, reach = SensorPose(float(e.x[at, i]), float(e.y[at, i]), 0.0, row), RANGE_M * weather
        view = SightView(eye, SensingFrame(at, boxes, {}), self.buildings, reach)
        return view.visible_rows(MIN_VISIBLE_SHARE)[:count]
