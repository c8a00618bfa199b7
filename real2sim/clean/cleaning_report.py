"""Record of every change made by cleaning, with its reason."""

from collections import Counter
from dataclasses import dataclass
from enum import StrEnum


class ChangeReason(StrEnum):
    """Reason for the change of a track."""

    DUPLICATE = "duplicate"
    """One object with several ids."""
    ID_FLIP = "id flip"
    """An id moved to another object, or an object changed its id."""
    TELEPORT = "teleport"
    """Positions that motion cannot explain were dropped, or their step was spread over time."""
    EGO_GHOST = "ego ghost"
    """A CAV was listed as another road user; these boxes now belong to the CAV."""
    HEADING = "heading"
    """Headings turned by 180 degrees, or derived from motion."""
    GAP = "gap"
    """Missing frames filled from motion or another observer."""
    LONG_GAP = "long gap"
    """Missing frames that stay missing."""
    SIZE = "size"
    """Sizes differ between observers, or are assumed."""
    LABEL = "label"
    """Categories differ between observers, or contradict motion or size."""
    STATIC = "static"
    """Marked as never moving."""
    OVERLAP = "overlap"
    """Appeared inside another object: the track begins later, or both boxes are shrunk."""
    INSIDE = "inside another"
    """Inside another object for most of its life: the track is dropped."""
    TOO_SHORT = "too short"
    """The track is dropped."""


DROP_REASONS = frozenset((ChangeReason.INSIDE, ChangeReason.TOO_SHORT))


@dataclass(frozen=True, slots=True)
class TrackChange:
    """One change: the track of the result (for dropped tracks: of the source), the number of frames, and details."""

    reason: ChangeReason
    track: str
    frames: int
    detail: str = ""
    is_whole_track: bool = False
    """Whether the whole track was dropped although `reason` does not imply it."""


@dataclass(frozen=True, slots=True)
class CleaningReport:
    """All changes of one recording."""

    changes: tuple[TrackChange, ...]

    def count_by_reason(self) -> dict[str, int]:
        """Return the number of changes per reason."""
        return dict(Counter(change.reason.value for change in self.changes))

    def list_changes(self, reason: ChangeReason) -> tuple[TrackChange, ...]:
        """Return the changes with one reason."""
        return tuple(change for change in self.changes if change.reason is reason)

    @property
    def drop_reason_by_track(self) -> dict[str, str]:
        """Details of the drop by id of the dropped track."""
        return {
            change.track: change.detail
            for change in self.changes
            if change.is_whole_track or change.reason in DROP_REASONS
        }
