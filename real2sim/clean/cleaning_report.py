"""What cleaning changed, and why: nothing is changed without an entry."""

from collections import Counter
from dataclasses import dataclass
from enum import StrEnum


class ChangeReason(StrEnum):
    """Why a track was changed."""

    DUPLICATE = "duplicate"
    """One thing under several names."""
    ID_FLIP = "id flip"
    """A name went over to another thing, or a thing got another name."""
    TELEPORT = "teleport"
    """Positions that no motion explains were left out, or their step spread over the time around it."""
    EGO_GHOST = "ego ghost"
    """A CAV was listed as if it were somebody else; those boxes are the CAV now."""
    HEADING = "heading"
    """Headings turned round, or taken from motion."""
    GAP = "gap"
    """Missing frames filled by motion or by another observer."""
    LONG_GAP = "long gap"
    """Missing frames that were left missing."""
    SIZE = "size"
    """Sizes that differ between observers, or are assumed."""
    LABEL = "label"
    """Classes that differ between observers, or contradict motion or size."""
    STATIC = "static"
    """Marked as never moving."""
    OVERLAP = "overlap"
    """Appeared inside another thing: begins later, or both are taken smaller."""
    INSIDE = "inside another"
    """Lies inside another thing for most of its life: left out altogether."""
    TOO_SHORT = "too short"
    """Left out altogether."""


DROP_REASONS = frozenset((ChangeReason.INSIDE, ChangeReason.TOO_SHORT))


@dataclass(frozen=True, slots=True)
class TrackChange:
    """One change: which track of the result (for what was left out: of the source), how many frames, and how."""

    reason: ChangeReason
    track: str
    frames: int
    detail: str = ""
    whole: bool = False
    """Whether all of the track was left out, for a reason that does not say so."""


@dataclass(frozen=True, slots=True)
class CleaningReport:
    """All changes."""

    changes: tuple[TrackChange, ...]

    def counts(self) -> dict[str, int]:
        """Changes per reason."""
        return dict(Counter(change.reason.value for change in self.changes))

    def of(self, reason: ChangeReason) -> tuple[TrackChange, ...]:
        """Changes for one reason."""
        return tuple(change for change in self.changes if change.reason is reason)

    @property
    def lost(self) -> dict[str, str]:
        """Things of any kind that were left out altogether, with the reason."""
        return {change.track: change.detail for change in self.changes if change.whole or change.reason in DROP_REASONS}
