"""Multi-object tracking: one list of boxes from own detections, CAMs, MCMs, DENMs and CPMs over time.

Global nearest neighbour: an assignment for each source in every update, within gates; a Kalman filter for each track
(`track_states`). Objects of different sources are matched by position, never by name; names of the own sensor and of
stations are hints. A track begins with an unmatched measurement, is confirmed when it can be no false positive, is
predicted while it is not seen, and ends after a while (`track_list`).

Under `--v2x-rate etsi` stations tell of an object that they have confirmed, and at intervals of up to a second: what
they tell of is believed at once, and kept for longer.
"""

from collections.abc import Iterable, Iterator, Mapping

import numpy as np

from mdrive_sumo.contract import Briefing, Message, Note, Objects, Observation, OwnState
from mdrive_sumo.contract.detector_profiles import PROFILES
from mdrive_sumo.core.state import DT
from mdrive_sumo.perception.measurements import (
    Measurements,
    measure_detections,
    measure_reported,
    measure_stations,
)
from mdrive_sumo.perception.track_list import TrackList
from mdrive_sumo.perception.tracking_parameters import ETSI_TRACKING, TRACKING, TrackingParameters
from mdrive_sumo.v2x.messages import CAM, CPM, DENM, MCM, Cam, Content, Cpm, Denm, Mcm
from mdrive_sumo.v2x.shared_reading import decode_shared, find_shared_problem

NO_OBJECTS = Objects((), np.zeros(0, np.uint8), *(np.zeros(0) for _ in range(6)))
KINDS = (CAM, CPM, MCM, DENM)
"""Types of messages that report positions."""


