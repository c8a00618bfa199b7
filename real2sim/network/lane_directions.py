"""Which way lanes run: votes of observed motion, of the map's links, of ends that meet and of lanes beside.

The vote of motion follows what MDrive does for the V2XPnP maps, whose polylines do not tell the direction of travel
(spec/data_formats 1.3): at least 10 samples, 80 % of them within 30 degrees.
"""

from collections import defaultdict
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import shapely

from mdrive_sumo.core.geometry import Float, Int, Polyline
from real2sim.hd_map import LaneKind, MapLane
from real2sim.network.lane_segment import HEADING_OVER_M, compute_chord_yaw, compute_yaw_difference
from real2sim.polylines import PolylineIndex, compute_angles_between

SAMPLES = 10
AGREEMENT = 0.8
WITHIN_RAD = np.radians(30)
STEP_M = 0.3
"""Shorter steps between frames say nothing about the direction of travel."""
NEAR_M = 3.0
TOUCH_M = 1.5
TOUCH_RAD = np.radians(30)
ADJACENT_M = 6.0

CLEAR_M = 1.0
"""A position votes for the nearest lane along its motion, if the next one is this much further away."""
MOTION_WEIGHT = 6
LINK_WEIGHT = 2
SWEEPS = 10

ContinuationsByLane = Mapping[str, Sequence[tuple[str, int]]]
"""What each lane touches, as in `LaneContinuation`."""
LaneContinuation = tuple[str, str, int]
"""Two lanes that continue each other: +1 as drawn, -1 if one of them must be turned round for it."""


@dataclass(frozen=True)
class LaneDirections:
    """Lanes that must be turned round, those whose direction nothing tells (left as drawn), and votes of motion."""

    inverted: tuple[str, ...]
    undecided: tuple[str, ...]
    voted: Mapping[str, int]
    """+1 or -1 against the drawn direction, of lanes with enough observed motion."""


def vote_directions(lanes: Mapping[str, MapLane], motions: Sequence[Float]) -> LaneDirections:
    """Directions of all lanes. Those that are `directed` turn round only if motion and links both say so.

    Every lane weighs what motion and links say about it (`MOTION_WEIGHT`, `LINK_WEIGHT` a link) against what the lanes
    that continue it have; directions spread from the lanes that know most, then settle (iterated conditional modes).
    """
    voted, told, around = (
        vote_by_motion(lanes, motions),
        _vote_by_links(lanes),
        _group_by_lane(_find_continuations(lanes)),
    )
    fixed = {
        id_: -1 if voted.get(id_) == -1 and told.get(id_, 0) < 0 else 1 for id_, lane in lanes.items() if lane.directed
    }
    known = {id_: MOTION_WEIGHT * voted.get(id_, 0) + LINK_WEIGHT * told.get(id_, 0) for id_ in lanes}
    sign = fixed | {id_: 1 if score > 0 else -1 for id_, score in known.items() if score and id_ not in fixed}
    _propagate(sign, around)
    undecided = _decide_by_majority(sign, lanes, around)
    _relax(sign, known, around, fixed)
    undecided -= _decide_by_neighbours(sign, lanes, undecided)
    inverted = tuple(id_ for id_ in lanes if sign[id_] < 0)
    return LaneDirections(inverted, tuple(sorted(undecided)), voted)


def reverse_lane(lane: MapLane) -> MapLane:
    """The same lane drawn the other way round."""
    return replace(
        lane,
        centre=lane.centre[::-1],
        left=lane.right[::-1],
        right=lane.left[::-1],
        left_neighbour=lane.right_neighbour,
        right_neighbour=lane.left_neighbour,
    )


