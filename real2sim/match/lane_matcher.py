"""Tracks matched to lanes as a whole: a hidden Markov model over lanes and their connections, solved by Viterbi.

Method: Newson and Krumm, Hidden Markov Map Matching Through Noise and Sparseness, ACM GIS 2009, with the heading as
further evidence and lane changes as transitions. A lane is judged by lateral distance and heading, a step between
lanes by how much the distance along the network differs from the distance driven.
"""

from dataclasses import dataclass

import numpy as np

from mdrive_sumo.core.geometry import Float, Int
from mdrive_sumo.roads import RoadMap
from real2sim.match.lane_candidates import Hop, LaneIndex, Near, lane_index

REACH_M = 4.0
"""Lanes further away are no candidates: beyond a lane's width stands or drives something off the road."""
OFFSET_SIGMA_M = 0.8
HEADING_SIGMA = np.radians(15)
MOST_TURN = np.radians(75)
DISTANCE_SCALE_M = 1.5
CHANGE_COST = 4.0
"""What a lane change costs: like driving 2.3 sigma off a centre line for a single key frame."""
CHANGE_M = 5.0
"""Metres that a lane change counts in the choice between ways to the same lane."""
BREAK_COST = 60.0
"""Dearer than any real step: lanes between which no way was found."""
DETOUR_M = 40.0
KEY_M = 2.0
"""Frames between which less than this was driven say nothing new."""
STILL_M = 2.0
"""Tracks that spend nine tenths of their frames in a square of this size do not drive."""
BESIDE_M = 1.5
"""Who stands this far off every centre line does not stand in a lane."""
OFF_SHARE = 0.5
"""Tracks with a lane in less than this share of their frames are off the road."""
SPEED_YAW_M = 0.25
"""Over at least this distance between frames the direction of motion replaces the yaw of the box."""


@dataclass(frozen=True)
class Match:
    """A track on the network. Arrays are (N,), one row a frame of the track."""

    lane: tuple[str, ...]
    """Lane of each frame; "" where there is none or the track is not seen."""
    s: Float
    """Arc length [m] on that lane; NaN where there is none."""
    offset: Float
    """Lateral distance [m] to its centre line, positive to the left; NaN where there is none."""
    route: tuple[str, ...]
    """Lanes in order, each a successor or a neighbour of the one before: the longest stretch without a break."""
    off_road: bool
    """Whether the track is to be kept where it is: parked beside the road, or never on it."""
    reason: str
    """Why it is off the road or why the route does not cover the whole track; "" if it does."""
    breaks: tuple[int, ...] = ()
    """Frames before which no way leads on from the lane before."""


@dataclass(frozen=True)
class _Step:
    """Best way to a candidate: its predecessor (row of `Near`), cost so far, and the way (None: a break)."""

    before: int
    cost: float
    hop: Hop | None


def match(track: Float, roads: RoadMap) -> Match:
    """Matches x, y, yaw (N, 3) [m, rad] of a vehicle, NaN rows where it is not seen, to lanes of a network."""
    seen = np.flatnonzero(np.isfinite(track[:, :2]).all(1))
    if not len(seen):
        return _nothing(len(track), "never seen")
    index = lane_index(roads)
    xy = track[seen, :2]
    around = index.near(xy, _headings(track[seen]), REACH_M)
    near = _plausible(around)
    if why := _off_road(around, near, xy):
        return _nothing(len(track), why)
    keys = _keys(xy, np.unique(near.point))
    rows, hops = best_chain(index, near, keys, xy)
    return _assembled(index, track, seen, near, rows, hops)


def _nothing(frames: int, why: str) -> Match:
    unknown = np.full(frames, np.nan)
    return Match(("",) * frames, unknown, unknown.copy(), (), True, why)


