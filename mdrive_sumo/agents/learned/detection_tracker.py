"""DetectionTracker: what a detector finds in single scans, as objects with names and velocities at any tick."""

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from mdrive_sumo.agents.learned.box_decoding import DetectedBoxes
from mdrive_sumo.agents.learned.ego_frame import convert_to_world
from mdrive_sumo.agents.learned.fusion_spec import CLASSES, GRID_REACH_M
from mdrive_sumo.contract import Objects, OwnState
from mdrive_sumo.contract.detector_profiles import DetectionProfile
from mdrive_sumo.core.geometry import wrap_angles
from mdrive_sumo.core.state import DT, Kind
from mdrive_sumo.perception.measurements import measure_detections
from mdrive_sumo.perception.track_list import TrackList
from mdrive_sumo.perception.tracking_parameters import TRACKING
from mdrive_sumo.v2x.messages import format_track_name

DETECTION_ERRORS = DetectionProfile(
    recall=1.0,
    recall_far=1.0,
    min_visible=0.0,
    plain_visible=0.0,
    spread=0.25,
    spread_doubles_m=50.0,
    yaw_sigma=0.1,
    size_sigma=0.1,
    speed_sigma=6.0,
    false_positives=0.5,
    latency_ticks=0,
)
"""What the tracker assumes of boxes; only the standard deviations count. Chosen before any detector was trained: a cell
of the head is 0.8 m, and rounding to half of it has 0.23 m. A box says nothing of the speed: 6 m/s spans what drives in
towns, from 0 to 14 m/s."""
TRACK_ERRORS = replace(DETECTION_ERRORS, speed_sigma=1.5)
"""Of tracks, which have a speed: two positions 0.2 s apart with 0.25 m each tell it to 1.8 m/s, three to 0.9 m/s."""
KINDS: Mapping[str, Kind] = MappingProxyType(
    {"vehicle": Kind.VEHICLE, "rider": Kind.CYCLIST, "pedestrian": Kind.PEDESTRIAN}
)


class DetectionTracker:
    """Tracks of one car (`perception.track_list`). Its clock is that of the scans, which lie in the past."""

    def __init__(self) -> None:
        # Detections may be false: a standing object is believed after half a second, as from a surrogate's detections.
        self._tracks = TrackList(False, TRACKING)
        self._tick: int | None = None
        self._objects: Objects | None = None

    def update(self, tick: int, own: OwnState, found: DetectedBoxes) -> None:
        """Add what was found in the scan of a tick, in the frame of the car's pose at that tick."""
        elapsed_ticks = TRACKING.correlation_ticks if self._tick is None else tick - self._tick
        self._tracks.predict(0.0 if self._tick is None else elapsed_ticks * DT)
        detections = build_detections(tick, own, found)
        self._tracks.add(tick, measure_detections(detections, own, DETECTION_ERRORS, elapsed_ticks, TRACKING))
        self._tracks.end_update(tick)
        objects = self._tracks.build_objects(tick, own)
        # CPMs name tracks as sensors do; the list names them k0, k1, ..., by the number of the track.
        self._tick = tick
        self._objects = replace(objects, ids=tuple(format_track_name(int(name[1:])) for name in objects.ids))

    def predict(self, tick: int) -> Objects:
        """Return all confirmed objects, advanced to a tick at constant speed; none before the first scan."""
        if self._tick is None or self._objects is None:
            return _NO_OBJECTS
        return self._objects.advance((tick - self._tick) * DT)


def build_detections(tick: int, own: OwnState, found: DetectedBoxes) -> Objects:
    """Return boxes of a scan in the world frame, without speed; names say the scan, so that none is a known one.

    Boxes whose centre lies outside of the grid are left out: no scan shows anything there.
    """
    inside = (np.abs(found.boxes[:, :2]) <= GRID_REACH_M).all(axis=1)
    x, y, yaw, length, width = found.boxes[inside].T
    places = convert_to_world(np.column_stack((x, y)), own)
    kinds = np.array([KINDS[CLASSES[index]] for index in found.classes[inside]], dtype=np.uint8)
    ids = tuple(f"{tick}.{i}" for i in range(len(x)))
    columns = places[:, 0], places[:, 1], wrap_angles(yaw + own.yaw), np.zeros(len(x)), length, width
    return Objects(ids, kinds, *(np.ascontiguousarray(column) for column in columns))


_NO_OBJECTS = build_detections(
    0,
    OwnState(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    DetectedBoxes(np.zeros((0, 5)), np.zeros(0, np.int64), np.zeros(0)),
)
