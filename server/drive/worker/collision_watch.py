"""CollisionWatch: which contacts of CAVs begin in a tick, so that pages can tell people at once."""

from typing import Any

from mdrive_sumo.core.state import TICKS_PER_SECOND, Frame, Kind

PAUSE_TICKS = TICKS_PER_SECOND
"""Contacts of the same two that are not farther apart are one: bodies that push each other part for a tick or two."""
WALL = "wall"
WORDS = {Kind.VEHICLE: "vehicle", Kind.PEDESTRIAN: "pedestrian", Kind.CYCLIST: "cyclist", Kind.STATIC: "obstacle"}
"""What was hit, in the words of pages."""


class CollisionWatch:
    """Sees every tick of a take once, in order."""

    def __init__(self) -> None:
        self._last: dict[tuple[str, str], int] = {}
        """The last tick in which a CAV touched something."""

    def find_begun(self, frame: Frame) -> list[dict[str, Any]]:
        """Return the contacts that begin: `cav`, `with` (a word of `WORDS`, or `WALL`) and `id` ("" for a wall)."""
        begun: list[dict[str, Any]] = []
        for contact in sorted(frame.contacts, key=lambda one: (one.ego, one.other)):
            pair = contact.ego, contact.other
            if frame.tick - self._last.get(pair, -PAUSE_TICKS - 1) > PAUSE_TICKS:
                word = WORDS[contact.kind] if contact.other else WALL
                begun.append({"cav": contact.ego, "with": word, "id": contact.other})
            self._last[pair] = frame.tick
        return begun