def _headings(track: Float) -> Float:
    """Direction of motion where it moves, else the yaw of the box (NaN: unknown), (N,) [rad]."""
    ahead = np.roll(track[:, :2], -1, axis=0)
    behind = np.roll(track[:, :2], 1, axis=0)
    ahead[-1], behind[0] = track[-1, :2], track[0, :2]
    step = ahead - behind
    moving = np.hypot(step[:, 0], step[:, 1]) >= 2 * SPEED_YAW_M
    return np.where(moving, np.arctan2(step[:, 1], step[:, 0]), track[:, 2])


def _plausible(near: Near) -> Near:
    keep = ~(np.abs(near.turn) > MOST_TURN)  # unknown directions are kept
    return Near(near.point[keep], near.lane[keep], near.s[keep], near.d[keep], near.turn[keep])


def _off_road(around: Near, near: Near, xy: Float) -> str:
    """Why the track is off the road; "" if it is not. `near` are the lanes `around` that run its way."""
    still = bool(np.ptp(np.percentile(xy, (5, 95), axis=0), axis=0).max() < STILL_M)
    doing = "parked" if still else "drives"
    missing = 1 - len(np.unique(near.point)) / len(xy)
    if missing > 1 - OFF_SHARE:
        if 1 - len(np.unique(around.point)) / len(xy) > 1 - OFF_SHARE:
            return f"{doing} off the road: {missing:.0%} of frames over {REACH_M:g} m from any lane"
        return f"{doing} across or against the lanes: in {missing:.0%} of frames none within {REACH_M:g} m runs its way"
    nearest = np.full(len(xy), np.inf)
    np.minimum.at(nearest, near.point, np.abs(near.d))
    if still and (gap := float(np.median(nearest))) >= BESIDE_M:
        return f"parked beside the road, {gap:.1f} m from the nearest centre line"
    return ""


def _keys(xy: Float, candidates: Int) -> list[int]:
    """Frames with candidates, `KEY_M` apart along the track, and the first and last of them."""
    driven = np.concatenate(((0.0,), np.cumsum(np.hypot(*np.diff(xy, axis=0).T)))) if len(xy) > 1 else np.zeros(1)
    keys = [int(candidates[0])]
    for frame in candidates[1:]:
        if driven[frame] - driven[keys[-1]] >= KEY_M:
            keys.append(int(frame))
    last = int(candidates[-1])
    if last != keys[-1]:
        keys = keys[:-1] if len(keys) > 1 and driven[last] - driven[keys[-1]] < KEY_M / 2 else keys
        keys.append(last)
    return keys


def emission(d: Float, turn: Float) -> Float:
    """Cost of candidates with lateral distance d [m] and angle turn [rad]; unknown angles cost nothing."""
    heading = np.where(np.isnan(turn), 0.0, turn / HEADING_SIGMA)
    return 0.5 * (d / OFFSET_SIGMA_M) ** 2 + 0.5 * heading**2


def transition(network_m: float, driven_m: float, changes: int) -> float:
    """Cost of a step: network distance against driven distance [m], and the number of lane changes."""
    return abs(network_m - driven_m) / DISTANCE_SCALE_M + CHANGE_COST * changes


def best_chain(index: LaneIndex, near: Near, keys: list[int], xy: Float) -> tuple[list[int], list[Hop | None]]:
    """The cheapest rows of `near`, one a key frame, and the ways between them (None: a break)."""
    cost = emission(near.d, near.turn)
    driven = np.concatenate(((0.0,), np.cumsum(np.hypot(*np.diff(xy, axis=0).T)))) if len(xy) > 1 else np.zeros(1)
    layers = [np.flatnonzero(near.point == key) for key in keys]
    chain: list[dict[int, _Step]] = [{int(row): _Step(-1, float(cost[row]), None) for row in layers[0]}]
    for k in range(1, len(keys)):
        distance = float(driven[keys[k]] - driven[keys[k - 1]])
        chain.append({int(row): _best(index, near, chain[-1], int(row), distance) for row in layers[k]})
        for row, step in chain[-1].items():
            chain[-1][row] = _Step(step.before, step.cost + float(cost[row]), step.hop)
    return _walk_back(chain)