class ObjectTracker:
    """Tracks what a CAV sees and what it is told. A track is named by its station's id, or by a name of its own."""

    def __init__(self, briefing: Briefing, detector: str, parameters: TrackingParameters | None = None) -> None:
        """detector: profile of the own detections. Stations that do not report their size are assumed to have the own
        one. parameters: by default those of the sending rate of the episode."""
        self._accumulates = briefing.v2x_rate == "etsi"
        """Whether a CPM has a part of what its sender detects."""
        self._parameters = parameters or (ETSI_TRACKING if self._accumulates else TRACKING)
        self._profile, self._size = PROFILES[detector], (briefing.vehicle.length, briefing.vehicle.width)
        exact = not self._profile.false_positives and not PROFILES[briefing.standard_detector].false_positives
        self._tracks = TrackList(exact, self._parameters, believes_reports=self._accumulates)
        self._waiting: dict[tuple[str, str], Message] = {}
        """(type, sender) -> newest message that no update has used yet."""
        self._earlier_cpms: list[Message] = []
        """Other CPMs that no update has used yet, in order, if they accumulate."""
        self._sent_tick: dict[tuple[str, str], int] = {}
        """(type, sender) -> tick at which the newest message was sent, used or not."""
        self._cpm_tick: dict[str, int] = {}
        """Tick of the pose of the last CPM in use by station."""
        self._told_tick: dict[tuple[str, str], int] = {}
        """(station, name there) -> tick of the pose of the last CPM with that object, if they accumulate."""
        self._tick: int | None = None
        self.objects = NO_OBJECTS
        """What the last update returned."""

    def receive(self, messages: Iterable[Message]) -> tuple[Note, ...]:
        """Store messages until the next update; return notes about unreadable ones."""
        notes: list[Note] = []
        for message in messages:
            key = message.type, message.sender
            if message.type not in KINDS or message.tick <= self._sent_tick.get(key, -1):
                continue
            problem = find_shared_problem(message)
            if problem is None:
                if self._accumulates and message.type == CPM and key in self._waiting:
                    self._earlier_cpms.append(self._waiting[key])
                self._waiting[key], self._sent_tick[key] = message, message.tick
            else:
                notes.append(Note("unreadable", f"{message.type} from {message.sender}: {problem}"))
        return tuple(notes)

    def _read_cams(self, ticks: range) -> dict[str, Cam]:
        """Return the newest states of these ticks that stations reported: a CAM, or an MCM or a DENM sent later."""
        senders = sorted({sender for kind, sender in self._waiting if kind != CPM})
        cam_by_sender: dict[str, Cam] = {}
        for sender in senders:
            content = self._read_state(sender)
            if content is not None and content.pose.tick in ticks:
                cam_by_sender[sender] = content
        return cam_by_sender

    def _read_state(self, sender: str) -> Cam | None:
        """Return the newest state of a station that no update has used yet; of one tick a CAM, then an MCM."""
        newest = max((CAM, MCM, DENM), key=lambda kind: self._sent_tick.get((kind, sender), -1))
        for kind in (newest, CAM):
            if (kind, sender) in self._waiting:
                return self._to_cam(decode_shared(self._waiting[kind, sender]))
        return None

    def _to_cam(self, content: Content) -> Cam | None:
        """Return the state of its sender that a message contains."""
        if isinstance(content, Mcm):
            return Cam(content.pose, content.speed, 0.0, 0.0, *self._size)
        if isinstance(content, Denm):
            return Cam(content.pose, content.speed, 0.0, 0.0, content.length, content.width)
        return content if isinstance(content, Cam) else None

    def _read_cpms(self, ticks: range) -> Iterator[dict[str, Cpm]]:
        """Yield the newest CPM of every station that is of these ticks and has objects; earlier ones before, if they
        accumulate, one of each station at a time."""
        newest = [message for (kind, _), message in self._waiting.items() if kind == CPM]
        rounds: list[dict[str, Message]] = []
        for message in (*self._earlier_cpms, *newest):
            place = next((one for one in rounds if message.sender not in one), None)
            if place is None:
                rounds.append(place := {})
            place[message.sender] = message
        for messages in rounds:
            contents = {sender: decode_shared(message) for sender, message in messages.items()}
            yield {
                sender: one
                for sender, one in contents.items()
                if isinstance(one, Cpm) and one.pose.tick in ticks and one.objects.ids
            }

    def update(self, seen: Observation) -> Objects:
        """Return all confirmed objects at the tick of the observation, nearest first, without the own car."""
        assert seen.objects is not None, "the objects sensor is declared"
        tick, correlation_ticks = seen.tick, self._parameters.correlation_ticks
        elapsed_ticks = correlation_ticks if self._tick is None else tick - self._tick
        self._tracks.predict(0.0 if self._tick is None else elapsed_ticks * DT)
        self._tick = tick
        own_detections = measure_detections(seen.objects, seen.own, self._profile, elapsed_ticks, self._parameters)
        self._tracks.add(tick, own_detections)
        for reported in self._measure_messages(tick, seen.own):
            self._tracks.add(tick, reported)
        self._tracks.end_update(tick)
        self.objects = self._tracks.build_objects(tick, seen.own)
        return self.objects

    def drop_source(self, sender: str) -> None:
        """Forget what only that station has reported, as it is not believed any more."""
        self._tracks.drop_source(sender)
        self._waiting = {key: message for key, message in self._waiting.items() if key[1] != sender}
        self._earlier_cpms = [message for message in self._earlier_cpms if message.sender != sender]

    @property
    def position_sigmas(self) -> Mapping[str, float]:
        """Standard deviation [m] of each coordinate of the position by id, of the objects of the last update."""
        return self._tracks.get_position_sigmas()

    @property
    def sources(self) -> Mapping[str, str]:
        """Station that told of an object by id, of those of the last update that the own sensor never saw."""
        return self._tracks.get_sources()

    def _measure_messages(self, tick: int, own: OwnState) -> Iterator[Measurements]:
        """Yield what new messages report; every message is used once."""
        recent = range(tick - self._parameters.memory_ticks, tick + 1)  # a pose of the future is an error of its sender
        if cams := self._read_cams(recent):
            yield measure_stations(tick, sorted(cams.items()), own, self._parameters)
        for cpms in self._read_cpms(recent):
            if cpms:
                reports = [(sender, cpm, self._count_elapsed(sender, cpm)) for sender, cpm in sorted(cpms.items())]
                yield measure_reported(tick, reports, own, self._parameters)
        self._waiting.clear()
        self._earlier_cpms.clear()
        self._told_tick = {name: told for name, told in self._told_tick.items() if told in recent}

    def _count_elapsed(self, sender: str, cpm: Cpm) -> int:
        """Return the ticks since a station's last CPM in use; if they accumulate, since its last one with any of these
        objects. Of a new one as many as errors are correlated for."""
        tick, unknown = cpm.pose.tick, cpm.pose.tick - self._parameters.correlation_ticks
        if not self._accumulates:
            before = self._cpm_tick.get(sender, unknown)
            self._cpm_tick[sender] = tick
            return tick - before
        before = max(self._told_tick.get((sender, name), unknown) for name in cpm.objects.ids)
        self._told_tick |= dict.fromkeys(((sender, name) for name in cpm.objects.ids), tick)
        return tick - before