def vote_by_motion(lanes: Mapping[str, MapLane], motions: Sequence[Float]) -> dict[str, int]:
    """Return +1 (as drawn) or -1 for lanes with enough samples that agree on one direction."""
    ids = [id_ for id_, lane in lanes.items() if lane.kind is LaneKind.DRIVING]
    xy, yaw = extract_moving_steps(motions)
    if not ids or not len(xy):
        return {}
    lane, turn = _assign_to_lanes([Polyline(lanes[id_].centre) for id_ in ids], xy, yaw)
    votes: dict[str, int] = {}
    for i in np.unique(lane):
        angles = turn[lane == i]
        shares = ((angles <= WITHIN_RAD).mean(), (angles >= np.pi - WITHIN_RAD).mean())
        if len(angles) >= SAMPLES and max(shares) >= AGREEMENT:
            votes[ids[i]] = 1 if shares[0] > shares[1] else -1
    return votes


def extract_moving_steps(motions: Sequence[Float]) -> tuple[Float, Float]:
    """Positions (M, 2) [m] and directions of motion (M,) [rad] of steps of at least `STEP_M`."""
    xy, yaw = [np.zeros((0, 2))], [np.zeros(0)]
    for motion in motions:
        step = np.diff(motion[:, :2], axis=0)
        far = np.hypot(step[:, 0], step[:, 1]) >= STEP_M  # NaN compares false
        xy.append(((motion[1:, :2] + motion[:-1, :2]) / 2)[far])
        yaw.append(np.arctan2(step[far, 1], step[far, 0]))
    return np.concatenate(xy), np.concatenate(yaw)


def _assign_to_lanes(lines: Sequence[Polyline], xy: Float, yaw: Float) -> tuple[Int, Float]:
    """Nearest lane of each point that has one, of those that run along its motion, and the angle between them [rad].

    Across junctions many lanes are near; motion across a lane is no vote on it.
    """
    feet = PolylineIndex(lines).feet(xy, NEAR_M)
    turn = compute_angles_between(feet.yaw, yaw[feet.point])
    rows = np.flatnonzero(np.minimum(turn, np.pi - turn) <= WITHIN_RAD)
    rows = rows[np.lexsort((feet.line[rows], feet.distance[rows], feet.point[rows]))]
    _, begin, count = np.unique(feet.point[rows], return_index=True, return_counts=True)
    first, second = rows[begin], rows[np.minimum(begin + 1, len(rows) - 1)]
    clear = (count == 1) | (feet.distance[second] - feet.distance[first] >= CLEAR_M)
    return feet.line[first[clear]], turn[first[clear]]


def _compute_outward_end(lane: MapLane, side: int) -> tuple[Float, float]:
    """An end of a lane (0 first, 1 last point) and the direction [rad] in which it leaves the lane there."""
    line = Polyline(lane.centre)
    if side:
        return lane.centre[-1], compute_chord_yaw(line, line.length - HEADING_OVER_M, line.length)
    return lane.centre[0], compute_chord_yaw(line, 0.0, HEADING_OVER_M) + np.pi


def _find_continuations(lanes: Mapping[str, MapLane]) -> list[LaneContinuation]:
    ends = [(id_, side, *_compute_outward_end(lane, side)) for id_, lane in lanes.items() for side in (0, 1)]
    points: Any = shapely.points(np.array([end[2] for end in ends]))
    found: list[LaneContinuation] = []
    for i, j in zip(*shapely.STRtree(points).query(points, predicate="dwithin", distance=TOUCH_M), strict=True):
        (a, a_side, _, a_yaw), (b, b_side, _, b_yaw) = ends[i], ends[j]
        if (
            i < j
            and a != b
            and lanes[a].kind is lanes[b].kind
            and compute_yaw_difference(a_yaw, b_yaw + np.pi) <= TOUCH_RAD
        ):
            found.append((a, b, 1 if a_side != b_side else -1))
    return found


