"""What streams touch on their whole way: what stands, buildings, and road users of other streams at the same time.

Members of a stream keep their course and their speed, so this is known when a scenario is built.
"""

from collections.abc import Iterator, Sequence
from itertools import chain, combinations, groupby

import numpy as np
import numpy.typing as npt
import shapely

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float, boxes_corners
from mdrive_sumo.core.state import DT
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.scripted_actor import Actor, ReplayMotion, StandingMotion
from mdrive_sumo.scenario.start_boxes import build_user_box

SWEEP_M = 0.5
"""[m] Between the places of a box that is swept along a course: 3 mm of a bend of 10 m lie outside the boxes."""
LEAST_M = 0.1
"""[m] Boxes of a stream keep at least this distance from everything: a hand."""


def find_stream_contacts(scenario: Scenario, roads: RoadMap) -> Iterator[str]:
    """Yield what the road users of streams come nearer to than `LEAST_M`, one sentence each."""
    moving = [one for one in scenario.actors if one.stream]
    standing = [one for one in scenario.actors if isinstance(one.motion, StandingMotion)]
    if not moving:
        return
    names = [*(one.id for one in standing), *(one.id for one in roads.buildings)]
    tree = shapely.STRtree([*map(build_user_box, standing), *roads.building_shapes])
    streams = [tuple(members) for _, members in groupby(moving, key=lambda one: one.stream)]
    longest_of = [max(members, key=lambda one: _build_course(one).length) for members in streams]
    for longest in longest_of:  # the others ride parts of its course
        for met in tree.query(_sweep(longest), predicate="dwithin", distance=LEAST_M)[1][:1].tolist():
            yield f"expected {longest.id} to keep {LEAST_M:g} m from everything on its way, found {names[met]} there"
    for (some, one), (others, other) in combinations(zip(streams, longest_of, strict=True), 2):
        reach_m = (portable.hypot(one.length, one.width) + portable.hypot(other.length, other.width)) / 2 + LEAST_M
        if _build_course(one).distance(_build_course(other)) < reach_m:
            yield from _find_meetings(some, others, reach_m)


def _get_poses(member: Actor) -> Float:
    """Return the rows (N, 4) of a course: time [s], x, y [m] and direction [rad] without jumps."""
    assert isinstance(member.motion, ReplayMotion)
    poses = np.array(member.motion.poses)
    poses[:, 3] = np.unwrap(poses[:, 3])
    return poses


def _build_boxes(member: Actor, times: Float) -> Float:
    """Return the corners (T, 4, 2) [m] of a road user at times (T,) [s], NaN while it is not there."""
    poses = _get_poses(member)
    x, y, yaw = (np.interp(times, poses[:, 0], poses[:, k]) for k in (1, 2, 3))
    is_there = (times >= poses[0, 0]) & (times <= poses[-1, 0])
    size = np.array(member.length), np.array(member.width)
    return np.where(is_there[:, None, None], boxes_corners(x, y, yaw, *size), np.nan)


def _build_course(member: Actor) -> shapely.LineString:
    return shapely.LineString(_get_poses(member)[:, 1:3])


def _sweep(member: Actor) -> npt.NDArray[np.object_]:
    """Return the box of a road user at places of its course, `SWEEP_M` apart."""
    poses = _get_poses(member)
    along = np.concatenate(((0.0,), np.cumsum(portable.hypot(*np.diff(poses[:, 1:3], axis=0).T))))
    stations = np.linspace(0.0, along[-1], int(along[-1] / SWEEP_M) + 2)
    return np.asarray(shapely.polygons(_build_boxes(member, np.interp(stations, along, poses[:, 0]))))


def _find_meetings(some: Sequence[Actor], others: Sequence[Actor], reach_m: float) -> Iterator[str]:
    """Yield which two road users of two streams come too near to each other, one sentence for the first pair.

    reach_m: between middles [m] that are farther apart no boxes are too near.
    """
    last_s = max(_get_poses(one)[-1, 0] for one in chain(some, others))
    times = np.arange(0.0, last_s, DT)
    boxes = {one.id: _build_boxes(one, times) for one in chain(some, others)}
    middles = {name: corners.mean(axis=1) for name, corners in boxes.items()}
    for one in some:
        for other in others:
            near = portable.hypot(*(middles[one.id] - middles[other.id]).T) < reach_m
            mine, its = (np.asarray(shapely.polygons(boxes[member.id][near])) for member in (one, other))
            away = np.asarray(shapely.distance(mine, its))
            if len(away) and away.min() < LEAST_M:
                at_s = float(times[near][int(away.argmin())])
                found = f"found {away.min():.2f} m at {at_s:.1f} s"
                yield f"expected {one.id} to keep {LEAST_M:g} m from {other.id}, {found}"
                return
