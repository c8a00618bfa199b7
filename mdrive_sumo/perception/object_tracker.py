"""Multi-object tracking: one list of boxes from own detections, CAMs, MCMs and CPMs over time.

Global nearest neighbour: one assignment for each source in an update, within gates; a Kalman filter for each track
(`track_states`). Objects of different sources are matched by position, never by name; names of the own sensor and of
stations are hints. A track begins with an unmatched measurement, is confirmed when it can be no false positive, is
predicted while it is not seen, and ends after a while (`track_list`).
"""

from collections.abc import Iterable, Iterator

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
from mdrive_sumo.v2x.messages import Cam, Cpm, Mcm, MessageError, decode


class ObjectTracker:
    """Tracks what a CAV sees and what it is told. A track is named by its station's id, or by a name of its own."""

    def __init__(self, briefing: Briefing, detector: str, parameters: TrackingParameters = TRACKING) -> None:
        """detector: profile of the own detections. Stations that do not report their size are assumed to have the own
        one."""
        self._profile, self._parameters = PROFILES[detector], parameters
        self._size = briefing.vehicle.length, briefing.vehicle.width
        exact = not self._profile.false_positives and not PROFILES[briefing.standard_detector].false_positives
        self._tracks = TrackList(exact, parameters)
        self._cam_by_station: dict[str, Cam] = {}
        """Messages that no update has used yet."""
        self._cpm_by_station: dict[str, Cpm] = {}
        self._cam_tick: dict[str, int] = {}
        """Tick of the pose of the last message by station, used or not."""
        self._cpm_tick: dict[str, int] = {}
        self._cpm_used_tick: dict[str, int] = {}
        self._tick: int | None = None

    def receive(self, messages: Iterable[Message]) -> tuple[Note, ...]:
        """Store messages until the next update; return notes about unreadable ones."""
        notes: list[Note] = []
        for message in messages:
            try:
                content = decode(message)
            except MessageError as error:
                notes.append(Note("unreadable", f"{message.type} from {message.sender}: {error}"))
                continue
            if isinstance(content, Cam | Mcm | Cpm):
                self._store(message.sender, content)
        return tuple(notes)

    def _store(self, sender: str, content: Cam | Mcm | Cpm) -> None:
        """Store a message unless a newer one is known; a CAM replaces an MCM of the same tick."""
        tick = content.pose.tick
        if isinstance(content, Cpm):
            if tick > self._cpm_tick.get(sender, -1):
                self._cpm_by_station[sender], self._cpm_tick[sender] = content, tick
            return
        last_tick = self._cam_tick.get(sender, -1)
        if isinstance(content, Mcm):
            content = Cam(content.pose, content.speed, 0.0, 0.0, *self._size)
            last_tick += tick == last_tick and sender not in self._cam_by_station
        elif tick == last_tick and sender in self._cam_by_station:
            last_tick -= 1
        if tick > last_tick:
            self._cam_by_station[sender], self._cam_tick[sender] = content, tick

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
            self._tracks.add(tick, reported.exclude_near(seen.own, self._parameters.own_radius_m))
        self._tracks.end_update(tick)
        return self._tracks.build_objects(tick, seen.own)

    def _measure_messages(self, tick: int, own: OwnState) -> Iterator[Measurements]:
        """Yield what new messages report, by sender; every message is used once."""
        oldest = tick - self._parameters.memory_ticks
        cams = {name: cam for name, cam in self._cam_by_station.items() if cam.pose.tick >= oldest}
        if cams:
            yield measure_stations(tick, cams, own, self._parameters)
        for sender, cpm in sorted(self._cpm_by_station.items()):
            if cpm.pose.tick < oldest:
                continue
            last_tick = self._cpm_used_tick.get(sender, cpm.pose.tick - self._parameters.correlation_ticks)
            self._cpm_used_tick[sender] = cpm.pose.tick
            yield measure_reported(tick, sender, cpm, own, cpm.pose.tick - last_tick, self._parameters)
        self._cam_by_station, self._cpm_by_station = {}, {}
