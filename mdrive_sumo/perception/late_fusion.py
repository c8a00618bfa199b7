"""Late fusion: one list of boxes from own detections and from what other stations detect and report of themselves.

Track-level association by position and kind, greedily from the nearest pair; received objects are advanced by their
age; the own measurement is preferred where there is one.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from mdrive_sumo.contract import Message, Note, Objects, OwnState, VehicleFacts
from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Bool
from mdrive_sumo.core.state import DT, TICKS_PER_SECOND, Kind
from mdrive_sumo.v2x.messages import Cam, Cpm, Mcm, MessageError
from mdrive_sumo.v2x.shared_reading import decode_shared


@dataclass(frozen=True, slots=True)
class FusionParameters:
    """Parameters of `LateFusion`."""

    memory_ticks: int = TICKS_PER_SECOND
    """Older messages are dropped."""
    vehicle_gate_m: float = 2.5
    """Nearer detections are one vehicle. Centres of two vehicles are never nearer unless side by side.
    Three standard deviations of the paper's pose error (0.6 m) exceed it: one vehicle then counts twice."""
    pedestrian_gate_m: float = 1.0
    """The same distance [m] for pedestrians and cyclists."""


@dataclass(frozen=True, slots=True)
class FusionLimits:
    """The senders whose detections are fused: at most `max_senders`, the nearest ones, within `max_distance_m`."""

    max_senders: int
    max_distance_m: float


