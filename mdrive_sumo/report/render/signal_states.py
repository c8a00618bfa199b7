"""The colours of traffic lights by tick, as the replay shows them."""

from bisect import bisect_right
from collections import defaultdict

from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.report.palette import LIGHT

COLOUR_OF_LETTER = {"r": "bad", "u": "bad", "y": "warn", "s": "warn", "g": "good", "G": "good"}
"""Names of colours by SUMO's letters; others, such as a light that is off, are muted."""


class SignalStates:
    """The recorded states of traffic lights."""

    def __init__(self, record: EpisodeRecord) -> None:
        self._ticks: defaultdict[str, list[int]] = defaultdict(list)
        self._states: defaultdict[str, list[str]] = defaultdict(list)
        for change in record.signals:
            self._ticks[change.light].append(change.tick)
            self._states[change.light].append(change.state)

    def find_colour(self, light: str, tick: int) -> str:
        """Return the colour of a light "tls:index" in a tick."""
        name, _, index = light.rpartition(":")
        letter = self._find_state(name, tick)[int(index) : int(index) + 1]
        return LIGHT[COLOUR_OF_LETTER.get(letter, "muted")]

    def find_states(self, tick: int) -> dict[str, str]:
        """Return the state (SUMO letters) of every light "tls" in a tick."""
        return {name: self._find_state(name, tick) for name in list(self._ticks)}

    def _find_state(self, name: str, tick: int) -> str:
        last = bisect_right(self._ticks[name], tick) - 1
        return self._states[name][last] if last >= 0 else ""
