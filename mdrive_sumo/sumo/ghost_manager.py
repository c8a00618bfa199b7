"""Ghost vehicles of CAVs and scripted actors, so that SUMO's traffic reacts wherever they overlap a lane."""

# pyright: basic
# Because libsumo has no type information.
from collections.abc import Collection, Sequence
from dataclasses import replace

import libsumo
import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.state import Actors
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scripted_actor import Actor, GapTrigger, PathMotion
from mdrive_sumo.sumo.ghost_placement import CORRIDOR_M, Ghost, SourceBox, find_ghosts
from mdrive_sumo.sumo.placed_vehicles import GHOST, add_placed_vehicle, place_vehicle

SCRIPTED = "scripted:"
"""Prefix of their source ids. They have ghosts in SUMO but no placed vehicle."""


BEGUN_M, DONE_M = 0.05, 0.3
"""[m] A person who waits for a gap claims its way from this distance from its start on, until this near its end."""


class MirroredActors:
    """Selects the scripted actors that SUMO's traffic reacts to."""

    def __init__(self, actors: Sequence[Actor]) -> None:
        self._not_mirrored = frozenset(actor.id for actor in actors if not actor.mirrored)
        self._ways = {
            actor.id: actor.motion.points[:2]
            for actor in actors
            if isinstance(actor.trigger, GapTrigger) and isinstance(actor.motion, PathMotion)
        }

    def select(self, scripted: Actors) -> Actors:
        """Return the actors that SUMO's traffic reacts to; those that cross by a gap as long as the way left to go."""
        return self._extend(self._leave_out(scripted)) if self._ways else self._leave_out(scripted)

    def _extend(self, scripted: Actors) -> Actors:
        """Return the actors; the boxes of those that cross reach to the end of the stretch, and stand."""
        x, y, yaw, length = (column.copy() for column in (scripted.x, scripted.y, scripted.yaw, scripted.length))
        speed = scripted.speed.copy()
        for i, name in enumerate(scripted.ids):
            if (way := self._ways.get(name)) is None:
                continue
            here, (start, end) = (float(x[i]), float(y[i])), way
            whole, left = portable.distance(start, end), portable.distance(here, end)
            passed = portable.distance(start, here)
            if passed < BEGUN_M or left < DONE_M or passed > whole:
                continue
            x[i], y[i] = (here[0] + end[0]) / 2, (here[1] + end[1]) / 2
            yaw[i] = portable.atan2(end[1] - start[1], end[0] - start[0])
            length[i] += left
            speed[i] = 0.0
        return replace(scripted, x=x, y=y, yaw=yaw, length=length, speed=speed)

    def _leave_out(self, scripted: Actors) -> Actors:
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


SEARCH_TICKS = 5
"""Interval of the search for overlapped lanes: 0.25 s, shorter than the action step of SUMO's drivers."""

END_M = 1.0
"""[m] A standing ghost is placed once; nearer than this to the end of its lane, where SUMO removes vehicles, always."""


class GhostManager:
    """The ghosts of one episode that are in SUMO now."""

    def __init__(self, roads: RoadMap) -> None:
        self._roads = roads
        self._ghosts: dict[str, Ghost] = {}
        self._source_by_id: dict[str, SourceBox] = {}
        self._has_searched = False

    @property
    def has_ghosts(self) -> bool:
        """Whether any ghost is in SUMO now."""
        return bool(self._ghosts)

    def is_search_due(self, tick: int) -> bool:
        """Return whether `search` is due in this tick; otherwise `advance` suffices. The first call needs a search."""
        return not self._has_searched or tick % SEARCH_TICKS == 0

    def search(self, sources: Sequence[SourceBox]) -> None:
        """Place the ghosts of all sources for the coming step, on the lanes that they overlap now."""
        self._has_searched = True
        self._place_all(self._find_ghosts(sources))

    def advance(self, source_ids: Collection[str]) -> None:
        """Move the ghosts of the given sources at constant speed; a new source gets ghosts in the next search."""
        self._place_all(
            {name: ghost.advance() for name, ghost in self._ghosts.items() if ghost.source_id in source_ids}
        )

    def _place_all(self, ghosts: dict[str, Ghost]) -> None:
        for name in [name for name in self._ghosts if name not in ghosts]:
            libsumo.vehicle.remove(name)
        for name, ghost in ghosts.items():
            before = self._ghosts.get(name)
            if ghost is not before or ghost.front_s > ghost.lane.centre.length - END_M:
                self._place(name, ghost, before)
        self._ghosts = ghosts

    def _find_ghosts(self, sources: Sequence[SourceBox]) -> dict[str, Ghost]:
        """Return the ghosts of all sources. A source that has not moved keeps its ghosts."""
        unmoved = {
            source.name for source in sources if not source.speed and self._source_by_id.get(source.name) == source
        }
        new = find_ghosts([source for source in sources if source.name not in unmoved], self._roads)
        self._source_by_id = {source.name: source for source in sources}
        return {name: ghost for name, ghost in self._ghosts.items() if ghost.source_id in unmoved} | new

    def _place(self, name: str, ghost: Ghost, before: Ghost | None) -> None:
        if before is None:
            add_placed_vehicle(name, GHOST, (ghost.length, CORRIDOR_M), ghost.lane.edge, self._roads)
        elif ghost.length != before.length:
            libsumo.vehicle.setLength(name, ghost.length)
        x, y = ghost.lane.centre.at(ghost.front_s)
        hint = (ghost.lane.edge, ghost.lane.index)
        place_vehicle(name, x, y, ghost.lane.centre.yaw_at(ghost.front_s), ghost.speed, hint)
