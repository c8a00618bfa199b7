"""Recording: the common form of a log, independent of its source.

Readers build it; all later steps depend on it only. World frame: metres, right-handed, x and y in the plane, yaw in
radians counter-clockwise from +x; a pose is the box centre. One row of every array is one frame; frames are `dt_s`
apart.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum

import numpy as np
import numpy.typing as npt

from mdrive_sumo.core.geometry import Bool, Float, wrap_angles
from mdrive_sumo.core.state import Kind
from real2sim.hd_map import HdMap


class ObjectCategory(StrEnum):
    """Class of a road user or object, common to all sources."""

    CAR = "car"
    VAN = "van"
    TRUCK = "truck"
    BUS = "bus"
    MOTORCYCLE = "motorcycle"
    BICYCLE = "bicycle"
    """A bicycle or scooter with its rider."""
    PEDESTRIAN = "pedestrian"
    STATIC = "static"
    """Barriers, cones, bins: objects that never move by themselves."""

    @property
    def kind(self) -> Kind:
        """Kind of the simulation for this category."""
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
"""Length and width [m] for sources that give no dimensions: typical of each class, not of any data set."""
COLUMNS = ("x", "y", "yaw", "length", "width")
"""The arrays of a track that hold NaN where it is not observed."""


@dataclass(frozen=True)
class RecordedTrack:
    """One road user or object over all frames. Arrays are (T,); rows that are not `valid` hold NaN."""

    id: str
    category: ObjectCategory
    valid: Bool
    x: Float
    y: Float
    yaw: Float
    """[rad] As the source gives it; unreliable for pedestrians, NaN where the source gives none."""
    length: Float
    width: Float
    """Full length and width [m]; NaN where the source gives none."""
    parked: bool = False
    """Whether the source labels it static."""

    @classmethod
    def from_table(cls, id: str, category: ObjectCategory, table: Float) -> "RecordedTrack":
        """Return a track of x, y, yaw, length, width (T, 5) [m, rad]; NaN: not observed. A size of 0 is unknown."""
        x, y, yaw, length, width = table.T
        length, width = (np.where(size > 0, size, np.nan) for size in (length, width))
        return cls(id, category, np.isfinite(x), x, y, wrap_angles(yaw), length, width)

    @property
    def xy(self) -> Float:
        """Positions (T, 2) [m]."""
        return np.column_stack((self.x, self.y))

    @property
    def valid_frames(self) -> npt.NDArray[np.intp]:
        """Indices of the valid frames."""
        return np.flatnonzero(self.valid)

    def replace_columns(self, **columns: Float | Bool) -> "RecordedTrack":
        """Return a copy with other arrays."""
        return replace(self, **columns)

    def restrict(self, valid: Bool) -> "RecordedTrack":
        """Return a copy that is observed in the frames of `valid` (T,) only."""
        return replace(self, valid=valid, **{name: np.where(valid, getattr(self, name), np.nan) for name in COLUMNS})

    def select_frames(self, rows: slice) -> "RecordedTrack":
        """Return a copy with these frames only."""
        return replace(self, valid=self.valid[rows], **{name: getattr(self, name)[rows] for name in COLUMNS})


@dataclass(frozen=True)
class ObserverView:
    """Tracks recorded by one observer. A log with one common list of tracks has one view."""

    observer: str
    """Name of the agent folder, or "log"."""
    tracks: tuple[RecordedTrack, ...]
    pose: Float = field(default_factory=lambda: np.zeros((0, 3)))
    """(T, 3) x, y [m], yaw [rad] of the observer's sensor; empty if it has none."""
    is_infrastructure: bool = False


@dataclass(frozen=True)
class Recording:
    """A log: views of one scene on a common grid of frames, and the map."""

    id: str
    source: str
    """Name of the reader that has read it."""
    dt_s: float
    frame_count: int
    views: tuple[ObserverView, ...]
    map: HdMap
    cavs: tuple[str, ...] = ()
    """Connected automated vehicles named by the source: observers, or track ids in a log with one view."""
    notes: tuple[str, ...] = ()
    """What the reader skipped or assumed, for the report."""
    origin: tuple[float, float] = (0.0, 0.0)
    """[m] Where the origin of this frame lies in the frame of the source."""
    exact: bool = False
    """Whether poses have no error of measurement, as those of a simulation: then they are kept, not reconstructed."""


def vehicle_trajectories(tracks: Sequence[RecordedTrack]) -> dict[str, Float]:
    """Return x, y, yaw (T, 3) of all vehicles by id."""
    vehicles = [track for track in tracks if track.category.kind is Kind.VEHICLE]
    return {track.id: np.column_stack((track.x, track.y, track.yaw)) for track in vehicles}
