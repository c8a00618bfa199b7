"""Estimate the direction of lanes from observed motion, links of the map, touching ends and adjacent lanes.

The vote by motion follows MDrive for the V2XPnP maps, whose polylines do not define the direction of travel
(spec/data_formats 1.3): at least 10 samples, 80 % of them within 30 degrees.
"""

from collections import defaultdict
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import shapely

from mdrive_sumo.core.geometry import Float, Int, Polyline
from real2sim.hd_map import LaneKind, MapLane
from real2sim.network.lane_segment import HEADING_OVER_M, compute_chord_yaw, compute_yaw_difference
from real2sim.polylines import PolylineIndex, compute_angles_between

MIN_SAMPLES = 10
"""Least number of samples of a lane,"""
MIN_AGREEMENT = 0.8
"""least share of them that agree on one direction, and"""
WITHIN_RAD = np.radians(30)
"""largest angle between a sample and the lane: MDrive's vote (data_formats 1.3)."""
MIN_STEP_M = 0.3
"""[m] Shorter steps between frames have no reliable direction."""
VOTE_RANGE_M = 3.0
"""[m] A position votes for lanes within this distance."""
ENDS_MEET_M = 1.5
ENDS_ALIGNED_RAD = np.radians(30)
"""Ends this close [m] and this well aligned continue each other."""
ADJACENT_M = 6.0
"""[m] Centre lines further apart do not lie side by side."""

CLEARLY_NEARER_M = 1.0
"""[m] A position votes for the nearest parallel lane if the next one is this much further away."""
MOTION_WEIGHT = 6
"""Chosen: what vehicles do counts as much as three links, and"""
LINK_WEIGHT = 2
"""a link as much as two continuations, which only say that two ends meet."""
SWEEPS = 10
"""Largest number of sweeps; the relaxation ends as soon as one changes nothing."""


class Continuation(NamedTuple):
    """A lane that continues another one."""

    lane: str
    turn: int
    """+1 if both are drawn in one direction, -1 if one of them must be reversed."""


ContinuationsByLane = Mapping[str, Sequence[Continuation]]
"""The continuations of each lane."""


@dataclass(frozen=True)
class LaneDirections:
    """Lanes to reverse, lanes without any evidence (kept as drawn), and votes by motion."""

    inverted: tuple[str, ...]
    undecided: tuple[str, ...]
    votes: Mapping[str, int]
    """+1 or -1 relative to the drawn direction, for lanes with enough observed motion."""


def vote_directions(lanes: Mapping[str, MapLane], motions: Sequence[Float]) -> LaneDirections:
    """Estimate the directions of all lanes. `directed` lanes are reversed only if both motion and links say so.

    Each lane weighs its own evidence (`MOTION_WEIGHT`, `LINK_WEIGHT` per link) against that of its continuations;
    directions propagate from the lanes with the strongest evidence and are then relaxed (iterated conditional modes).
    """
    motion_votes, link_votes = vote_by_motion(lanes, motions), _vote_by_links(lanes)
    around = _find_continuations(lanes)
    fixed = {
        id_: -1 if motion_votes.get(id_) == -1 and link_votes.get(id_, 0) < 0 else 1
        for id_, lane in lanes.items()
        if lane.directed
    }
    evidence = {id_: MOTION_WEIGHT * motion_votes.get(id_, 0) + LINK_WEIGHT * link_votes.get(id_, 0) for id_ in lanes}
    sign = fixed | {id_: 1 if score > 0 else -1 for id_, score in evidence.items() if score and id_ not in fixed}
    _propagate(sign, around)
    undecided = _decide_by_majority(sign, lanes, around)
    _relax(sign, evidence, around, fixed)
    undecided -= _decide_by_neighbours(sign, lanes, undecided)
    inverted = tuple(id_ for id_ in lanes if sign[id_] < 0)
    return LaneDirections(inverted, tuple(sorted(undecided)), motion_votes)


def reverse_lane(lane: MapLane) -> MapLane:
    """Return the lane drawn in the opposite direction."""
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
        if len(angles) >= MIN_SAMPLES and max(shares) >= MIN_AGREEMENT:
            votes[ids[i]] = 1 if shares[0] > shares[1] else -1
    return votes


def extract_moving_steps(motions: Sequence[Float]) -> tuple[Float, Float]:
    """Return positions (M, 2) [m] and directions (M,) [rad] of steps of at least `MIN_STEP_M`."""
    xy, yaw = [np.zeros((0, 2))], [np.zeros(0)]
    for motion in motions:
        step = np.diff(motion[:, :2], axis=0)
        far = np.hypot(step[:, 0], step[:, 1]) >= MIN_STEP_M  # NaN compares false
        xy.append(((motion[1:, :2] + motion[:-1, :2]) / 2)[far])
        yaw.append(np.arctan2(step[far, 1], step[far, 0]))
    return np.concatenate(xy), np.concatenate(yaw)


def _assign_to_lanes(lines: Sequence[Polyline], xy: Float, yaw: Float) -> tuple[Int, Float]:
    """Return the nearest parallel lane of each point that has one, and the angle between them [rad].

    Many lanes are near inside junctions; motion across a lane is no vote for it.
    """
    feet = PolylineIndex(lines).project_points(xy, VOTE_RANGE_M)
    turn = compute_angles_between(feet.yaw, yaw[feet.point])
    rows = np.flatnonzero(np.minimum(turn, np.pi - turn) <= WITHIN_RAD)
    rows = rows[np.lexsort((feet.line[rows], feet.distance[rows], feet.point[rows]))]
    _, begin, count = np.unique(feet.point[rows], return_index=True, return_counts=True)
    first, second = rows[begin], rows[np.minimum(begin + 1, len(rows) - 1)]
    clear = (count == 1) | (feet.distance[second] - feet.distance[first] >= CLEARLY_NEARER_M)
    return feet.line[first[clear]], turn[first[clear]]


