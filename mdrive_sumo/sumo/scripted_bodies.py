"""Scripted road users as SUMO's traffic notices them."""

from collections.abc import Sequence

from mdrive_sumo.core.state import Actors
from mdrive_sumo.scenario.scripted_actor import Actor
from mdrive_sumo.sumo.ghost_placement import Body

SCRIPTED = "scripted:"
"""Prefix of the names of their bodies, which have ghosts in SUMO, and no double."""


class Scripted:
    """Which scripted road users of a scenario SUMO's traffic takes notice of."""

    def __init__(self, actors: Sequence[Actor]) -> None:
        self._unnoticed = frozenset(actor.id for actor in actors if not actor.mirrored)

    def noticed(self, scripted: Actors) -> Actors:
        """Those that SUMO's traffic takes notice of."""
        if self._unnoticed.isdisjoint(scripted.ids):
            return scripted
        chosen = [i for i, name in enumerate(scripted.ids) if name not in self._unnoticed]
        columns = ("kind", "x", "y", "yaw", "speed", "length", "width")
        return Actors(
            tuple(scripted.ids[i] for i in chosen), *(getattr(scripted, column)[chosen] for column in columns)
        )


def names_of(actors: Actors) -> set[str]:
    """Names of their bodies."""
    return {SCRIPTED + name for name in actors.ids}


def bodies_of(actors: Actors) -> list[Body]:
    """Their boxes. By ghosts alone: with a double SUMO also shuts lanes that they are in but leave room on."""
    columns = (actors.x, actors.y, actors.yaw, actors.speed, actors.length, actors.width)
    rows = zip(*(column.tolist() for column in columns), strict=True)
    return [Body(SCRIPTED + name, *row) for name, row in zip(actors.ids, rows, strict=True)]
