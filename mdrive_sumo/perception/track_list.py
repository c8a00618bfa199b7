"""The tracks of an `ObjectTracker`: association, births, confirmation, standstill and deletion."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mdrive_sumo.contract import Objects, OwnState
from mdrive_sumo.core.geometry import Bool, Float, Int
from mdrive_sumo.core.state import Kind
from mdrive_sumo.perception.assignment import assign
from mdrive_sumo.perception.measurements import OWN_SENSOR, STATIONS, Measurements
from mdrive_sumo.perception.track_states import TrackColumns, TrackStates
from mdrive_sumo.perception.tracking_parameters import TrackingParameters


@dataclass(slots=True)
class TrackHistory(TrackColumns):
    """What is known of N tracks besides their states; all arrays are (N,)."""

    number: Int
    kind: npt.NDArray[np.uint8]
    born_tick: Int
    seen_tick: Int
    hits: Int
    confirmed: Bool
    seen_by_sensor: Bool
    """Whether the own sensor detected it in this update."""
    mean_x: Float
    """Mean position [m] since the track has been at one place,"""
    mean_y: Float
    mean_count: Int
    """the number of positions in it,"""
    mean_tick: Int
    """and since when."""

    @classmethod
    def start(cls, tick: int, first_number: int, new: Measurements, confirmed: bool) -> "TrackHistory":
        """Return a track for every measurement."""
        count = len(new.objects.ids)
        ticks, ones = np.full(count, tick, dtype=np.int64), np.ones(count, dtype=np.int64)
        return cls(
            number=first_number + np.arange(count, dtype=np.int64),
            kind=new.objects.kind.copy(),
            born_tick=ticks,
            seen_tick=ticks.copy(),
            hits=ones,
            confirmed=np.full(count, confirmed, dtype=np.bool_),
            seen_by_sensor=np.full(count, new.source == OWN_SENSOR, dtype=np.bool_),
            mean_x=new.objects.x.copy(),
            mean_y=new.objects.y.copy(),
            mean_count=ones.copy(),
            mean_tick=ticks.copy(),
        )


class TrackList:
    """All tracks of one CAV."""

    def __init__(self, is_confirmed_at_once: bool, parameters: TrackingParameters) -> None:
        """is_confirmed_at_once: whether the detectors in use have no false positives."""
        self._is_confirmed_at_once, self._parameters = is_confirmed_at_once, parameters
        nothing = Measurements.empty()
        self._states = TrackStates.start(nothing, parameters)
        self._history = TrackHistory.start(0, 0, nothing, confirmed=False)
        self._number_by_name: dict[tuple[str, str], int] = {}
        """(source, name there) -> number of the track that this name had last."""
        self._station_by_number: dict[int, str] = {}
        self._source_by_number: dict[int, str] = {}
        """Where each track was born."""
        self._next_number = 0

    def __len__(self) -> int:
        return len(self._history.number)

    def predict(self, seconds: float) -> None:
        """Advance all tracks; begins an update."""
        self._states.predict(seconds, self._parameters)
        self._history.seen_by_sensor[:] = False

    def add(self, tick: int, new: Measurements) -> None:
        """Correct tracks by the measurements of a source, and begin tracks for those that fit to none."""
        count = len(new.objects.ids)
        if not count:
            return
        pairs = np.array(assign(*self._compare(new)), dtype=np.int64).reshape(-1, 2)
        rows, columns = pairs[:, 0], pairs[:, 1]
        if len(rows):
            self._states.correct(rows, new, columns, self._parameters)
            self._record_hits(tick, rows, new)
            self._name(rows, columns, new)
        others = np.ones(count, dtype=np.bool_)
        others[columns] = False
        if others.any():
            self._begin_tracks(tick, new.take(others))

    def _compare(self, new: Measurements) -> tuple[Float, Bool]:
        """Return costs and possible pairs (N, M) of tracks and measurements."""
        states, parameters = self._states, self._parameters
        square = (states.x[:, None] - new.objects.x) ** 2 + (states.y[:, None] - new.objects.y) ** 2
        distance = square / (states.position[:, None] + (new.position + new.bias))
        numbers = [self._number_by_name.get((new.source, name), -1) for name in new.objects.ids]
        named = self._history.number[:, None] == np.array(numbers)
        possible = distance <= np.where(named, parameters.known_name_gate, parameters.gate)
        possible |= square <= (parameters.min_gate_widths * new.objects.width) ** 2
        possible &= is_on_foot(self._history.kind)[:, None] == is_on_foot(new.objects.kind)
        cost = distance - parameters.known_name_bonus * named
        if new.source != OWN_SENSOR:
            cost = cost - parameters.known_name_bonus * self._history.seen_by_sensor[:, None]
        return cost, possible

    def _record_hits(self, tick: int, rows: Int, new: Measurements) -> None:
        """Count the hits, and confirm tracks that can be no false positives."""
        history, parameters = self._history, self._parameters
        history.seen_tick[rows] = tick
        history.hits[rows] += 1
        if new.source == OWN_SENSOR:
            history.seen_by_sensor[rows] = True
        speed = np.hypot(self._states.vx[rows], self._states.vy[rows])
        is_old = tick - history.born_tick[rows] >= parameters.confirmation_ticks
        sources = [self._source_by_number[number] for number in history.number[rows].tolist()]
        is_confirmed_by_another = np.array([source != new.source for source in sources], dtype=np.bool_)
        history.confirmed[rows] |= is_old | (speed > parameters.moving_speed) | is_confirmed_by_another

    def _name(self, rows: Int, columns: Int, new: Measurements) -> None:
        """Remember the names that the source has for the tracks."""
        for row, column in zip(rows.tolist(), columns.tolist(), strict=True):
            self._name_track(row, new.source, new.objects.ids[column])

    def _name_track(self, row: int, source: str, name: str) -> None:
        """Remember one name. A station names its track; a track that had this name before was the same vehicle."""
        number = int(self._history.number[row])
        before = self._number_by_name.get((source, name))
        self._number_by_name[source, name] = number
        if source == STATIONS:
            self._station_by_number[number] = name
            if before is not None and before != number:
                self._station_by_number.pop(before, None)
                self._history.seen_tick[self._history.number == before] = -self._parameters.never_ticks

    def _begin_tracks(self, tick: int, new: Measurements) -> None:
        is_warm = tick < self._parameters.warm_ticks
        confirmed = self._is_confirmed_at_once or is_warm or new.source == STATIONS
        first_row = len(self)
        self._states = self._states.concat(TrackStates.start(new, self._parameters))
        self._history = self._history.concat(TrackHistory.start(tick, self._next_number, new, confirmed))
        for row, name in enumerate(new.objects.ids, first_row):
            self._source_by_number[self._next_number] = new.source
            self._next_number += 1
            self._name_track(row, new.source, name)

    def end_update(self, tick: int) -> None:
        """Update means of standing tracks and drop tracks that were not seen for long."""
        history, parameters = self._history, self._parameters
        self._update_means(tick)
        standing = self._find_standing(tick)
        believed = np.where(standing, parameters.standing_coasting_ticks, parameters.coasting_ticks)
        limit = np.where(history.confirmed, believed, parameters.tentative_ticks)
        kept = tick - history.seen_tick <= limit
        if kept.all():
            return
        self._states, self._history = self._states.take(kept), history.take(kept)
        alive = set(self._history.number.tolist())
        self._number_by_name = {name: number for name, number in self._number_by_name.items() if number in alive}
        for names in (self._station_by_number, self._source_by_number):
            for number in [number for number in names if number not in alive]:
                del names[number]

    def _update_means(self, tick: int) -> None:
        history, states, parameters = self._history, self._states, self._parameters
        radius = parameters.standstill_sigmas * np.sqrt(states.position) + parameters.standstill_m
        left = np.hypot(states.x - history.mean_x, states.y - history.mean_y) > radius
        seen = history.seen_tick == tick
        count = np.where(left, 1, np.minimum(history.mean_count + seen, parameters.standstill_count))
        share = np.where(left, 1.0, seen / count)
        history.mean_x += share * (states.x - history.mean_x)
        history.mean_y += share * (states.y - history.mean_y)
        history.mean_count, history.mean_tick = count, np.where(left, tick, history.mean_tick)

    def _find_standing(self, tick: int) -> Bool:
        """Return a mask (N,): tracks that have stayed at one place for a while."""
        states, parameters = self._states, self._parameters
        limit = parameters.standstill_speed_sigmas * np.sqrt(states.velocity) + parameters.speed_floor
        slow = np.hypot(states.vx, states.vy) <= limit
        return slow & (tick - self._history.mean_tick >= parameters.standstill_ticks)

    def build_objects(self, tick: int, own: OwnState) -> Objects:
        """Return the confirmed tracks as boxes, nearest first."""
        rows = np.flatnonzero(self._history.confirmed)
        states, history, standing = self._states.take(rows), self._history.take(rows), self._find_standing(tick)[rows]
        x, y = np.where(standing, history.mean_x, states.x), np.where(standing, history.mean_y, states.y)
        order = np.argsort(np.hypot(x - own.x, y - own.y), kind="stable")
        return Objects(
            tuple(self._station_by_number.get(number, f"k{number}") for number in history.number.tolist()),
            history.kind, x, y, states.yaw, np.where(standing, 0.0, states.speed), states.length, states.width,
        ).take(order)  # fmt: skip


def is_on_foot(kind: npt.NDArray[np.uint8]) -> Bool:
    """Return a mask (N,): pedestrians and cyclists, which are never taken for other kinds."""
    return (kind == Kind.PEDESTRIAN) | (kind == Kind.CYCLIST)