def _best(index: LaneIndex, near: Near, before: dict[int, _Step], row: int, driven: float) -> _Step:
    goal = index.roads.driving[near.lane[row]].id
    best = _Step(-1, np.inf, None)
    for there, step in before.items():
        start = index.roads.driving[near.lane[there]].id
        hop = index.hops(start, driven + DETOUR_M, CHANGE_M).get(goal)
        added = BREAK_COST
        if hop is not None:
            network = hop.length + float(near.s[row] - near.s[there])
            added = transition(network, driven, hop.changes)
        if added >= BREAK_COST:
            hop, added = None, BREAK_COST
        if step.cost + added < best.cost:
            best = _Step(there, step.cost + added, hop)
    return best


def _walk_back(chain: list[dict[int, _Step]]) -> tuple[list[int], list[Hop | None]]:
    row = min(chain[-1], key=lambda one: chain[-1][one].cost)
    rows, hops = [row], list[Hop | None]()
    for layer in reversed(chain[1:]):
        step = layer[rows[-1]]
        rows.append(step.before)
        hops.append(step.hop)
    return rows[::-1], hops[::-1]


def _assembled(index: LaneIndex, track: Float, seen: Int, near: Near, rows: list[int], hops: list[Hop | None]) -> Match:
    """Lanes of the frames between the key frames, and the route."""
    names = [lane.id for lane in index.roads.driving]
    keys = [int(near.point[row]) for row in rows]
    lane, s, offset = [""] * len(track), np.full(len(track), np.nan), np.full(len(track), np.nan)
    for frame in range(len(seen)):
        k = int(np.searchsorted(keys, frame, side="right")) - 1
        ways = _ways_at(k, rows, hops, near, names)
        at = [row for row in _rows_of(near, frame) if names[near.lane[row]] in ways]
        if at:
            best = min(at, key=lambda row: abs(near.d[row]))
            lane[seen[frame]], s[seen[frame]], offset[seen[frame]] = names[near.lane[best]], near.s[best], near.d[best]
    broken = [k for k, hop in enumerate(hops) if hop is None]
    route = _longest_route(index, rows, hops, near, names)
    return Match(tuple(lane), s, offset, route, False, _why(rows, broken, near, names), _frames(seen, keys, broken))


def _rows_of(near: Near, frame: int) -> range:
    return range(int(np.searchsorted(near.point, frame)), int(np.searchsorted(near.point, frame, side="right")))


def _ways_at(k: int, rows: list[int], hops: list[Hop | None], near: Near, names: list[str]) -> tuple[str, ...]:
    """Lanes on which a frame after key frame k, and before the next, may be."""
    if 0 <= k < len(hops):
        hop = hops[k]
        return hop.lanes if hop is not None else (names[near.lane[rows[k]]],)
    return (names[near.lane[rows[max(k, 0)]]],)


def _longest_route(
    index: LaneIndex, rows: list[int], hops: list[Hop | None], near: Near, names: list[str]
) -> tuple[str, ...]:
    routes: list[list[str]] = [[names[near.lane[rows[0]]]]]
    for row, hop in zip(rows[1:], hops, strict=True):
        if hop is None:
            routes.append([names[near.lane[row]]])
        else:
            routes[-1] += hop.lanes[1:]
    lengths = [sum(index.roads.lanes[lane].centre.length for lane in route) for route in routes]
    return tuple(routes[int(np.argmax(lengths))])


def _why(rows: list[int], broken: list[int], near: Near, names: list[str]) -> str:
    if not broken:
        return ""
    a, b = (names[near.lane[rows[broken[0] + k]]] for k in (0, 1))
    more = f", and {len(broken) - 1} more such steps" if len(broken) > 1 else ""
    return f"no way from lane {a} to lane {b}{more}"


def _frames(seen: Int, keys: list[int], broken: list[int]) -> tuple[int, ...]:
    return tuple(int(seen[keys[k + 1]]) for k in broken)
