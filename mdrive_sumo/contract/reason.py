"""Why a car drives as it does: what limits its plan, as a note that replays and `explain` put into words."""

import json
import math
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any, Self, cast

from mdrive_sumo.contract.exchange import Note

REASON = "reason"
"""Kind of the notes that hold a `Reason`. An agent of your own may also write a plain sentence under this kind."""
MAX_OTHERS = 8
"""Road users named in one reason: the largest number of CAVs in a packaged scenario."""
MAX_OTHER_NAME = 100
"""Characters of a name that are read; names in packaged scenarios are shorter."""
MAX_NUMBER = 1e6
"""[m, s, m/s] Largest number in a reason, either sign: the bound of coordinates in scenarios and plans."""


class Cause(StrEnum):
    """What limits a plan. "Other" is the road user that `Reason.others` names first."""

    FREE = "free"
    """Nothing: it drives at the speed that it would drive alone."""
    SPEED_LIMIT = "speed-limit"
    """The legal limit of the route ahead."""
    BEND = "bend"
    """Comfort in a bend ahead."""
    FOLLOW = "follow"
    """Other moves ahead in the own direction."""
    BLOCKED = "blocked"
    """Other stands on the own path."""
    YIELD = "yield"
    """Other crosses the own path and goes first by the agent's rule of right of way."""
    AVOID = "avoid"
    """Other would be met although the car need not yield to it."""
    ONCOMING = "oncoming"
    """Traffic crosses the detour that the car has begun or needs."""
    OBSTACLE = "obstacle"
    """Something stands on the path: the car stops with room to drive around it."""
    STOP_SIGN = "stop-sign"
    """A stop sign that has not been obeyed yet."""
    LIGHT = "light"
    """A traffic light that is red, or yellow with room to stop."""
    AGREEMENT = "agreement"
    """A negotiation let others go first."""
    ANNOUNCED = "announced"
    """The trajectory that other has announced over V2X."""
    HAZARD = "hazard"
    """A detection in the lane-wide box straight ahead."""
    NO_WAY = "no-way"
    """Every speed profile would meet a road user: the car brakes as soon as it can."""
    PEDESTRIAN = "pedestrian"
    """A pedestrian beside the road faces it and may step out."""
    TURN = "turn"
    """The schedule of `take-turns`: its turn has not come."""
    MEMORY = "memory"
    """The drive that `memory` repeats."""
    STATIONARY = "stationary"
    """The agent never moves."""
    NETWORK_DRIVES = "network-drives"
    """The plan of a network keeps or gains speed."""
    NETWORK_BRAKES = "network-brakes"
    """The plan of a network loses speed."""
    NETWORK_STANDS = "network-stands"
    """The plan of a network stands."""
    CREEP = "creep"
    """The rule that moves a car which its network kept standing."""


@dataclass(frozen=True, slots=True)
class Reason:
    """One cause with what a sentence about it needs; what is not known or makes no sense for the cause is empty."""

    cause: Cause
    others: tuple[str, ...] = ()
    """Ids of the other road users, as the agent knows them: pseudonyms of stations, else its own track names."""
    position: tuple[float, float] | None = None
    """Box centre [m, world frame] of the first of them as the agent believes it: recordings have no track names."""
    distance_m: float | None = None
    """Distance [m] along the own path to where the car must wait, slow down or would meet the other."""
    seconds: float | None = None
    """Time [s] from now until the other arrives there, or until the cause ends."""
    speed: float | None = None
    """Speed [m/s] that the cause allows."""

    @property
    def key(self) -> tuple[Cause, tuple[str, ...]]:
        """What makes it another reason: distances and times change all the time."""
        return self.cause, self.others

    def to_note(self) -> Note:
        """Return the note, with numbers rounded to a tenth: a sentence needs no more."""
        content: dict[str, Any] = {"cause": str(self.cause)}
        if self.others:
            content["others"] = list(self.others[:MAX_OTHERS])
        if self.position is not None:
            content["position"] = [round(value, 1) for value in self.position]
        for name in ("distance_m", "seconds", "speed"):
            value = getattr(self, name)
            if value is not None and math.isfinite(value):
                content[name] = round(value, 1)
        return Note(REASON, json.dumps(content, separators=(",", ":")))

    @classmethod
    def from_note(cls, note: Note) -> Self | None:
        """Return the reason of a note; None if its text is a sentence of an agent's own, or anything else.

        It has at most `MAX_OTHERS` road users, with names of at most `MAX_OTHER_NAME` characters, and numbers of at
        most `MAX_NUMBER`.
        """
        try:
            content = json.loads(note.text)
            if note.kind != REASON or not isinstance(content, dict):
                return None
            numbers = {name: _read_number(content.get(name)) for name in ("distance_m", "seconds", "speed")}
            if (numbers["seconds"] or 0.0) < 0.0:
                return None
            others, position = _read_others(content.get("others", [])), _read_position(content.get("position"))
            return cls(Cause(content["cause"]), others, position, **numbers)
        except (KeyError, ValueError, TypeError, RecursionError):  # a program that is not trusted wrote it
            return None


def _read_number(value: object) -> float | None:
    """Return a number of at most `MAX_NUMBER`, None for nothing. Raises ValueError for anything else."""
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= MAX_NUMBER:
        raise ValueError(f"expected a number of at most {MAX_NUMBER:.0f}")
    return float(value)


def _read_position(value: object) -> tuple[float, float] | None:
    """Return x and y, None for nothing. Raises ValueError for anything else."""
    if value is None:
        return None
    if isinstance(value, list) and len(cast("list[object]", value)) == 2:
        x, y = map(_read_number, cast("list[object]", value))
        if x is not None and y is not None:
            return x, y
    raise ValueError("expected a position of two numbers")


def _read_others(value: object) -> tuple[str, ...]:
    """Return the first names of a list, cut to `MAX_OTHER_NAME` characters. Raises ValueError for anything else."""
    if not isinstance(value, list):
        raise ValueError("expected a list of names")
    names = cast("list[object]", value)[:MAX_OTHERS]
    texts = tuple(name[:MAX_OTHER_NAME] for name in names if isinstance(name, str))
    if len(texts) < len(names):
        raise ValueError("expected names that are text")
    return texts


class ReasonLog:
    """Turns the reasons of successive decisions into notes: one whenever the cause or the road users change."""

    def __init__(self) -> None:
        self._last: Reason | None = None

    def record(self, reason: Reason) -> tuple[Note, ...]:
        """Return the note of a new reason; nothing while the last one goes on."""
        if self._last is not None and reason.key == self._last.key:
            return ()
        self._last = reason
        return (replace(reason, others=reason.others[:MAX_OTHERS]).to_note(),)