OPV2V_LIMITS = FusionLimits(max_senders=4, max_distance_m=70.0)
"""The setting of OPV2V, in which the paper's cooperative detectors were published."""
FUSION = FusionParameters()
ETSI_FUSION = replace(FUSION, memory_ticks=2 * TICKS_PER_SECOND + TICKS_PER_SECOND // 4)
"""Under `--v2x-rate etsi` stations tell of an object once a second at least, and one of these messages may be lost."""


class LateFusion:
    """Keeps the latest messages and fuses them with own detections.

    Names: a station is named by its id, every other object by the track name of the first station that reported it. An
    object keeps its name when another station reports it.
    """

    def __init__(
        self,
        vehicle: VehicleFacts,
        limits: FusionLimits | None = None,
        parameters: FusionParameters = FUSION,
        accumulates: bool = False,
    ) -> None:
        """vehicle: the own one; stations that report their position but not their size are assumed to have its size.
        accumulates: whether a CPM has a part of what its sender detects (`--v2x-rate etsi`), so that those before it
        count as well."""
        self._accumulates = accumulates
        self._size, self._limits, self._parameters = (vehicle.length, vehicle.width), limits, parameters
        self._cam_by_station: dict[str, tuple[int, Cam]] = {}
        self._cpm_by_station: dict[str, tuple[int, Cpm]] = {}
        self._name_by_alias: dict[str, str] = {}
        self._listed: set[str] = set()

    def receive(self, messages: Iterable[Message]) -> tuple[Note, ...]:
        """Store messages; return notes about unreadable ones."""
        notes: list[Note] = []
        for message in messages:
            try:
                content = decode_shared(message)
            except MessageError as error:
                notes.append(Note("unreadable", f"{message.type} from {message.sender}: {error}"))
                continue
            if isinstance(content, Cam | Mcm | Cpm):
                self._store(message.sender, content)
        return tuple(notes)

    def _store(self, sender: str, content: Cam | Mcm | Cpm) -> None:
        """Store a message unless a newer one is known; a CAM replaces an MCM of the same tick."""
        tick = content.pose.tick
        last_tick = self._cam_by_station[sender][0] if sender in self._cam_by_station else -1
        if isinstance(content, Cpm):
            before = self._cpm_by_station.get(sender)
            if before is None or tick >= before[0]:
                if before is not None and self._accumulates:
                    content = _add_earlier(content, before[1], self._parameters.memory_ticks)
                self._cpm_by_station[sender] = tick, content
        elif isinstance(content, Cam):
            if tick >= last_tick:
                self._cam_by_station[sender] = tick, content
        elif tick > last_tick:
            self._cam_by_station[sender] = tick, Cam(content.pose, content.speed, 0.0, 0.0, *self._size)

    def fuse(self, tick: int, own: OwnState, seen: Objects) -> Objects:
        """Return all objects known at that tick (N,): own detections first, then stations, then their detections."""
        recent = range(tick - self._parameters.memory_ticks, tick + 1)  # a pose of the future is an error of its sender
        self._cam_by_station = {name: entry for name, entry in self._cam_by_station.items() if entry[0] in recent}
        self._cpm_by_station = {name: entry for name, entry in self._cpm_by_station.items() if entry[0] in recent}
        known = seen
        if self._cam_by_station:
            known = self._merge(known, _predict_stations(tick, self._cam_by_station), own)
        for sender in self._select_senders(own):
            known = self._merge(known, _predict_reported(tick, sender, self._cpm_by_station[sender][1]), own)
        self._listed.update(known.ids)
        return _rename(known, self._name_by_alias)

    def _select_senders(self, own: OwnState) -> list[str]:
        """Return the stations whose detections are fused, sorted."""
        if self._limits is None:
            return sorted(self._cpm_by_station)
        poses = {name: cpm.pose for name, (_, cpm) in self._cpm_by_station.items()}
        gaps = {name: portable.hypot(pose.x - own.x, pose.y - own.y) for name, pose in poses.items()}
        near = sorted((gap, name) for name, gap in gaps.items() if gap <= self._limits.max_distance_m)
        return sorted(name for _, name in near[: self._limits.max_senders])

    def _merge(self, known: Objects, reported: Objects, own: OwnState) -> Objects:
        """Return known objects and those reported ones, with a size, that are neither known nor the own vehicle."""
        is_far = portable.hypot(reported.x - own.x, reported.y - own.y) > self._parameters.vehicle_gate_m
        reported = reported.take(is_far & (reported.length > 0.0) & (reported.width > 0.0))
        pairs = _associate(known, reported, self._parameters)
        for i, j in pairs:
            self._unify_names(known.ids[i], reported.ids[j])
        is_new = np.ones(len(reported.ids), dtype=np.bool_)
        is_new[[j for _, j in pairs]] = False
        return known.concat(reported.take(is_new))

    def _unify_names(self, known: str, reported: str) -> None:
        """Give two names of one object a common one: the station's id, or the older of the two."""
        if reported in self._cam_by_station:
            self._name_by_alias = {alias: name for alias, name in self._name_by_alias.items() if name != reported}
            self._name_by_alias[known] = reported
        elif reported in self._listed and known not in self._listed:
            self._name_by_alias[known] = self._name_by_alias.get(reported, reported)
        else:
            self._name_by_alias.setdefault(reported, self._name_by_alias.get(known, known))


def _predict_stations(tick: int, cam_by_station: dict[str, tuple[int, Cam]]) -> Objects:
    """Return the senders of CAMs, advanced to that tick."""
    names = sorted(cam_by_station)
    cams = [cam_by_station[name][1] for name in names]
    rows = [(cam.pose.x, cam.pose.y, cam.pose.yaw, cam.speed, cam.length, cam.width) for cam in cams]
    ages = np.array([(tick - cam.pose.tick) * DT for cam in cams])
    turn = np.array([cam.yaw_rate for cam in cams]) * ages
    return Objects(tuple(names), np.zeros(len(names), dtype=np.uint8), *np.array(rows).T).advance(ages, turn)


def _predict_reported(tick: int, sender: str, cpm: Cpm) -> Objects:
    """Return the objects that a sender detected, advanced to that tick."""
    ages = (tick - cpm.pose.tick + cpm.age.astype(np.float64)) * DT
    names = tuple(f"{sender}:{name}" for name in cpm.objects.ids)
    return replace(cpm.objects, ids=names).advance(ages)


def _add_earlier(cpm: Cpm, before: Cpm, memory_ticks: int) -> Cpm:
    """Return a CPM with the objects of an earlier one that it does not have, as much older; without those too old."""
    elapsed_ticks = cpm.pose.tick - before.pose.tick
    ages = before.age.astype(np.int64) + elapsed_ticks
    is_kept = np.array([name not in cpm.objects.ids for name in before.objects.ids], dtype=np.bool_)
    is_kept &= ages <= memory_ticks
    objects = cpm.objects.concat(before.objects.take(is_kept))
    ages = np.concatenate((cpm.age, ages[is_kept].astype(np.uint8)))
    sigmas = [one.sigmas if len(one.sigmas) else np.zeros((len(one.objects.ids), 3)) for one in (cpm, before)]
    return replace(cpm, objects=objects, age=ages, sigmas=np.vstack((sigmas[0], sigmas[1][is_kept])))


def _associate(known: Objects, reported: Objects, parameters: FusionParameters) -> list[tuple[int, int]]:
    """Return pairs (known row, reported row) of the same object: nearest pair first, every object at most once."""
    gaps = portable.hypot(known.x[:, None] - reported.x[None], known.y[:, None] - reported.y[None])
    on_foot = _find_pedestrians(known)[:, None]
    gates = np.where(on_foot, parameters.pedestrian_gate_m, parameters.vehicle_gate_m)
    possible = (gaps <= gates) & (on_foot == _find_pedestrians(reported)[None])
    rows, columns = np.nonzero(possible)
    order = np.argsort(gaps[rows, columns], kind="stable")
    used_rows: set[int] = set()
    used_columns: set[int] = set()
    pairs: list[tuple[int, int]] = []
    for row, column in zip(rows[order].tolist(), columns[order].tolist(), strict=True):
        if row not in used_rows and column not in used_columns:
            used_rows.add(row)
            used_columns.add(column)
            pairs.append((row, column))
    return pairs


def _find_pedestrians(objects: Objects) -> Bool:
    """Return a mask (N,): pedestrians and cyclists."""
    return (objects.kind == Kind.PEDESTRIAN) | (objects.kind == Kind.CYCLIST)


def _rename(objects: Objects, name_by_alias: dict[str, str]) -> Objects:
    """Return the objects under their common names; where another row has that name, an object keeps its own."""
    taken = set(objects.ids)
    ids: list[str] = []
    for alias in objects.ids:
        name = name_by_alias.get(alias, alias)
        ids.append(alias if name in taken else name)
        taken.add(ids[-1])
    return replace(objects, ids=tuple(ids))
