"""Mirror: ghosts of everything that moves by itself, so that SUMO's traffic notices it wherever it overlaps a lane."""

# pyright: basic
from collections.abc import Collection, Sequence

import libsumo

from mdrive_sumo.roads import RoadMap
from mdrive_sumo.sumo.ghost_placement import CORRIDOR_M, Body, Ghost, ghosts_of
from mdrive_sumo.sumo.placed_vehicles import GHOST, add_remote, place

GHOST_TICKS = 5
"""Which lanes a body overlaps is found every 0.25 s; between, its ghosts move along. SUMO's drivers look less often."""

END_M = 1.0
"""A ghost that stands is placed once, and stays; not so near the end of its lane, where SUMO lets vehicles arrive."""


class Mirror:
    """The ghosts that are in SUMO now. One object an episode."""

    def __init__(self, roads: RoadMap) -> None:
        self._roads = roads
        self._ghosts: dict[str, Ghost] = {}
        self._bodies: dict[str, Body] = {}
        self._looked = False

    def looks(self, tick: int) -> bool:
        """Whether it is time to `look`, as it is at first whenever that is; else `follow` will do."""
        return not self._looked or tick % GHOST_TICKS == 0

    def look(self, bodies: Sequence[Body]) -> None:
        """Places the ghosts of all bodies for the coming step, by what they overlap now."""
        self._looked = True
        self._place_all(self._found(bodies))

    def follow(self, names: Collection[str]) -> None:
        """Moves the ghosts of the named bodies along as they did; a new body has none until it is looked for."""
        self._place_all({name: ghost.moved() for name, ghost in self._ghosts.items() if ghost.body in names})

    def _place_all(self, wanted: dict[str, Ghost]) -> None:
        for name in [name for name in self._ghosts if name not in wanted]:
            libsumo.vehicle.remove(name)
        for name, ghost in wanted.items():
            before = self._ghosts.get(name)
            if ghost is not before or ghost.front_s > ghost.lane.centre.length - END_M:
                self._place(name, ghost, before)
        self._ghosts = wanted

    def _found(self, bodies: Sequence[Body]) -> dict[str, Ghost]:
        """Whoever has not moved keeps the ghosts it has."""
        still = {body.name for body in bodies if not body.speed and self._bodies.get(body.name) == body}
        fresh = ghosts_of([body for body in bodies if body.name not in still], self._roads)
        self._bodies = {body.name: body for body in bodies}
        return {name: ghost for name, ghost in self._ghosts.items() if ghost.body in still} | fresh

    def _place(self, name: str, ghost: Ghost, before: Ghost | None) -> None:
        if before is None:
            add_remote(name, GHOST, (ghost.length, CORRIDOR_M), ghost.lane.edge, self._roads)
        elif ghost.length != before.length:
            libsumo.vehicle.setLength(name, ghost.length)
        x, y = ghost.lane.centre.at(ghost.front_s)
        hint = (ghost.lane.edge, ghost.lane.index)
        place(name, x, y, ghost.lane.centre.yaw_at(ghost.front_s), ghost.speed, hint)
