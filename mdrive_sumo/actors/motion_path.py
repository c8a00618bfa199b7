"""The path of a scripted actor: knots with linear interpolation in between."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float, Polyline, build_polyline
from mdrive_sumo.roads import RoadMap, build_lane_route
from mdrive_sumo.scenario.scenario_part import Pose
from mdrive_sumo.scenario.scripted_actor import Actor, LaneMotion, PathMotion, ReplayMotion, StandingMotion


@dataclass(frozen=True, slots=True)
class PathParams:
    """Geometry of scripted paths. Assumptions unless a source is given."""

    knot_spacing_m: float = 0.5
    """Distance of the knots that are added between the points of a path."""
    axle_share: float = 0.3
    """A vehicle's axles lie this share of its length before and behind its centre; its heading is their chord."""
    pedestrian_turn_m: float = 0.2
    """Length before a corner over which a pedestrian turns."""
    merge_m: float = 15.0
    """Least length over which an actor that starts beside its lane merges onto it."""
    lane_change_keep_m: float = 5.0
    """Length straight on before a lane change (protocol 3.4)."""
    lane_change_m: float = 25.0
    """Length of a lane change (protocol 3.4)."""
    walk_on_m: float = 5000.0
    """Length by which a pedestrian's path is prolonged, in effect without end (protocol 3.5)."""


PARAMS = PathParams()


@dataclass(frozen=True, slots=True)
class MotionPath:
    """K >= 2 knots; arrays are (K,). `progress` increases strictly."""

    progress: Float
    """Arc length [m]; for a replay the time [s]."""
    s: Float
    """Arc length [m]; constant where a replay stands."""
    x: Float
    y: Float
    yaw: Float
    """[rad], unwrapped, so that linear interpolation turns the shorter way."""
    is_timed: bool = False

    @property
    def line(self) -> Polyline:
        """The path as a build_polyline. Raises ValueError for a replay that never moves."""
        return build_polyline(np.column_stack((self.x, self.y)))


def build_motion_path(actor: Actor, roads: RoadMap) -> MotionPath | None:
    """Return the path of an actor; None for a static one. Raises InputError for lanes that do not connect."""
    match actor.motion:
        case StandingMotion():
            return None
        case ReplayMotion(poses=poses):
            return build_replay_path(poses)
        case PathMotion(points=points):
            return build_path_along(build_polyline(points), actor)
        case LaneMotion(lanes=lanes):
            return build_path_along(_build_lane_line(lanes, actor.start, roads), actor)


def build_path_along(line: Polyline, actor: Actor) -> MotionPath:
    """Return a path along a polyline, with headings as the kind of the actor has them."""
    if actor.kind == "pedestrian":
        end = line.at(line.length + PARAMS.walk_on_m)
        line = Polyline(np.vstack((line.xy, [end])))
        s = np.union1d(line.s, np.maximum(line.s[1:-1] - PARAMS.pedestrian_turn_m, 0.0))
        reach = 0.0
    else:
        s = np.union1d(line.s, line.stations(PARAMS.knot_spacing_m))
        reach = PARAMS.axle_share * actor.length
    x, y = (np.interp(s, line.s, line.xy[:, axis]) for axis in (0, 1))
    return MotionPath(s, s, x, y, _compute_headings(line, s, reach))


def _compute_headings(line: Polyline, s: Float, reach: float) -> Float:
    """Return the yaw (N,) [rad] of the segments, or of the chords from `reach` [m] behind to `reach` ahead."""
    if not reach:
        return np.unwrap(line.yaws_at(s))
    chord = _interpolate_points(line, s + reach) - _interpolate_points(line, s - reach)
    return np.unwrap(portable.atan2(chord[:, 1], chord[:, 0]))


def _interpolate_points(line: Polyline, s: Float) -> Float:
    """Return the points (N, 2) [m] at arc lengths (N,); the end segments are prolonged."""
    i = np.clip(np.searchsorted(line.s, s, side="right") - 1, 0, len(line.yaws) - 1)
    ahead = (s - line.s[i])[:, None]
    return line.xy[i] + ahead * np.column_stack(portable.cos_sin(line.yaws[i]))


def build_replay_path(poses: Sequence[tuple[float, float, float, float]]) -> MotionPath:
    """Return the path through timed poses (time [s], x, y [m], yaw [rad])."""
    time, x, y, yaw = np.array(poses, dtype=np.float64).T
    s = np.concatenate(((0.0,), np.cumsum(portable.hypot(np.diff(x), np.diff(y)))))
    return MotionPath(time, s, x, y, np.unwrap(yaw), is_timed=True)


def _build_lane_line(lanes: Sequence[str], start: Pose, roads: RoadMap) -> Polyline:
    """Return the line from the start onto the centre lines of the lanes, and along them to the end of the last one."""
    first = roads.lanes[lanes[0]].centre
    s, aside = first.project(start.x, start.y)
    s = min(s, first.length - 0.1)
    line = Polyline(build_lane_route(roads, lanes, s, roads.lanes[lanes[-1]].centre.length).xy)
    gap = np.array((start.x, start.y)) - line.xy[0]
    share = np.clip(1.0 - line.s / max(PARAMS.merge_m, 5.0 * abs(aside)), 0.0, 1.0)
    weight = (share * share) * (3.0 - 2.0 * share)
    return build_polyline(line.xy + weight[:, None] * gap)


def build_lane_change_path(path: MotionPath, since: float, aside: float, actor: Actor) -> tuple[MotionPath, float]:
    """Return the path that moves `aside` [m] to the left of `path` after arc length `since` [m], and `since` on it.

    5 m straight on, 25 m across, then parallel (protocol 3.4).
    """
    first = max(int(np.searchsorted(path.s, since, side="right")) - 1, 0)
    first = min(first, len(path.s) - 2)
    s, x, y, yaw = (column[first:] for column in (path.s, path.x, path.y, path.yaw))
    share = np.clip((s - since - PARAMS.lane_change_keep_m) / PARAMS.lane_change_m, 0.0, 1.0)
    weight = aside * (share * share * share) * (10.0 - 15.0 * share + 6.0 * (share * share))
    cos, sin = portable.cos_sin(yaw)
    line = build_polyline(np.column_stack((x - weight * sin, y + weight * cos)))
    return build_path_along(line, actor), since - float(path.s[first])
