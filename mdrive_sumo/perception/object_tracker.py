"""Multi-object tracking: one list of boxes from own detections, CAMs, MCMs and CPMs over time.

Global nearest neighbour: an assignment for each source in every update, within gates; a Kalman filter for each track
(`track_states`). Objects of different sources are matched by position, never by name; names of the own sensor and of
stations are hints. A track begins with an unmatched measurement, is confirmed when it can be no false positive, is
predicted while it is not seen, and ends after a while (`track_list`).
"""

from collections.abc import Iterable, Iterator, Mapping

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
from mdrive_sumo.perception.tracking_parameters import TRACKING, TrackingParameters
from mdrive_sumo.v2x.messages import CAM, CPM, MCM, Cam, Cpm, Mcm
from mdrive_sumo.v2x.shared_reading import decode_shared, find_shared_problem

KINDS = (CAM, CPM, MCM)
"""Types of messages that report positions."""


class ObjectTracker:
    """Tracks what a CAV sees and what it is told. A track is named by its station's id, or by a name of its own."""

    def __init__(self, briefing: Briefing, detector: str, parameters: TrackingParameters = TRACKING) -> None:
        """detector: profile of the own detections. Stations that do not report their size are assumed to have the own
        one."""
        self._profile, self._parameters = PROFILES[detector], parameters
        self._size = briefing.vehicle.length, briefing.vehicle.width
        exact = not self._profile.false_positives and not PROFILES[briefing.standard_detector].false_positives
        self._tracks = TrackList(exact, parameters)
        self._waiting: dict[tuple[str, str], Message] = {}
        """(type, sender) -> newest message that no update has used yet."""
        self._sent_tick: dict[tuple[str, str], int] = {}
        """(type, sender) -> tick at which the newest message was sent, used or not."""
        self._cpm_tick: dict[str, int] = {}
        """Tick of the pose of the last CPM in use by station."""
        self._tick: int | None = None

    def receive(self, messages: Iterable[Message]) -> tuple[Note, ...]:
        """Store messages until the next update; return notes about unreadable ones."""
        notes: list[Note] = []
        for message in messages:
            key = message.type, message.sender
            if message.type not in KINDS or message.tick <= self._sent_tick.get(key, -1):
                continue
            problem = find_shared_problem(message)
            if problem is None:
                self._waiting[key], self._sent_tick[key] = message, message.tick
            else:
                notes.append(Note("unreadable", f"{message.type} from {message.sender}: {problem}"))
        return tuple(notes)

    def _read_cams(self, ticks: range) -> dict[str, Cam]:
        """Return the newest states of these ticks that stations reported: a CAM, or an MCM sent later."""
        senders = sorted({sender for kind, sender in self._waiting if kind != CPM})
        cam_by_sender: dict[str, Cam] = {}
        for sender in senders:
            is_mcm_newer = self._sent_tick.get((MCM, sender), -1) > self._sent_tick.get((CAM, sender), -1)
            content = decode_shared(self._waiting[MCM, sender]) if is_mcm_newer else None
            if content is None and (CAM, sender) in self._waiting:
                content = decode_shared(self._waiting[CAM, sender])
            if isinstance(content, Mcm):
                content = Cam(content.pose, content.speed, 0.0, 0.0, *self._size)
            if isinstance(content, Cam) and content.pose.tick in ticks:
                cam_by_sender[sender] = content
        return cam_by_sender

    def _read_cpms(self, ticks: range) -> dict[str, Cpm]:
        """Return the newest CPM of every station that is of these ticks and has objects."""
        contents = {sender: decode_shared(message) for (kind, sender), message in self._waiting.items() if kind == CPM}
        return {
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
        return self._tracks.build_objects(tick, seen.own)

    @property
    def position_sigmas(self) -> Mapping[str, float]:
        """Standard deviation [m] of each coordinate of the position by id, of the objects of the last update."""
        return self._tracks.get_position_sigmas()

    def _measure_messages(self, tick: int, own: OwnState) -> Iterator[Measurements]:
        """Yield what new messages report; every message is used once."""
        recent = range(tick - self._parameters.memory_ticks, tick + 1)  # a pose of the future is an error of its sender
        if cams := self._read_cams(recent):
            yield measure_stations(tick, sorted(cams.items()), own, self._parameters)
        if cpms := self._read_cpms(recent):
            unknown = -self._parameters.correlation_ticks
            reports: list[tuple[str, Cpm, int]] = []
            for sender, cpm in sorted(cpms.items()):
                sent_tick = cpm.pose.tick
                reports.append((sender, cpm, sent_tick - self._cpm_tick.get(sender, sent_tick + unknown)))
                self._cpm_tick[sender] = sent_tick
            yield measure_reported(tick, reports, own, self._parameters)
        self._waiting.clear()
