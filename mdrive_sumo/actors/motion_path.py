"""A course: where one scripted road user goes, as knots between which everything is linear."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mdrive_sumo.core.geometry import Float, Polyline, build_polyline
from mdrive_sumo.roads import RoadMap, build_lane_route
from mdrive_sumo.scenario.scenario_part import Pose
from mdrive_sumo.scenario.scripted_actor import Actor, LaneMotion, PathMotion, ReplayMotion, StandingMotion

SPACING_M = 0.5
"""Of the knots of a path, beside its own points."""
AXLES = 0.3
"""A vehicle's axles lie this share of its length before and behind its middle; its heading is the chord between."""
TURN_M = 0.2
"""Before a corner, a pedestrian turns on this stretch."""
BLEND_M = 15.0
"""Length over which an actor that starts beside its lane comes onto it; more if it is far off."""
KEEP_M, CHANGE_M = 5.0, 25.0
"""Of a lane change: straight on, then over to the next lane (protocol 3.4)."""
WALK_ON_M = 5000.0
"""How far a pedestrian walks on behind its last point: as good as for ever (protocol 3.5)."""


@dataclass(frozen=True, slots=True)
class Course:
    """Knots (K,), K >= 2, over `at`, which grows strictly."""

    at: Float
    """Arc length [m], or the time [s] of a replay."""
    s: Float
    """Arc length [m]: as `at`, but a replay may stand."""
    x: Float
    y: Float
    yaw: Float
    """[rad], without jumps, so that linear in between is the shortest way."""
    timed: bool = False

    @property
    def line(self) -> Polyline:
        """Where it goes; a replay that never moves has none (ValueError)."""
        return build_polyline(np.column_stack((self.x, self.y)))


def course_of(actor: Actor, roads: RoadMap) -> Course | None:
    """The course of an actor; None for one that only stands. Raises InputError for lanes that do not connect."""
    match actor.motion:
        case StandingMotion():
            return None
        case ReplayMotion(poses=poses):
            return replayed(poses)
        case PathMotion(points=points):
            return along(build_polyline(points), actor)
        case LaneMotion(lanes=lanes):
            return along(_lane_line(lanes, actor.start, roads), actor)


def along(line: Polyline, actor: Actor) -> Course:
    """Along a polyline, with the heading that the kind of the actor has on it."""
    if actor.kind == "pedestrian":
        end = line.at(line.length + WALK_ON_M)
        line = Polyline(np.vstack((line.xy, [end])))
        s = np.union1d(line.s, np.maximum(line.s[1:-1] - TURN_M, 0.0))
        reach = 0.0
    else:
        s = np.union1d(line.s, line.stations(SPACING_M))
        reach = AXLES * actor.length
    x, y = (np.interp(s, line.s, line.xy[:, axis]) for axis in (0, 1))
    return Course(s, s, x, y, _headings(line, s, reach))


def _headings(line: Polyline, s: Float, reach: float) -> Float:
    """Yaw (N,) [rad]: of the segment, or of the chord from `reach` metres behind to as far ahead."""
    if not reach:
        return np.unwrap(line.yaws_at(s))
    chord = _points(line, s + reach) - _points(line, s - reach)
    return np.unwrap(np.arctan2(chord[:, 1], chord[:, 0]))


def _points(line: Polyline, s: Float) -> Float:
    """Points (N, 2) [m] at arc lengths (N,); the end segments are prolonged."""
    i = np.clip(np.searchsorted(line.s, s, side="right") - 1, 0, len(line.yaws) - 1)
    ahead = (s - line.s[i])[:, None]
    return line.xy[i] + ahead * np.column_stack((np.cos(line.yaws[i]), np.sin(line.yaws[i])))


def replayed(poses: Sequence[tuple[float, float, float, float]]) -> Course:
    """Through timed poses (time [s], x, y [m], yaw [rad])."""
    time, x, y, yaw = np.array(poses, dtype=np.float64).T
    s = np.concatenate(((0.0,), np.cumsum(np.hypot(np.diff(x), np.diff(y)))))
    return Course(time, s, x, y, np.unwrap(yaw), timed=True)


def _lane_line(lanes: Sequence[str], start: Pose, roads: RoadMap) -> Polyline:
    """From the start onto the centre lines of lanes and along them to the end of the last."""
    first = roads.lanes[lanes[0]].centre
    s, aside = first.project(start.x, start.y)
    s = min(s, first.length - 0.1)
    line = Polyline(build_lane_route(roads, lanes, s, roads.lanes[lanes[-1]].centre.length).xy)
    gap = np.array((start.x, start.y)) - line.xy[0]
    share = np.clip(1.0 - line.s / max(BLEND_M, 5.0 * abs(aside)), 0.0, 1.0)
    weight = share**2 * (3.0 - 2.0 * share)
    return build_polyline(line.xy + weight[:, None] * gap)


def shifted(course: Course, since: float, aside: float, actor: Actor) -> tuple[Course, float]:
    """The course that leaves `course` behind arc length `since` [m] for its parallel `aside` [m] to the left.

    5 m straight on, 25 m over, then on in parallel (protocol 3.4). Also, where on the new course `since` is.
    """
    first = max(int(np.searchsorted(course.s, since, side="right")) - 1, 0)
    first = min(first, len(course.s) - 2)
    s, x, y, yaw = (column[first:] for column in (course.s, course.x, course.y, course.yaw))
    share = np.clip((s - since - KEEP_M) / CHANGE_M, 0.0, 1.0)
    weight = aside * share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
    line = build_polyline(np.column_stack((x - weight * np.sin(yaw), y + weight * np.cos(yaw))))
    return along(line, actor), since - float(course.s[first])
