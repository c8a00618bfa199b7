"""Match whole tracks to lanes: a hidden Markov model over lanes and their connections, solved by Viterbi.

Method: Newson and Krumm, Hidden Markov Map Matching Through Noise and Sparseness, ACM GIS 2009, with the heading as
additional evidence and lane changes as transitions. Emission costs depend on lateral distance and heading, transition
costs on the difference between the distance along the network and the driven distance.
"""

from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np

from mdrive_sumo.core.geometry import Bool, Float, Int
from mdrive_sumo.roads import RoadMap
from real2sim.match.lane_candidates import LaneCandidateIndex, LaneCandidates, LanePath, load_candidate_index
from real2sim.match.lane_chain import find_best_chain
from real2sim.match.route_repair import find_route_on_map, resolve_connector_changes

CANDIDATE_RANGE_M = 4.0
"""[m] Lanes further away are no candidates: an object beyond a lane's width is off the road."""
MAX_TURN_RAD = np.radians(75)
"""A lane at a larger angle to the vehicle is crossed, not driven on."""
KEY_FRAME_M = 2.0
"""[m] Distance between key frames."""
STILL_M = 2.0
"""[m] Tracks that spend nine tenths of their frames in a square of this size do not drive."""
ROADSIDE_OFFSET_M = 1.5
"""[m] An object this far from every centre line does not stand in a lane."""
MIN_ON_LANE_SHARE = 0.5
"""Tracks with a lane in less than this share of their frames are off the road."""
ASIDE_M = 1.2
"""[m] A track that is nowhere further from its lanes stays in them: it changes between no connectors."""
MIN_COVERED_SHARE = 0.9
"""A route has to be within reach in this share of the frames that are near lanes."""
MOTION_YAW_M = 0.25
"""[m] Over at least this distance between frames the direction of motion replaces the yaw of the box."""


@dataclass(frozen=True)
class LaneMatch:
    """A track on the network. Arrays are (N,), one row per frame of the track."""

    lanes: tuple[str, ...]
    """Lane of each frame; "" where there is none or the track is not valid."""
    s: Float
    """Arc length [m] on that lane; NaN where there is none."""
    offset: Float
    """Lateral distance [m] to its centre line, positive to the left; NaN where there is none."""
    route: tuple[str, ...]
    """Lanes in order, each a successor or neighbour of the previous one: the longest stretch without a break."""
    is_off_road: bool
    """Whether the track stays where it is: parked beside the road, or never on it."""
    reason: str
    """Why the track is off the road, or why the route does not cover it; "" if it does."""
    break_frames: tuple[int, ...] = ()
    """Frames that cannot be reached from the lane before."""
    aside_frames: tuple[int, ...] = ()
    """Frames on another connector than the one of the route, before or after a change between them."""
    first_lane_width: float = 0.0
    """Width [m] of the lane of the first frame that has one."""


def match_track(track: Float, roads: RoadMap) -> LaneMatch:
    """Match x, y, yaw (N, 3) [m, rad] of a vehicle to lanes of a network; rows are NaN where it is not observed."""
    seen = np.flatnonzero(np.isfinite(track[:, :2]).all(1))
    if not len(seen):
        return _build_unmatched(len(track), "never seen")
    index = load_candidate_index(roads)
    xy = track[seen, :2]
    around = index.find_candidates(xy, _compute_headings(track[seen]), CANDIDATE_RANGE_M)
    near = _take_candidates(around, ~(np.abs(around.turn) > MAX_TURN_RAD))  # unknown directions are kept
    if why := _find_off_road_reason(around, near, xy):
        return _build_unmatched(len(track), why)
    keys = _select_key_frames(xy, np.unique(near.point))
    rows, hops = find_best_chain(index, near, keys, xy)
    aside: Int = np.zeros(0, dtype=np.int64)
    if hops.count(None) or np.abs(near.offset[rows]).max() > ASIDE_M:
        unchanged = near, rows, hops, aside
        near, rows, hops, aside = _follow_connector_change(roads, near, keys, xy) or unchanged
    match = _cut_at_border(_assemble_match(index, track, seen, near, rows, hops), roads)
    return replace(match, aside_frames=tuple(int(frame) for frame in seen[aside]))


