"""Scripted actors as sources of ghosts in SUMO."""

from collections.abc import Sequence

import numpy as np

from mdrive_sumo.core.state import Actors
from mdrive_sumo.scenario.scripted_actor import Actor
from mdrive_sumo.sumo.ghost_placement import SourceBox

SCRIPTED = "scripted:"
"""Prefix of their source ids. They have ghosts in SUMO but no placed vehicle."""


class MirroredActors:
    """Selects the scripted actors that SUMO's traffic reacts to."""

    def __init__(self, actors: Sequence[Actor]) -> None:
        self._not_mirrored = frozenset(actor.id for actor in actors if not actor.mirrored)

    def select(self, scripted: Actors) -> Actors:
        """Return the actors that SUMO's traffic reacts to."""
        if self._not_mirrored.isdisjoint(scripted.ids):
            return scripted
        chosen = [name not in self._not_mirrored for name in scripted.ids]
        return scripted.take(np.array(chosen, np.bool_))


def build_source_ids(actors: Actors) -> set[str]:
    """Return the source ids of actors."""
    return {SCRIPTED + name for name in actors.ids}


def build_source_boxes(actors: Actors) -> list[SourceBox]:
    """Return the source boxes of actors. A placed vehicle would also block lanes on which they leave enough room."""
    columns = (actors.x, actors.y, actors.yaw, actors.speed, actors.length, actors.width)
    rows = zip(*(column.tolist() for column in columns), strict=True)
    return [SourceBox(SCRIPTED + name, *row) for name, row in zip(actors.ids, rows, strict=True)]