def _vote_by_links(lanes: Mapping[str, MapLane]) -> dict[str, int]:
    """Sum of what the map's links say about each lane: positive as drawn, negative turned round."""
    votes: defaultdict[str, int] = defaultdict(int)
    links = {(a, b) for a, lane in lanes.items() for b in lane.exits if b in lanes}
    links |= {(b, a) for a, lane in lanes.items() for b in lane.entries if b in lanes}
    for a, b in links:
        gap = {(i, j): float(np.hypot(*(lanes[a].centre[-i] - lanes[b].centre[-j]))) for i in (0, 1) for j in (0, 1)}
        i, j = min(gap, key=lambda pair: gap[pair])
        if gap[i, j] <= TOUCH_M:
            votes[a] += 1 if i else -1
            votes[b] += -1 if j else 1
    return votes


def _propagate(sign: dict[str, int], around: ContinuationsByLane) -> None:
    """Lanes take the direction that continues decided ones, round by round, by the majority of those they touch."""
    while True:
        votes = {
            id_: sum(turn * sign[other] for other, turn in others if other in sign)
            for id_, others in around.items()
            if id_ not in sign
        }
        fresh = {id_: 1 if vote > 0 else -1 for id_, vote in votes.items() if vote}
        if not fresh:
            return
        sign.update(fresh)


def _relax(sign: dict[str, int], known: Mapping[str, int], around: ContinuationsByLane, fixed: Collection[str]) -> None:
    """Lanes turn round while what they know and what they touch outvotes them."""
    for _ in range(SWEEPS):
        changed = False
        for id_ in sign:
            score = known[id_] + sum(turn * sign[other] for other, turn in around.get(id_, ()))
            if score * sign[id_] < 0 and id_ not in fixed:
                sign[id_], changed = -sign[id_], True
        if not changed:
            return


def _group_by_lane(touches: Iterable[LaneContinuation]) -> ContinuationsByLane:
    around: defaultdict[str, list[tuple[str, int]]] = defaultdict(list)
    for a, b, turn in touches:
        around[a].append((b, turn))
        around[b].append((a, turn))
    return around


def _decide_by_majority(sign: dict[str, int], lanes: Mapping[str, MapLane], around: ContinuationsByLane) -> set[str]:
    """Chains of lanes that nothing is known of take the direction in which most of them are drawn.

    Returns those for which nothing but the drawing of a single lane, or a tie, speaks.
    """
    undecided: set[str] = set()
    for id_ in lanes:
        if id_ in sign:
            continue
        chain = {id_: 1}
        _propagate(chain, {one: others for one, others in around.items() if one not in sign})
        drawn = sum(chain.values())
        if len(chain) == 1 or not drawn:
            undecided |= set(chain)
        sign.update({one: turn if drawn >= 0 else -turn for one, turn in chain.items()})
    return undecided


def _decide_by_neighbours(sign: dict[str, int], lanes: Mapping[str, MapLane], undecided: set[str]) -> set[str]:
    """Undecided lanes take the direction of a decided one beside them that the map calls their neighbour or group."""
    done: set[str] = set()
    for id_ in sorted(undecided):
        lane = lanes[id_]
        named = (lane.left_neighbour, lane.right_neighbour)
        for other_id, other in lanes.items():
            known = other_id in named or (lane.group and other.group == lane.group)
            if known and other_id not in undecided and other_id != id_ and (turn := _compare_adjacent(lane, other)):
                sign[id_] = turn * sign[other_id]
                done.add(id_)
                break
    return done


def _compare_adjacent(lane: MapLane, other: MapLane) -> int:
    """+1 or -1 if the other lane runs beside in the same or the opposite drawn direction, 0 if it does not."""
    line, beside = Polyline(lane.centre), Polyline(other.centre)
    middle = line.at(line.length / 2)
    s, d = beside.project(*middle)
    turn = compute_yaw_difference(line.yaw_at(line.length / 2), beside.yaw_at(s))
    if abs(d) > ADJACENT_M or min(turn, np.pi - turn) > WITHIN_RAD:
        return 0
    return 1 if turn < np.pi / 2 else -1
