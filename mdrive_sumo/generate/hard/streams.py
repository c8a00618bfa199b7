"""Streams: groups of road users that pass a place one behind the other and keep their course, then leave a pause.

One hidden road user is timed for one speed of a CAV: a slower or faster one misses it. A stream that passes closely
behind what hides it meets every driver who does not know of it, at whatever speed; who knows waits for the pause.
Motorcycles that filter past a queue, pedelecs on a cycle lane and buses on a bus lane come like that: in groups, from
one green of a signal upstream to the next.
"""

from dataclasses import dataclass

import numpy as np
import shapely

from mdrive_sumo.core.geometry import Float, Polyline
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scripted_actor import Actor, ReplayMotion
from mdrive_sumo.worlds.placement.bodies import BODIES, build_actor
from mdrive_sumo.worlds.placement.lane_chains import Lanes, build_pose, compute_chain_length, compute_pose

STEP_M = 2.0
"""[m] Between the points of a course before those on straight lines are left out, ..."""
STRAIGHT_M = 0.02
"""[m] ... which are those that lie so close to the line through others."""
RIM_M = 1.0
"""[m] From the ends of the lanes to the boxes of those that appear and leave there."""
SHORTEST_S = 1.0
"""[s] One that would be there for less time is left out."""


@dataclass(frozen=True, slots=True)
class RoadUserStream:
    """Road users of one model along a chain of lanes, in equal groups with pauses between them.

    They brake for nothing, and seeds move all by the same time, so they keep their distances.
    """

    lanes: Lanes
    at_m: float
    """Station [m] at which they are due."""
    offset_m: float
    """[m] Of their centre line to the left of the lanes; negative: to the right."""
    model: str
    """Of `BODIES`."""
    speed: float
    """[m/s]"""
    first_s: float
    """[s] When the first one is due; below 0 for a stream that flows at the start."""
    headway_s: float
    """[s] From one to the next in a group, centre to centre."""
    count: int
    """Road users in a group."""
    pause_s: float
    """[s] From the last one of a group to the first one of the next."""
    groups: int = 2
    begin_m: float = 0.0
    """Station [m] from which they come; nearer ones appear there, so it must be far away or hidden."""
    beyond_m: float = 60.0
    """[m] From `at_m` to where they leave, at most."""

    def list_due_s(self) -> tuple[float, ...]:
        """Return when each is due [s]."""
        period_s = (self.count - 1) * self.headway_s + self.pause_s
        return tuple(
            self.first_s + group * period_s + number * self.headway_s
            for group in range(self.groups)
            for number in range(self.count)
        )


def build_stream(roads: RoadMap, name: str, stream: RoadUserStream) -> tuple[Actor, ...]:
    """Return the road users of a stream, with ids NAME0, NAME1, ... in their order.

    Those that are on their way at the start begin there; later ones appear where the stream begins.
    """
    body = BODIES[stream.model]
    stations = _choose_stations(roads, stream, body.length / 2 + RIM_M)
    poses = [compute_pose(roads, stream.lanes, station, stream.offset_m) for station in stations]
    course = Polyline(np.array([(pose.x, pose.y) for pose in poses]))
    met = compute_pose(roads, stream.lanes, stream.at_m, stream.offset_m)
    after_s = (course.s - course.project(met.x, met.y)[0]) / stream.speed
    turns = np.unwrap([pose.yaw for pose in poses])
    motions = [_build_motion(course, turns, due_s + after_s) for due_s in stream.list_due_s()]
    return tuple(
        build_actor(f"{name}{k}", body, build_pose(*motion.poses[0][1:]), motion=motion, avoid_collision=False)
        for k, motion in enumerate(motion for motion in motions if motion is not None)
    )


def _build_motion(course: Polyline, turns: Float, times: Float) -> ReplayMotion | None:
    """Return the motion of one that is at the points of a course at times [s]; None if it has left soon after 0 s."""
    begin_s = max(0.0, float(times[0]))
    if times[-1] < begin_s + SHORTEST_S:
        return None
    kept = np.concatenate(((begin_s,), times[times > begin_s + SHORTEST_S / 10]))
    along = np.interp(kept, times, course.s)
    places = [(*course.at(s), yaw) for s, yaw in zip(along.tolist(), np.interp(along, course.s, turns), strict=True)]
    return ReplayMotion(
        poses=tuple(
            (round(at_s, 3), round(x, 3), round(y, 3), round(float(yaw), 4))
            for at_s, (x, y, yaw) in zip(kept.tolist(), places, strict=True)
        )
    )


def _choose_stations(roads: RoadMap, stream: RoadUserStream, rim_m: float) -> list[float]:
    """Return the stations [m] between which the course of a stream is straight."""
    end_m = min(stream.at_m + stream.beyond_m, compute_chain_length(roads, stream.lanes) - rim_m)
    stations = np.append(np.arange(max(stream.begin_m, rim_m), end_m - STEP_M / 2, STEP_M), end_m).tolist()
    poses = [compute_pose(roads, stream.lanes, station, stream.offset_m) for station in stations]
    points = [(pose.x, pose.y) for pose in poses]
    kept = set(shapely.LineString(points).simplify(STRAIGHT_M).coords)
    return [station for station, point in zip(stations, points, strict=True) if point in kept]
