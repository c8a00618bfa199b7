"""A recording as the source of the loop's frames: nothing that an agent replies moves anything."""

from collections.abc import Mapping, Sequence

from mdrive_sumo.contract import Control
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.state import End, Frame
from mdrive_sumo.episode import EpisodeRecord, rebuild_frame

STRIDE = 4
"""Ticks between frames: 5 Hz, the rate at which the systems of the paper plan; logs have 10 Hz (protocol 13.1)."""


class RecordedFrames:
    """Every fourth frame of a recording; a CAV ends with the last frame in which it is in the world."""

    def __init__(self, episode: EpisodeRecord) -> None:
        """Raises InputError for an episode in which a CAV is not in the world in tick 0."""
        if not episode.valid[0, : episode.egos].all():
            raise InputError(f"episode of {episode.scenario}: expected all CAVs in the world in tick 0, found others")
        self._episode = episode
        self._columns = {ego: column for column, ego in enumerate(episode.ego_ids)}
        self._changes = list(episode.signals)
        self._signals: dict[str, str] = {}

    @property
    def dimensions(self) -> Mapping[str, tuple[float, float]]:
        """(length, width) [m] of every CAV in the recording: in that of a log its own."""
        sizes = zip(self._episode.length.tolist(), self._episode.width.tolist(), strict=True)
        return dict(zip(self._episode.ego_ids, sizes, strict=False))

    def start(self) -> Frame:
        """Return the frame of tick 0."""
        return self._build_frame(0)

    def advance(self, frame: Frame, controls: Mapping[str, Control]) -> Frame:
        """Return the recorded frame four ticks later, whatever the controls are."""
        del controls
        return self._build_frame(frame.tick + STRIDE)

    def find_ends(self, frame: Frame, active: Sequence[str]) -> Mapping[str, End]:
        """Return the recorded ends of the CAVs that have no further frame."""
        after = frame.tick + STRIDE
        return {
            ego: self._episode.find_ending(ego).end
            for ego in active
            if after >= self._episode.ticks or not self._episode.valid[after, self._columns[ego]]
        }

    def _build_frame(self, tick: int) -> Frame:
        frame = rebuild_frame(self._episode, tick)
        while self._changes and self._changes[0].tick <= tick:
            change = self._changes.pop(0)
            self._signals[change.light] = change.state
        return Frame(tick, frame.egos, frame.actors, dict(self._signals))
