"""The tracks of an `ObjectTracker`: association, births, confirmation, standstill and deletion."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from mdrive_sumo.contract import Objects, OwnState
from mdrive_sumo.core import portable
from mdrive_sumo.core.compiled import twin
from mdrive_sumo.core.geometry import Bool, Float, Int, wrap_angles
from mdrive_sumo.core.state import Kind
from mdrive_sumo.perception.assignment import assign
from mdrive_sumo.perception.measurements import OWN_SENSOR, STATIONS, Measurements, Rows
from mdrive_sumo.perception.track_states import TRACK, compute_speeds, correct, predict, start_tracks
from mdrive_sumo.perception.tracking_parameters import TrackingParameters


@dataclass(slots=True)
class TrackOrigins:
    """What the tracks are called, by their sources."""

    number_by_name: dict[tuple[str, str], int] = field(default_factory=dict)
    """(source, name there) -> number of the track that this name had last."""
    station_by_number: dict[int, str] = field(default_factory=dict)
    """Number -> id of the station that the track is."""
    source_by_number: dict[int, str] = field(default_factory=dict)
    """Number -> where the track was born."""

    def forget(self, alive: set[int]) -> None:
        """Forget the tracks that are not alive."""
        self.number_by_name = {name: number for name, number in self.number_by_name.items() if number in alive}
        self.station_by_number = {number: name for number, name in self.station_by_number.items() if number in alive}
        self.source_by_number = {number: name for number, name in self.source_by_number.items() if number in alive}


class TrackList:
    """All tracks of one CAV."""

    def __init__(
        self, is_confirmed_at_once: bool, parameters: TrackingParameters, believes_reports: bool = False
    ) -> None:
        """is_confirmed_at_once: whether the detectors in use have no false positives. believes_reports: whether what a
        station tells of is no false positive, because it has confirmed that itself."""
        self._is_confirmed_at_once, self._believes_reports = is_confirmed_at_once, believes_reports
        self._parameters = parameters
        self._tracks = np.zeros(0, TRACK)
        self._names = TrackOrigins()
        self._next_number = 0

    def __len__(self) -> int:
        return len(self._tracks)

    def predict(self, seconds: float) -> None:
        """Advance all tracks; begins an update."""
        self._tracks = predict(self._tracks, seconds, self._parameters)

    def add(self, tick: int, new: Measurements) -> None:
        """Correct tracks by measurements, and begin tracks for those that fit to none."""
        if not new.names:
            return
        self._tracks, columns = match_measurements(self._tracks, new, tick, self._names, self._parameters)
        if len(columns) < len(new.names):
            self._begin_tracks(tick, _exclude(new, columns))

    def _begin_tracks(self, tick: int, new: Measurements) -> None:
        """Begin tracks, one source after the other: what two of them measured is one object."""
        first_new_number = self._next_number
        for source in np.unique(new.rows["source"]).tolist():
            part = new.take(new.rows["source"] == source)
            if self._next_number > first_new_number:
                cost, possible = compare(self._tracks, part, self._names.number_by_name, self._parameters)
                possible &= (self._tracks["number"] >= first_new_number)[:, None]
                rows, columns = assign(cost, possible, part.rows["source"])
                self._tracks = record_hits(self._tracks, rows, part, columns, tick, self._names, self._parameters)
                part = _exclude(part, columns)
            self._append(tick, part)

    def _append(self, tick: int, new: Measurements) -> None:
        """Begin a track for every measurement."""
        is_believed = new.sources[0] == STATIONS or (self._believes_reports and new.sources[0] != OWN_SENSOR)
        is_confirmed = self._is_confirmed_at_once or tick < self._parameters.warm_ticks or is_believed
        self._tracks = start_tracks(self._tracks, tick, self._next_number, new, is_confirmed, self._parameters)
        for source, name in zip(new.rows["source"].tolist(), new.names, strict=True):
            self._names.source_by_number[self._next_number] = new.sources[source]
            _name_track(self._tracks, self._names, self._next_number, new.sources[source], name, self._parameters)
            self._next_number += 1

    def end_update(self, tick: int) -> None:
        """Update means of standing tracks and drop tracks that were not seen for long."""
        count = len(self._tracks)
        self._tracks = end_update(self._tracks, tick, self._parameters)
        if len(self._tracks) < count:
            self._names.forget(set(self._tracks["number"].tolist()))

    def drop_source(self, source: str) -> None:
        """Drop the tracks that began with reports of a station, or are the station, and that no own sensor has seen."""
        names = self._names
        told = {number for number, one in names.source_by_number.items() if one == source}
        told |= {number for number, one in names.station_by_number.items() if one == source}
        is_told = np.array([number in told for number in self._tracks["number"].tolist()], dtype=np.bool_)
        self._tracks = self._tracks[~is_told | (self._tracks["seen_by_sensor"] != 0)]
        names.forget(set(self._tracks["number"].tolist()))

    def get_position_sigmas(self) -> Mapping[str, float]:
        """Return the standard deviation [m] of each coordinate of the position by the id of the track."""
        names = _list_names(self._tracks, self._names.station_by_number)
        return dict(zip(names, np.sqrt(self._tracks["position"]).tolist(), strict=True))

    def get_sources(self) -> Mapping[str, str]:
        """Return the station that began a track by the id of the track, for those that the own sensor never saw."""
        names = _list_names(self._tracks, self._names.station_by_number)
        numbers, seen = self._tracks["number"].tolist(), self._tracks["seen_by_sensor"].tolist()
        return {
            name: self._names.source_by_number[number]
            for name, number, is_seen in zip(names, numbers, seen, strict=True)
            if not is_seen
        }

    def build_objects(self, tick: int, own: OwnState) -> Objects:
        """Return the tracks that are confirmed or directly ahead as boxes, nearest first."""
        return list_objects(self._tracks, self._names.station_by_number, tick, own, self._parameters)


@twin
def compare(
    tracks: Rows, new: Measurements, number_by_name: Mapping[tuple[str, str], int], parameters: TrackingParameters, /
) -> tuple[Float, Bool]:
    """Return costs and possible pairs (N, M) of tracks and measurements."""
    track, rows = tracks[:, None], new.rows
    square = portable.square(track["x"] - rows["x"]) + portable.square(track["y"] - rows["y"])
    distance = square / (track["position"] + (rows["position"] + rows["bias"]))
    names = zip([new.sources[source] for source in rows["source"].tolist()], new.names, strict=True)
    is_known = track["number"] == np.array([number_by_name.get(name, -1) for name in names], dtype=np.int64)
    possible = distance <= np.where(is_known, parameters.known_name_gate, parameters.gate)
    possible |= square <= portable.square(parameters.min_gate_widths * rows["width"])
    possible &= _is_on_foot(track) == _is_on_foot(rows)
    cost = distance - parameters.known_name_bonus * is_known
    if new.sources[0] != OWN_SENSOR:
        cost -= parameters.known_name_bonus * track["seen_by_sensor"]
    return cost, possible


def _is_on_foot(rows: Rows) -> Bool:
    """Return a mask (N,): pedestrians and cyclists, which are never taken for other kinds."""
    return (rows["kind"] == Kind.PEDESTRIAN) | (rows["kind"] == Kind.CYCLIST)


@twin
def record_hits(
    tracks: Rows, rows: Int, new: Measurements, columns: Int, tick: int, names: TrackOrigins,
    parameters: TrackingParameters, /,
) -> Rows:  # fmt: skip
    """Return the tracks, those of `rows` (K,) seen now, as the measurements `columns` (K,); updates the names.

    Those that can be no false positives are confirmed.
    """
    seen = tracks.copy()
    seen["seen_tick"][rows] = tick
    seen["seen_by_sensor"][rows] |= new.sources[0] == OWN_SENSOR
    speed = portable.hypot(tracks["vx"][rows], tracks["vy"][rows])
    is_old = tick - tracks["born_tick"][rows] >= parameters.confirmation_ticks
    seen["confirmed"][rows] |= is_old | (speed > parameters.moving_speed)
    numbers, sources = tracks["number"][rows].tolist(), new.rows["source"][columns].tolist()
    for row, column, number, source in zip(rows.tolist(), columns.tolist(), numbers, sources, strict=True):
        seen["confirmed"][row] |= names.source_by_number[number] != new.sources[source]
        _name_track(seen, names, number, new.sources[source], new.names[column], parameters)
    return seen


def _name_track(
    tracks: Rows, names: TrackOrigins, number: int, source: str, name: str, parameters: TrackingParameters
) -> None:
    """Remember one name. A station names its track; a track that had this name before was the same vehicle."""
    before = names.number_by_name.get((source, name))
    names.number_by_name[source, name] = number
    if source == STATIONS:
        names.station_by_number[number] = name
        if before is not None and before != number:
            names.station_by_number.pop(before, None)
            tracks["seen_tick"][tracks["number"] == before] = -parameters.never_ticks


@twin
def match_measurements(
    tracks: Rows, new: Measurements, tick: int, names: TrackOrigins, parameters: TrackingParameters, /
) -> tuple[Rows, Int]:
    """Return the tracks, corrected by the measurements that fit to them, and the columns (K,) of those.

    Updates the names.
    """
    cost, possible = compare(tracks, new, names.number_by_name, parameters)
    rows, columns = assign(cost, possible, new.rows["source"])
    tracks = correct(tracks, rows, new.rows, columns, parameters)
    return record_hits(tracks, rows, new, columns, tick, names, parameters), columns


@twin
def end_update(tracks: Rows, tick: int, parameters: TrackingParameters, /) -> Rows:
    """Return the tracks with their means updated, without those that were not seen for long."""
    tracks = tracks.copy()
    _update_means(tracks, tick, parameters)
    is_standing = _find_standing(tracks, tick, parameters)
    believed = np.where(is_standing, parameters.standing_coasting_ticks, parameters.coasting_ticks)
    limit = np.where(tracks["confirmed"], believed, parameters.tentative_ticks)
    return tracks[tick - tracks["seen_tick"] <= limit]


def _update_means(tracks: Rows, tick: int, parameters: TrackingParameters) -> None:
    radius = parameters.standstill_sigmas * np.sqrt(tracks["position"]) + parameters.standstill_m
    has_left = portable.hypot(tracks["x"] - tracks["mean_x"], tracks["y"] - tracks["mean_y"]) > radius
    is_seen = tracks["seen_tick"] == tick
    count = np.where(has_left, 1, np.minimum(tracks["mean_count"] + is_seen, parameters.standstill_count))
    share = np.where(has_left, 1.0, is_seen / count)
    for name in ("x", "y", "vx", "vy"):
        tracks[f"mean_{name}"] += share * (tracks[name] - tracks[f"mean_{name}"])
    tracks["mean_count"] = count
    tracks["mean_tick"] = np.where(has_left, tick, tracks["mean_tick"])


def _find_standing(tracks: Rows, tick: int, parameters: TrackingParameters) -> Bool:
    """Return a mask (N,): tracks that have stayed at one place for a while.

    Their speed is about 0 now, and in the mean over that time: the single speed of a vehicle at walking pace is
    hardly different from 0, its mean is.
    """
    age = tick - tracks["mean_tick"]
    count = np.clip(age / parameters.correlation_ticks, 1.0, parameters.standstill_speeds)
    sigma = parameters.standstill_speed_sigmas * np.sqrt(tracks["velocity"])
    is_slow = portable.hypot(tracks["vx"], tracks["vy"]) <= sigma + parameters.speed_floor
    mean_speed = portable.hypot(tracks["mean_vx"], tracks["mean_vy"])
    is_slow &= mean_speed <= sigma / np.sqrt(count) + parameters.speed_floor
    return is_slow & (age >= parameters.standstill_ticks)


@twin
def list_objects(
    tracks: Rows, station_by_number: Mapping[int, str], tick: int, own: OwnState, parameters: TrackingParameters, /
) -> Objects:
    """Return the tracks that are confirmed or directly ahead as boxes, nearest first."""
    shown = tracks[(tracks["confirmed"] != 0) | _find_lead(tracks, own, parameters)]
    is_standing = _find_standing(shown, tick, parameters)
    shown["x"] = np.where(is_standing, shown["mean_x"], shown["x"])
    shown["y"] = np.where(is_standing, shown["mean_y"], shown["y"])
    speed = np.where(is_standing, 0.0, compute_speeds(shown))
    order = np.argsort(portable.hypot(shown["x"] - own.x, shown["y"] - own.y), kind="stable")
    shown = shown[order]
    x, y, yaw, length, width = (shown[name].copy() for name in ("x", "y", "yaw", "length", "width"))
    ids = _list_names(shown, station_by_number)
    return Objects(ids, shown["kind"].astype(np.uint8), x, y, yaw, speed[order], length, width)


def _list_names(tracks: Rows, station_by_number: Mapping[int, str]) -> tuple[str, ...]:
    """Return the ids of tracks: of their stations, or of their own."""
    return tuple([station_by_number.get(number, f"k{number}") for number in tracks["number"].tolist()])


def _find_lead(tracks: Rows, own: OwnState, parameters: TrackingParameters) -> Bool:
    """Return a mask (N,): vehicles shortly ahead in the own direction."""
    cos, sin = portable.cos_sin(own.yaw)
    dx, dy = tracks["x"] - own.x, tracks["y"] - own.y
    ahead, aside = dx * cos + dy * sin, dy * cos - dx * sin
    is_along = np.abs(wrap_angles(tracks["yaw"] - own.yaw)) < parameters.lead_yaw
    is_near = (ahead > 0) & (ahead < parameters.lead_m) & (np.abs(aside) < parameters.lead_lateral_m)
    return (tracks["kind"] == Kind.VEHICLE) & is_along & is_near


def _exclude(new: Measurements, columns: Int) -> Measurements:
    """Return the measurements without those of `columns`."""
    others = np.ones(len(new.names), dtype=np.bool_)
    others[columns] = False
    return new.take(others)