def _cut_at_border(match: LaneMatch, roads: RoadMap) -> LaneMatch:
    """Return the match without the ends of its route beyond the map's border, beside whose lanes the track drives."""
    route, beyond = find_route_on_map(roads, match.route, match.lanes, match.offset)
    if not beyond:
        return match
    s, offset = match.s.copy(), match.offset.copy()
    s[list(beyond)] = offset[list(beyond)] = np.nan
    lanes = tuple("" if frame in beyond else lane for frame, lane in enumerate(match.lanes))
    return replace(match, route=route, lanes=lanes, s=s, offset=offset)


def _follow_connector_change(
    roads: RoadMap, near: LaneCandidates, keys: list[int], xy: Float
) -> tuple[LaneCandidates, list[int], list[LanePath | None], Int] | None:
    """Return candidates, rows, paths, and the points on another connector than the route's, of a track that changes
    between connectors at the entry or exit of a junction.

    None if it does not: if the cheapest chain without such a change is as good, or no other route covers the track.
    """
    relaxed = load_candidate_index(roads, changes_connectors=True)
    rows, hops = find_best_chain(relaxed, near, keys, xy)
    if None in hops:
        return None
    driven = [roads.driving[near.lane[row]].id for row in rows]
    lanes = [lane for hop in hops if hop is not None for lane in hop.lanes]
    route = resolve_connector_changes(relaxed, [lane for lane, _ in groupby(lanes)])
    if route is None:
        return None
    kept = np.isin(near.lane, [k for k, lane in enumerate(roads.driving) if lane.id in route])
    on_route = _take_candidates(near, kept)
    if len(np.unique(on_route.point)) < MIN_COVERED_SHARE * len(np.unique(near.point)):
        return None
    rows, hops = find_best_chain(
        load_candidate_index(roads), on_route, _select_key_frames(xy, np.unique(on_route.point)), xy
    )
    if None in hops:
        return None
    other = [k for k, lane in enumerate(driven) if lane not in route]
    aside = np.arange(keys[other[0]], keys[other[-1]] + 1) if other else np.zeros(0, dtype=np.int64)
    return on_route, rows, hops, aside


def _build_unmatched(frames: int, why: str) -> LaneMatch:
    unknown = np.full(frames, np.nan)
    return LaneMatch(("",) * frames, unknown, unknown.copy(), (), True, why)


def _compute_headings(track: Float) -> Float:
    """Return the direction of motion (N,) [rad] while moving, else the yaw of the box (NaN: unknown)."""
    ahead = np.roll(track[:, :2], -1, axis=0)
    behind = np.roll(track[:, :2], 1, axis=0)
    ahead[-1], behind[0] = track[-1, :2], track[0, :2]
    step = ahead - behind
    moving = np.hypot(step[:, 0], step[:, 1]) >= 2 * MOTION_YAW_M
    return np.where(moving, np.arctan2(step[:, 1], step[:, 0]), track[:, 2])


def _take_candidates(near: LaneCandidates, kept: Bool) -> LaneCandidates:
    return LaneCandidates(near.point[kept], near.lane[kept], near.s[kept], near.offset[kept], near.turn[kept])


def _find_off_road_reason(around: LaneCandidates, near: LaneCandidates, xy: Float) -> str:
    """Return why the track is off the road, or "". `near` are those of the lanes `around` that run its way."""
    still = bool(np.ptp(np.percentile(xy, (5, 95), axis=0), axis=0).max() < STILL_M)
    doing = "parked" if still else "drives"
    missing = 1 - len(np.unique(near.point)) / len(xy)
    if missing > 1 - MIN_ON_LANE_SHARE:
        if 1 - len(np.unique(around.point)) / len(xy) > 1 - MIN_ON_LANE_SHARE:
            return f"{doing} off the road: {missing:.0%} of frames over {CANDIDATE_RANGE_M:g} m from any lane"
        nearby = f"none within {CANDIDATE_RANGE_M:g} m runs its way"
        return f"{doing} across or against the lanes: in {missing:.0%} of frames {nearby}"
    nearest = np.full(len(xy), np.inf)
    np.minimum.at(nearest, near.point, np.abs(near.offset))
    if still and (gap := float(np.median(nearest))) >= ROADSIDE_OFFSET_M:
        return f"parked beside the road, {gap:.1f} m from the nearest centre line"
    return ""


