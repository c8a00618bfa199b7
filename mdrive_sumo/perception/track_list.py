"""The tracks of an `ObjectTracker`: association, births, confirmation, standstill and deletion."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mdrive_sumo.contract import Objects, OwnState
from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Bool, Float, Int, wrap_angles
from mdrive_sumo.core.state import Kind
from mdrive_sumo.perception.assignment import assign
from mdrive_sumo.perception.measurements import OWN_SENSOR, STATIONS, Measurements
from mdrive_sumo.perception.track_states import Correction, TrackColumns, TrackStates
from mdrive_sumo.perception.tracking_parameters import TrackingParameters


@dataclass(slots=True)
class TrackHistory(TrackColumns):
    """What is known of N tracks besides their states; all arrays are (N,)."""

    number: Int
    kind: npt.NDArray[np.uint8]
    born_tick: Int
    seen_tick: Int
    confirmed: Bool
    seen_by_sensor: Bool
    """Whether the own sensor detected it in this update."""
    mean_x: Float
    """Mean position [m] since the track has been at one place,"""
    mean_y: Float
    mean_vx: Float
    """mean velocity [m/s] since then,"""
    mean_vy: Float
    mean_count: Int
    """the number of positions in it,"""
    mean_tick: Int
    """and since when."""

    @classmethod
    def start(cls, tick: int, first_number: int, new: Measurements, confirmed: Bool) -> "TrackHistory":
        """Return a track for every measurement."""
        count = len(new.objects.ids)
        ticks = np.full(count, tick, dtype=np.int64)
        return cls(
            number=first_number + np.arange(count, dtype=np.int64),
            kind=new.objects.kind.copy(),
            born_tick=ticks,
            seen_tick=ticks.copy(),
            confirmed=confirmed,
            seen_by_sensor=np.array([source == OWN_SENSOR for source in new.sources], dtype=np.bool_),
            mean_x=new.objects.x.copy(),
            mean_y=new.objects.y.copy(),
            mean_vx=new.objects.speed * portable.cos(new.objects.yaw),
            mean_vy=new.objects.speed * portable.sin(new.objects.yaw),
            mean_count=np.ones(count, dtype=np.int64),
            mean_tick=ticks.copy(),
        )


class TrackList:
    """All tracks of one CAV."""

    def __init__(self, is_confirmed_at_once: bool, parameters: TrackingParameters) -> None:
        """is_confirmed_at_once: whether the detectors in use have no false positives."""
        self._is_confirmed_at_once, self._parameters = is_confirmed_at_once, parameters
        nothing = Measurements.empty()
        self._states = TrackStates.start(nothing, parameters)
        self._history = TrackHistory.start(0, 0, nothing, np.zeros(0, dtype=np.bool_))
        self._number_by_name: dict[tuple[str, str], int] = {}
        """(source, name there) -> number of the track that this name had last."""
        self._station_by_number: dict[int, str] = {}
        self._source_by_number: dict[int, str] = {}
        """Where each track was born."""
        self._next_number = self._first_new_number = 0

    def __len__(self) -> int:
        return len(self._history.number)

    def predict(self, seconds: float) -> None:
        """Advance all tracks; begins an update."""
        self._states.predict(seconds, self._parameters)
        self._history.seen_by_sensor[:] = False

    def add(self, tick: int, new: Measurements) -> None:
        """Correct tracks by measurements, and begin tracks for those that fit to none."""
        if not new.sources:
            return
        rows, columns = assign(*self._compare(new), _find_starts(new.sources))
        if len(rows):
            self._states.correct(*Correction.build(rows, new, columns), self._parameters)
            self._record_hits(tick, rows, columns, new)
        others = np.ones(len(new.sources), dtype=np.bool_)
        others[columns] = False
        if others.any():
            self._begin_tracks(tick, new.take(others))

    def _compare(self, new: Measurements) -> tuple[Float, Bool]:
        """Return costs and possible pairs (N, M) of tracks and measurements."""
        states, parameters = self._states, self._parameters
        square = portable.square(states.x[:, None] - new.objects.x) + portable.square(states.y[:, None] - new.objects.y)
        distance = square / (states.position[:, None] + (new.position + new.bias))
        names = zip(new.sources, new.objects.ids, strict=True)
        named = self._history.number[:, None] == np.array([self._number_by_name.get(name, -1) for name in names])
        possible = distance <= np.where(named, parameters.known_name_gate, parameters.gate)
        possible |= square <= portable.square(parameters.min_gate_widths * new.objects.width)
        possible &= is_on_foot(self._history.kind)[:, None] == is_on_foot(new.objects.kind)
        cost = distance - parameters.known_name_bonus * named
        if new.sources[0] != OWN_SENSOR:
            cost -= parameters.known_name_bonus * self._history.seen_by_sensor[:, None]
        return cost, possible

    def _record_hits(self, tick: int, rows: Int, columns: Int, new: Measurements) -> None:
        """Record which tracks were measured, under which names, and confirm those that can be no false positives."""
        history, parameters = self._history, self._parameters
        history.seen_tick[rows] = tick
        history.seen_by_sensor[rows] |= new.sources[0] == OWN_SENSOR
        speed = portable.hypot(self._states.vx[rows], self._states.vy[rows])
        believed = tick - history.born_tick[rows] >= parameters.confirmation_ticks
        believed |= speed > parameters.moving_speed
        history.confirmed[rows] |= believed
        for row, column in zip(rows.tolist(), columns.tolist(), strict=True):
            source, number = new.sources[column], int(history.number[row])
            if self._source_by_number[number] != source:
                history.confirmed[row] = True
            self._name_track(number, source, new.objects.ids[column])

    def _name_track(self, number: int, source: str, name: str) -> None:
        """Remember one name. A station names its track; a track that had this name before was the same vehicle."""
        before = self._number_by_name.get((source, name))
        self._number_by_name[source, name] = number
        if source == STATIONS:
            self._station_by_number[number] = name
            if before is not None and before != number:
                self._station_by_number.pop(before, None)
                self._history.seen_tick[self._history.number == before] = -self._parameters.never_ticks

    def _begin_tracks(self, tick: int, new: Measurements) -> None:
        """Begin tracks, one source after the other: what two of them measured is one object."""
        starts = _find_starts(new.sources).tolist()
        for low, high in zip(starts, [*starts[1:], len(new.sources)], strict=True):
            part = new.take(_mask_range(len(new.sources), low, high))
            if low:
                cost, possible = self._compare(part)
                possible &= (self._history.number >= self._first_new_number)[:, None]
                rows, columns = assign(cost, possible, np.zeros(1, dtype=np.int64))
                self._record_hits(tick, rows, columns, part)
                others = np.ones(high - low, dtype=np.bool_)
                others[columns] = False
                part = part.take(others)
            else:
                self._first_new_number = self._next_number
            self._append(tick, part)

    def _append(self, tick: int, new: Measurements) -> None:
        """Begin a track for every measurement."""
        at_once = self._is_confirmed_at_once or tick < self._parameters.warm_ticks
        confirmed = np.array([at_once or source == STATIONS for source in new.sources], dtype=np.bool_)
        self._states = self._states.concat(TrackStates.start(new, self._parameters))
        self._history = self._history.concat(TrackHistory.start(tick, self._next_number, new, confirmed))
        for source, name in zip(new.sources, new.objects.ids, strict=True):
            self._source_by_number[self._next_number] = source
            self._name_track(self._next_number, source, name)
            self._next_number += 1

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
        left = portable.hypot(states.x - history.mean_x, states.y - history.mean_y) > radius
        seen = history.seen_tick == tick
        count = np.where(left, 1, np.minimum(history.mean_count + seen, parameters.standstill_count))
        share = np.where(left, 1.0, seen / count)
        history.mean_x += share * (states.x - history.mean_x)
        history.mean_y += share * (states.y - history.mean_y)
        history.mean_vx += share * (states.vx - history.mean_vx)
        history.mean_vy += share * (states.vy - history.mean_vy)
        history.mean_count, history.mean_tick = count, np.where(left, tick, history.mean_tick)

    def _find_standing(self, tick: int) -> Bool:
        """Return a mask (N,): tracks that have stayed at one place for a while.

        Their speed is about 0 now, and in the mean over that time: the single speed of a vehicle at walking pace is
        hardly different from 0, its mean is.
        """
        states, history, parameters = self._states, self._history, self._parameters
        age = tick - history.mean_tick
        count = np.clip(age / parameters.correlation_ticks, 1.0, parameters.standstill_speeds)
        sigma = parameters.standstill_speed_sigmas * np.sqrt(states.velocity)
        slow = portable.hypot(states.vx, states.vy) <= sigma + parameters.speed_floor
        slow &= portable.hypot(history.mean_vx, history.mean_vy) <= sigma / np.sqrt(count) + parameters.speed_floor
        return slow & (age >= parameters.standstill_ticks)

    def get_position_sigmas(self) -> Mapping[str, float]:
        """Return the standard deviation [m] of each coordinate of the position by the id of the track."""
        names = self._get_names(np.arange(len(self)))
        return dict(zip(names, np.sqrt(self._states.position).tolist(), strict=True))

    def _get_names(self, rows: Int) -> tuple[str, ...]:
        """Return the ids of tracks: of their stations, or of their own."""
        numbers = self._history.number[rows].tolist()
        return tuple(self._station_by_number.get(number, f"k{number}") for number in numbers)

    def _find_lead(self, own: OwnState) -> Bool:
        """Return a mask (N,): vehicles shortly ahead in the own direction."""
        states, parameters = self._states, self._parameters
        cos, sin = portable.cos_sin(own.yaw)
        dx, dy = states.x - own.x, states.y - own.y
        ahead, aside = dx * cos + dy * sin, dy * cos - dx * sin
        lead = (self._history.kind == Kind.VEHICLE) & (np.abs(wrap_angles(states.yaw - own.yaw)) < parameters.lead_yaw)
        return lead & (ahead > 0) & (ahead < parameters.lead_m) & (np.abs(aside) < parameters.lead_lateral_m)

    def build_objects(self, tick: int, own: OwnState) -> Objects:
        """Return the tracks that are confirmed or directly ahead as boxes, nearest first."""
        rows = np.flatnonzero(self._history.confirmed | self._find_lead(own))
        states, history, standing = self._states.take(rows), self._history.take(rows), self._find_standing(tick)[rows]
        x, y = np.where(standing, history.mean_x, states.x), np.where(standing, history.mean_y, states.y)
        order = np.argsort(portable.hypot(x - own.x, y - own.y), kind="stable")
        return Objects(
            self._get_names(rows),
            history.kind, x, y, states.yaw, np.where(standing, 0.0, states.speed), states.length, states.width,
        ).take(order)  # fmt: skip


def _find_starts(sources: Sequence[str]) -> Int:
    """Return the first index of each source; sources are sorted."""
    return np.array([i for i, source in enumerate(sources) if not i or source != sources[i - 1]], dtype=np.int64)


def _mask_range(count: int, low: int, high: int) -> Bool:
    mask = np.zeros(count, dtype=np.bool_)
    mask[low:high] = True
    return mask


def is_on_foot(kind: npt.NDArray[np.uint8]) -> Bool:
    """Return a mask (N,): pedestrians and cyclists, which are never taken for other kinds."""
    return (kind == Kind.PEDESTRIAN) | (kind == Kind.CYCLIST)
