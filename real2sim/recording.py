"""Recording: what a log says, whatever its source. Readers make it, everything after the readers knows nothing else.

World frame of the log: metres, right-handed, x and y in the plane, yaw in radians counter-clockwise from +x; a pose is
the box centre. One row of every array is one frame; frames are `dt_s` apart.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum

import numpy as np
import numpy.typing as npt

from mdrive_sumo.core.geometry import Bool, Float
from mdrive_sumo.core.state import Kind
from real2sim.hd_map import HdMap


class ObjectCategory(StrEnum):
    """What a thing is, in the words of all sources."""

    CAR = "car"
    VAN = "van"
    TRUCK = "truck"
    BUS = "bus"
    MOTORCYCLE = "motorcycle"
    BICYCLE = "bicycle"
    """A bicycle or scooter with its rider."""
    PEDESTRIAN = "pedestrian"
    STATIC = "static"
    """Barriers, cones, bins: nothing that ever moves by itself."""

    @property
    def kind(self) -> Kind:
        """How the simulation calls it."""
        if self is ObjectCategory.PEDESTRIAN:
            return Kind.PEDESTRIAN
        if self is ObjectCategory.BICYCLE:
            return Kind.CYCLIST
        return Kind.STATIC if self is ObjectCategory.STATIC else Kind.VEHICLE


DEFAULT_SIZE_M: Mapping[ObjectCategory, tuple[float, float]] = {
    ObjectCategory.CAR: (4.6, 1.85),
    ObjectCategory.VAN: (5.3, 2.0),
    ObjectCategory.TRUCK: (8.0, 2.5),
    ObjectCategory.BUS: (12.0, 2.55),
    ObjectCategory.MOTORCYCLE: (2.2, 0.8),
    ObjectCategory.BICYCLE: (1.8, 0.65),
    ObjectCategory.PEDESTRIAN: (0.5, 0.5),
    ObjectCategory.STATIC: (0.5, 0.5),
}
"""Length and width [m] for sources that tell none."""


@dataclass(frozen=True)
class RecordedTrack:
    """One thing through all frames. Arrays are (T,), rows without `valid` hold NaN."""

    id: str
    category: ObjectCategory
    valid: Bool
    x: Float
    y: Float
    yaw: Float
    """As the source tells it; may be junk for pedestrians. NaN where the source tells none."""
    length: Float
    width: Float
    """Full sizes [m]; NaN where the source tells none."""
    parked: bool = False
    """Whether the source calls it static."""

    @property
    def xy(self) -> Float:
        """(T, 2) [m]"""
        return np.column_stack((self.x, self.y))

    @property
    def frames(self) -> npt.NDArray[np.intp]:
        """The rows in which it is there."""
        return np.flatnonzero(self.valid)

    def with_rows(self, **columns: Float | Bool) -> "RecordedTrack":
        """The same with other arrays."""
        return replace(self, **columns)


@dataclass(frozen=True)
class ObserverView:
    """What one observer recorded. A log with one list of tracks for all has one view."""

    observer: str
    """Agent folder or "log"."""
    tracks: tuple[RecordedTrack, ...]
    pose: Float = field(default_factory=lambda: np.zeros((0, 3)))
    """(T, 3) x, y, yaw of the observer's sensor; empty if it has none of its own."""
    infrastructure: bool = False


@dataclass(frozen=True)
class Recording:
    """A log: views of the same scene on a common grid of frames, and the map."""

    id: str
    source: str
    """Name of the reader."""
    dt_s: float
    frames: int
    views: tuple[ObserverView, ...]
    map: HdMap
    cavs: tuple[str, ...] = ()
    """Which observers, or (in a log with one view) which tracks, are connected automated vehicles by the source."""
    notes: tuple[str, ...] = ()
    """What the reader had to pass over or to guess, for the report."""
