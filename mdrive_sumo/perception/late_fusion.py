"""Late fusion: one list of boxes from what I see and what others say they see and are.

Track-level association by place and kind, greedily from the nearest pair; what is told is moved on by its age; my own
measurement counts where I have one.
"""

import math
from collections.abc import Iterable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from mdrive_sumo.contract import Message, Note, Objects, OwnState, VehicleFacts
from mdrive_sumo.core.geometry import Bool
from mdrive_sumo.core.state import DT, TICKS_PER_SECOND, Kind
from mdrive_sumo.v2x.messages import Cam, Cpm, Mcm, MessageError, decode

MEMORY_TICKS = TICKS_PER_SECOND
"""What is older is forgotten."""
CAR_GATE_M = 2.5
"""Two cars are never nearer than this with their centres unless one is beside the other; three sigmas of the paper's
pose error (0.6 m) would be more, and then one car counts twice."""
WALKER_GATE_M = 1.0


class FusionLimits(NamedTuple):
    """Whose detections are fused: so many of the nearest at most, no farther away than that [m]."""

    max_senders: int
    max_distance_m: float


class LateFusion:
    """What is known of the surroundings, kept from tick to tick.

    Names: a station is called by its id, everything else by the track name of whoever saw it first; the same thing
    keeps its name when another one sees it.
    """

    def __init__(self, vehicle: VehicleFacts, reach: FusionLimits | None = None) -> None:
        """vehicle: the own one; others that tell their place but not their size are taken to be like it."""
        self._size, self._reach = (vehicle.length, vehicle.width), reach
        self._cams: dict[str, tuple[int, Cam]] = {}
        self._cpms: dict[str, tuple[int, Cpm]] = {}
        self._names: dict[str, str] = {}
        self._listed: set[str] = set()

    def receive(self, messages: Iterable[Message]) -> tuple[Note, ...]:
        """Takes notice of what arrived; notes what could not be read."""
        notes: list[Note] = []
        for message in messages:
            try:
                content = decode(message)
            except MessageError as error:
                notes.append(Note("unreadable", f"{message.type} from {message.sender}: {error}"))
                continue
            if isinstance(content, Cam) and content.pose.tick >= self._last(message.sender):
                self._cams[message.sender] = content.pose.tick, content
            elif isinstance(content, Cpm) and content.pose.tick >= self._cpms.get(message.sender, (-1,))[0]:
                self._cpms[message.sender] = content.pose.tick, content
            elif isinstance(content, Mcm) and content.pose.tick > self._last(message.sender):
                self._cams[message.sender] = content.pose.tick, Cam(content.pose, content.speed, 0.0, 0.0, *self._size)
        return tuple(notes)

    def _last(self, station: str) -> int:
        """When a station told its place last."""
        return self._cams[station][0] if station in self._cams else -1

    def fuse(self, tick: int, own: OwnState, seen: Objects) -> Objects:
        """Everything that I or others know of now (N,): what I see first, then stations, then what they see."""
        self._cams = {name: said for name, said in self._cams.items() if tick - said[0] <= MEMORY_TICKS}
        self._cpms = {name: said for name, said in self._cpms.items() if tick - said[0] <= MEMORY_TICKS}
        known = seen
        if self._cams:
            known = self._joined(known, _stations(tick, self._cams), own)
        for sender in self._senders(own):
            known = self._joined(known, _told(tick, sender, self._cpms[sender][1]), own)
        self._listed.update(known.ids)
        return _renamed(known, self._names)

    def _senders(self, own: OwnState) -> list[str]:
        """Whose detections count now, sorted."""
        if self._reach is None:
            return sorted(self._cpms)
        gaps = {name: math.hypot(c.pose.x - own.x, c.pose.y - own.y) for name, (_, c) in self._cpms.items()}
        near = sorted((gap, name) for name, gap in gaps.items() if gap <= self._reach.max_distance_m)
        return sorted(name for _, name in near[: self._reach.max_senders])

    def _joined(self, known: Objects, told: Objects, own: OwnState) -> Objects:
        """Known and told things together; what is me, or the same thing, is not added again."""
        told = told.take(np.hypot(told.x - own.x, told.y - own.y) > CAR_GATE_M)
        pairs = _matched(known, told)
        for mine, theirs in pairs:
            self._call_same(known.ids[mine], told.ids[theirs])
        new = np.ones(len(told.ids), dtype=np.bool_)
        new[[theirs for _, theirs in pairs]] = False
        return known.concat(told.take(new))

    def _call_same(self, mine: str, theirs: str) -> None:
        """Gives two names of one thing one meaning: the station's id, or the older of the two."""
        if theirs in self._cams:
            self._names = {name: common for name, common in self._names.items() if common != theirs}
            self._names[mine] = theirs
        elif theirs in self._listed and mine not in self._listed:
            self._names[mine] = self._names.get(theirs, theirs)
        else:
            self._names.setdefault(theirs, self._names.get(mine, mine))


def _stations(tick: int, cams: dict[str, tuple[int, Cam]]) -> Objects:
    """The senders of CAMs where they should be now."""
    names = sorted(cams)
    said = [cams[name][1] for name in names]
    rows = [(c.pose.x, c.pose.y, c.pose.yaw, c.speed, c.length, c.width) for c in said]
    ages = np.array([(tick - c.pose.tick) * DT for c in said])
    turn = np.array([c.yaw_rate for c in said]) * ages
    return Objects(tuple(names), np.zeros(len(names), dtype=np.uint8), *np.array(rows).T).advance(ages, turn)


def _told(tick: int, sender: str, cpm: Cpm) -> Objects:
    """What a sender sees where it should be now."""
    objects = cpm.objects
    ages = (tick - cpm.pose.tick + cpm.age.astype(np.float64)) * DT
    names = tuple(f"{sender}:{name}" for name in objects.ids)
    return replace(objects, ids=names).advance(ages)


def _matched(known: Objects, told: Objects) -> list[tuple[int, int]]:
    """Pairs (known, told) of the same thing: the nearest pair first, everything at most once."""
    gaps = np.hypot(known.x[:, None] - told.x[None], known.y[:, None] - told.y[None])
    walkers = _walks(known)[:, None]
    allowed = np.where(walkers, WALKER_GATE_M, CAR_GATE_M)
    possible = (gaps <= allowed) & (walkers == _walks(told)[None])
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


def _walks(objects: Objects) -> Bool:
    return (objects.kind == Kind.PEDESTRIAN) | (objects.kind == Kind.CYCLIST)


def _renamed(objects: Objects, names: dict[str, str]) -> Objects:
    """The same under common names; who would take another row's name keeps its own: they are two things now."""
    taken = set(objects.ids)
    ids: list[str] = []
    for name in objects.ids:
        common = names.get(name, name)
        ids.append(name if common in taken else common)
        taken.add(ids[-1])
    return replace(objects, ids=tuple(ids))
