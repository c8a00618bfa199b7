"""Place authored road users on a network: shift them by its offset, and let them follow lanes where required."""

from collections.abc import Iterator, Sequence

import numpy as np

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.checks import find_start_overlaps
from mdrive_sumo.scenario.scenario import Ego
from mdrive_sumo.scenario.scenario_part import Pose
from mdrive_sumo.scenario.scripted_actor import (
    Actor,
    DistanceTrigger,
    HardBrake,
    LaneChange,
    LaneMotion,
    Motion,
    PathMotion,
    PositionTrigger,
    ReplayMotion,
    StartMotion,
)
from real2sim.match.waypoint_matcher import match_waypoints
from real2sim.network.lane_segment import compute_yaw_difference

ON_LANE_M = 1.0
"""[m] An actor further from the lanes along its path keeps its path."""
BEYOND_PATH_M = 150.0
"""[m] Lanes are followed this far beyond the end of an actor's path: a lane change takes up to 130 m (protocol 3.4)."""

NetOffset = tuple[float, float]


def place_actors(
    actors: Sequence[Actor], roads: RoadMap, offset: NetOffset
) -> tuple[tuple[Actor, ...], tuple[str, ...]]:
    """Return the actors in the network's frame, with notes.

    Pacing actors drop their authored path and follow the lanes along it (protocol 3.4), if there are any.
    """
    there: list[Actor] = []
    notes: list[str] = []
    for actor in (_shift_actor(actor, offset) for actor in actors):
        if not isinstance(actor.action, HardBrake | LaneChange) or not actor.action.pacing:
            there.append(actor)
        elif (motion := _follow_lanes(actor.motion, roads)) is not None:
            there.append(actor.model_copy(update={"motion": motion}))
        else:
            there.append(actor)
            notes.append(f"{actor.id}: no lanes within {ON_LANE_M:g} m along its path, which it follows instead")
    return tuple(there), tuple(notes)


def note_start_contacts(egos: Sequence[Ego], actors: Sequence[Actor], roads: RoadMap) -> Iterator[str]:
    """Yield a note for each actor that overlaps a CAV at the start. Actors that appear later do not count."""
    for actor in actors:
        for ego, _ in find_start_overlaps(actor, egos, roads):
            yield f"{actor.id} overlaps CAV {ego} at the start"


def note_unreachable_triggers(egos: Sequence[Ego], actors: Sequence[Actor]) -> Iterator[str]:
    """Yield a note for each actor that waits for a CAV whose route does not come near enough."""
    routes = {ego.id: ego.xy for ego in egos}
    for actor in actors:
        trigger = actor.trigger
        if not isinstance(trigger, DistanceTrigger) or trigger.vehicle not in routes:
            continue  # an unknown CAV is refused with the scenario
        if not isinstance(actor.action or StartMotion(), StartMotion):
            continue
        gap = float(np.hypot(*(routes[trigger.vehicle] - (actor.start.x, actor.start.y)).T).min())
        if gap > trigger.distance_m:
            yield (
                f"{actor.id} never moves: the route of CAV {trigger.vehicle} comes no nearer than {gap:.1f} m,"
                f" its trigger is at {trigger.distance_m:g} m"
            )


def _shift_actor(actor: Actor, offset: NetOffset) -> Actor:
    start = actor.start
    trigger = actor.trigger
    if isinstance(trigger, PositionTrigger):
        trigger = trigger.model_copy(update={"x": trigger.x + offset[0], "y": trigger.y + offset[1]})
    return actor.model_copy(
        update={
            "start": Pose(x=start.x + offset[0], y=start.y + offset[1], yaw=start.yaw),
            "motion": _shift_motion(actor.motion, offset),
            "trigger": trigger,
        }
    )


def _shift_motion(motion: Motion, offset: NetOffset) -> Motion:
    if isinstance(motion, PathMotion):
        points = tuple((round(x + offset[0], 3), round(y + offset[1], 3)) for x, y in motion.points)
        return motion.model_copy(update={"points": points})
    if isinstance(motion, ReplayMotion):
        poses = tuple(
            (t, round(x + offset[0], 3), round(y + offset[1], 3), round(yaw, 4)) for t, x, y, yaw in motion.poses
        )
        return motion.model_copy(update={"poses": poses})
    return motion


def _follow_lanes(motion: Motion, roads: RoadMap) -> LaneMotion | None:
    if not isinstance(motion, PathMotion):
        return None
    try:
        match = match_waypoints(roads, np.array(motion.points))
    except InputError:  # no lanes there
        return None
    if match.dropped or max(abs(foot.offset) for foot in match.projections) > ON_LANE_M:
        return None
    lanes = match.legs[0].lanes + tuple(lane for leg in match.legs[1:] for lane in leg.lanes[1:])
    return LaneMotion(
        lanes=(*lanes, *_extend_straight(roads, lanes[-1])), speed=motion.speed, start_speed=motion.start_speed
    )


def _extend_straight(roads: RoadMap, lane: str) -> Iterator[str]:
    """Yield the straightest continuation from the end of a lane."""
    left = BEYOND_PATH_M
    here = roads.lanes[lane]
    seen = {lane}
    while here.successors and left > 0:
        end = here.centre.yaw_at(here.centre.length)
        here = min(
            (roads.lanes[s] for s in here.successors),
            key=lambda s: compute_yaw_difference(end, s.centre.yaw_at(s.centre.length)),
        )
        if here.id in seen:
            return
        seen.add(here.id)
        left -= here.centre.length
        yield here.id