def _compute_outward_end(lane: MapLane, side: int) -> tuple[Float, float]:
    """Return an end of a lane (0 first, 1 last point) and the outward direction [rad] there."""
    line = Polyline(lane.centre)
    if side:
        return lane.centre[-1], compute_chord_yaw(line, line.length - HEADING_OVER_M, line.length)
    return lane.centre[0], compute_chord_yaw(line, 0.0, HEADING_OVER_M) + np.pi


def _find_continuations(lanes: Mapping[str, MapLane]) -> ContinuationsByLane:
    """Return the lanes whose ends meet those of each lane in one direction."""
    ends = [(id_, side, *_compute_outward_end(lane, side)) for id_, lane in lanes.items() for side in (0, 1)]
    points: Any = shapely.points(np.array([end[2] for end in ends]))
    around: defaultdict[str, list[Continuation]] = defaultdict(list)
    for i, j in zip(*shapely.STRtree(points).query(points, predicate="dwithin", distance=ENDS_MEET_M), strict=True):
        (a, a_side, _, a_yaw), (b, b_side, _, b_yaw) = ends[i], ends[j]
        if (
            i < j
            and a != b
            and lanes[a].kind is lanes[b].kind
            and compute_yaw_difference(a_yaw, b_yaw + np.pi) <= ENDS_ALIGNED_RAD
        ):
            turn = 1 if a_side != b_side else -1
            around[a].append(Continuation(b, turn))
            around[b].append(Continuation(a, turn))
    return around


def _vote_by_links(lanes: Mapping[str, MapLane]) -> dict[str, int]:
    """Return the sum of link votes of each lane: positive as drawn, negative reversed."""
    votes: defaultdict[str, int] = defaultdict(int)
    links = {(a, b) for a, lane in lanes.items() for b in lane.exits if b in lanes}
    links |= {(b, a) for a, lane in lanes.items() for b in lane.entries if b in lanes}
    for a, b in links:
        gap = {(i, j): float(np.hypot(*(lanes[a].centre[-i] - lanes[b].centre[-j]))) for i in (0, 1) for j in (0, 1)}
        i, j = min(gap, key=lambda pair: gap[pair])
        if gap[i, j] <= ENDS_MEET_M:
            votes[a] += 1 if i else -1
            votes[b] += -1 if j else 1
    return votes


def _propagate(sign: dict[str, int], around: ContinuationsByLane) -> None:
    """Propagate directions from decided lanes to their continuations, round by round, by majority."""
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


def _relax(
    sign: dict[str, int], evidence: Mapping[str, int], around: ContinuationsByLane, fixed: Collection[str]
) -> None:
    """Reverse lanes while their own evidence and their continuations outvote them."""
    for _ in range(SWEEPS):
        changed = False
        for id_ in sign:
            score = evidence[id_] + sum(turn * sign[other] for other, turn in around.get(id_, ()))
            if score * sign[id_] < 0 and id_ not in fixed:
                sign[id_], changed = -sign[id_], True
        if not changed:
            return


def _decide_by_majority(sign: dict[str, int], lanes: Mapping[str, MapLane], around: ContinuationsByLane) -> set[str]:
    """Give chains of lanes without evidence the direction in which most of them are drawn.

    Returns single lanes and ties, which stay undecided.
    """
    undecided: set[str] = set()
    for id_ in lanes:
        if id_ in sign:
            continue
        chain = {id_: 1}
        _propagate(chain, {lane_id: others for lane_id, others in around.items() if lane_id not in sign})
        drawn = sum(chain.values())
        if len(chain) == 1 or not drawn:
            undecided |= set(chain)
        sign.update({lane_id: turn if drawn >= 0 else -turn for lane_id, turn in chain.items()})
    return undecided


def _decide_by_neighbours(sign: dict[str, int], lanes: Mapping[str, MapLane], undecided: set[str]) -> set[str]:
    """Give undecided lanes the direction of a decided adjacent lane that the map names as neighbour or group member."""
    done: set[str] = set()
    for id_ in sorted(undecided):
        lane = lanes[id_]
        named = (lane.left_neighbour, lane.right_neighbour)
        for other_id, other in lanes.items():
            is_neighbour = other_id in named or (lane.group and other.group == lane.group)
            if (
                is_neighbour
                and other_id not in undecided
                and other_id != id_
                and (turn := _compare_adjacent(lane, other))
            ):
                sign[id_] = turn * sign[other_id]
                done.add(id_)
                break
    return done


def _compare_adjacent(lane: MapLane, other: MapLane) -> int:
    """Return +1 or -1 if the other lane is adjacent in the same or opposite drawn direction, else 0."""
    line, beside = Polyline(lane.centre), Polyline(other.centre)
    middle = line.at(line.length / 2)
    s, d = beside.project(*middle)
    turn = compute_yaw_difference(line.yaw_at(line.length / 2), beside.yaw_at(s))
    if abs(d) > ADJACENT_M or min(turn, np.pi - turn) > WITHIN_RAD:
        return 0
    return 1 if turn < np.pi / 2 else -1