def _select_key_frames(xy: Float, candidates: Int) -> list[int]:
    """Return frames with candidates, `KEY_FRAME_M` apart along the track, including the first and the last."""
    driven = np.concatenate(((0.0,), np.cumsum(np.hypot(*np.diff(xy, axis=0).T)))) if len(xy) > 1 else np.zeros(1)
    keys = [int(candidates[0])]
    for frame in candidates[1:]:
        if driven[frame] - driven[keys[-1]] >= KEY_FRAME_M:
            keys.append(int(frame))
    last = int(candidates[-1])
    if last != keys[-1]:
        keys = keys[:-1] if len(keys) > 1 and driven[last] - driven[keys[-1]] < KEY_FRAME_M / 2 else keys
        keys.append(last)
    return keys


def _assemble_match(
    index: LaneCandidateIndex,
    track: Float,
    seen: Int,
    near: LaneCandidates,
    rows: list[int],
    hops: list[LanePath | None],
) -> LaneMatch:
    """Assign lanes to the frames between the key frames, and build the route."""
    names = [lane.id for lane in index.roads.driving]
    keys = [int(near.point[row]) for row in rows]
    lane, s, offset = [""] * len(track), np.full(len(track), np.nan), np.full(len(track), np.nan)
    frames = np.arange(len(seen) + 1)
    begins, before = np.searchsorted(near.point, frames).tolist(), np.searchsorted(keys, frames, side="right") - 1
    lanes, aside = [names[k] for k in near.lane.tolist()], np.abs(near.offset).tolist()
    for frame, (at, k) in enumerate(zip(seen.tolist(), before.tolist(), strict=False)):
        ways = _find_possible_lanes(k, rows, hops, near, names)
        candidates = [row for row in range(begins[frame], begins[frame + 1]) if lanes[row] in ways]
        if candidates:
            best = min(candidates, key=aside.__getitem__)
            lane[at], s[at], offset[at] = lanes[best], near.s[best], near.offset[best]
    broken = [k for k, hop in enumerate(hops) if hop is None]
    first = next((name for name in lane if name), None)
    route = _find_longest_route(index, rows, hops, near, names)
    return LaneMatch(
        tuple(lane),
        s,
        offset,
        route,
        False,
        _describe_breaks(rows, broken, near, names),
        tuple(int(seen[keys[k + 1]]) for k in broken),
        first_lane_width=index.roads.lanes[first].width if first else 0.0,
    )


def _find_possible_lanes(
    k: int, rows: list[int], hops: list[LanePath | None], near: LaneCandidates, names: list[str]
) -> tuple[str, ...]:
    """Return the lanes possible for a frame after key frame k and before the next one."""
    if 0 <= k < len(hops):
        hop = hops[k]
        return hop.lanes if hop is not None else (names[near.lane[rows[k]]],)
    return (names[near.lane[rows[max(k, 0)]]],)


def _find_longest_route(
    index: LaneCandidateIndex, rows: list[int], hops: list[LanePath | None], near: LaneCandidates, names: list[str]
) -> tuple[str, ...]:
    routes: list[list[str]] = [[names[near.lane[rows[0]]]]]
    for row, hop in zip(rows[1:], hops, strict=True):
        if hop is None:
            routes.append([names[near.lane[row]]])
        else:
            routes[-1] += hop.lanes[1:]
    lengths = [sum(index.roads.lanes[lane].centre.length for lane in route) for route in routes]
    return tuple(routes[int(np.argmax(lengths))])


def _describe_breaks(rows: list[int], broken: list[int], near: LaneCandidates, names: list[str]) -> str:
    if not broken:
        return ""
    a, b = (names[near.lane[rows[broken[0] + k]]] for k in (0, 1))
    more = f", and {len(broken) - 1} more such steps" if len(broken) > 1 else ""
    return f"no way from lane {a} to lane {b}{more}"
