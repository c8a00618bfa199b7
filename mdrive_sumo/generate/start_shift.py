"""How far all CAVs of a scenario may start from what is written, by where their conflicts lie."""

from collections.abc import Sequence
from typing import Final

import numpy as np
import shapely

from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import CommonStartShift, Ego
from mdrive_sumo.scenario.scripted_actor import Actor, PathMotion
from mdrive_sumo.scenario.start_variation import StartBounds, find_shift_range

FURTHEST_M: Final = 15.0
"""[m] Three car lengths, back or ahead: with the 3 m of each CAV (`StartBounds`) starts differ by up to 36 m."""
RUN_UP_M: Final = 13.0
"""[m] From the start to the first conflict: blind driving reaches its 8 m/s after 12.8 m, so that CAVs which start
further ahead together still meet at the same time."""
ACTOR_RUN_UP_M: Final = 30.0
"""[m] From the start to where a scripted road user is or goes: triggers reach 8 to 25 m."""
MEETING_M: Final = 1.6
"""[m] Routes within this distance of each other conflict, as in `spawn_points`."""
ROADSIDE_M: Final = 6.0
"""[m] Road users within this distance of a route concern its CAV."""


def find_start_shift(egos: Sequence[Ego], actors: Sequence[Actor], roads: RoadMap) -> CommonStartShift | None:
    """Return the range that leaves every CAV on its first lane with a run-up to what it meets; None if it is short."""
    ranges = [find_shift_range(ego, roads, StartBounds()) for ego in egos]
    run_ups = [
        run_up for i, ego in enumerate(egos) for run_up in _list_run_ups(ego, [*egos[:i], *egos[i + 1 :]], actors)
    ]
    back_m = min(FURTHEST_M, *(-low for low, _ in ranges))
    ahead_m = min(FURTHEST_M, *(high for _, high in ranges), *run_ups)
    shift = CommonStartShift(back_m=_round_down(back_m), ahead_m=_round_down(ahead_m))
    return shift if shift.back_m + shift.ahead_m > StartBounds().shift_m else None


def _round_down(length_m: float) -> float:
    return max(int(length_m * 10) / 10, 0.0)


def _list_run_ups(ego: Ego, others: Sequence[Ego], actors: Sequence[Actor]) -> list[float]:
    """Return how far ahead the CAV may start for each CAV and each actor that it meets [m]."""
    points = shapely.points(ego.xy)
    found: list[float] = []
    for other in others:
        near = np.asarray(shapely.distance(points, shapely.LineString(other.xy)) < MEETING_M)
        if near.any() and ego.lanes[0] != other.lanes[0]:  # those on one lane are a queue
            found.append(float(np.argmax(near)) - RUN_UP_M)
    for actor in actors:
        near = np.asarray(shapely.distance(points, _find_extent(actor)) < ROADSIDE_M)
        if near.any():
            found.append(float(np.argmax(near)) - ACTOR_RUN_UP_M)
    return found


def _find_extent(actor: Actor) -> shapely.Geometry:
    """Return where an actor is and goes."""
    start = (actor.start.x, actor.start.y)
    way = actor.motion.points if isinstance(actor.motion, PathMotion) else ()
    return shapely.LineString([start, *way]) if way else shapely.Point(start)
