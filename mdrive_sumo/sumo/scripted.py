"""Scripted road users as SUMO's traffic notices them."""

from collections.abc import Sequence

from mdrive_sumo.scenario.actor import Actor
from mdrive_sumo.state import Actors
from mdrive_sumo.sumo.ghosts import Body
from mdrive_sumo.sumo.remote import SCRIPTED


class Scripted:
    """Which scripted road users of a scenario SUMO's traffic takes notice of."""

    def __init__(self, actors: Sequence[Actor]) -> None:
        self._unnoticed = frozenset(actor.id for actor in actors if not actor.mirrored)

    def bodies(self, scripted: Actors) -> list[Body]:
        """Their boxes. By ghosts alone: with a double SUMO also shuts lanes that they are in but leave room on."""
        columns = (scripted.x, scripted.y, scripted.yaw, scripted.speed, scripted.length, scripted.width)
        return [
            Body(SCRIPTED + name, *row)
            for name, row in zip(scripted.ids, zip(*(c.tolist() for c in columns), strict=True), strict=True)
            if name not in self._unnoticed
        ]
