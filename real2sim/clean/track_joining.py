"""Join groups of segments that follow each other in time if motion explains the gap."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mdrive_sumo.core.geometry import Float, Int
from mdrive_sumo.core.state import Kind
from real2sim.clean.observer_fusion import MIN_COMMON_FRAMES, FusedTrack, fuse_segments
from real2sim.clean.track_segments import TrackSegments
from real2sim.percentile import compute_median

MAX_GAP_S = 2.0
"""[s] Chosen: longer gaps stay open, because their two ends do not tell what happened between them."""
JOIN_M = 0.8
"""[m] Distance allowed between the extrapolated end of a track and the beginning of the next without a gap."""
JOIN_ACCELERATION = 2.0
"""[m/s²] Change of speed allowed during a gap."""
MAX_JOIN_M = 4.0
"""[m] The allowance for acceleration in a gap (`JOIN_ACCELERATION`) grows no further."""
SAME_ID_EXTRA_M = 2.5
"""[m] Additional jump allowed for the same id: reported as a teleport, which is better than two tracks."""
SPEED_STEP, SPEED_RATE = 2.0, 5.0
"""[m/s], [m/s²] Difference between the speeds before and after: constant part and part per second of gap."""
STANDING_SPEED = 0.5
"""[m/s] Slower objects stand, and"""
STANDING_M = 0.7
"""[m] continue where they are seen within this distance, whatever their extrapolated motion says."""
END_FRAMES = 6
"""Number of frames at either end used to estimate the velocity."""
ORPHAN_M = 8.0
"""[m] Off-track positions with the same id within this distance are errors; beyond it they are another object."""
SHORT_FRAMES = 5
"""Groups of fewer frames may be orphans even if no jump cut them off."""


@dataclass(frozen=True)
class GroupEnds:
    """First and last observation of G groups: positions and velocities (G, 2) [m, m/frame], frames (G,)."""

    first: Int
    last: Int
    entry: Float
    exit: Float
    entry_velocity: Float
    exit_velocity: Float


def join_groups(segments: TrackSegments, groups: Sequence[list[int]], dt_s: float) -> list[list[int]]:
    """Join groups that follow each other; the best explained pairs are joined first."""
    groups = [list(group) for group in groups]
    if len(groups) < 2:
        return groups
    ends = _compute_ends(segments, groups)
    cost = _compute_costs(segments, groups, ends, dt_s)
    follower: dict[int, int] = {}
    leader: dict[int, int] = {}
    pairs = np.column_stack(np.nonzero(np.isfinite(cost)))
    for before, after in pairs[np.argsort(cost[pairs[:, 0], pairs[:, 1]], kind="stable")].tolist():
        if before not in follower and after not in leader:
            follower[before], leader[after] = after, before
    return [_collect_chain(groups, follower, start) for start in range(len(groups)) if start not in leader]


def _collect_chain(groups: Sequence[list[int]], follower: dict[int, int], start: int) -> list[int]:
    members = list(groups[start])
    while start in follower:
        start = follower[start]
        members += groups[start]
    return sorted(members)


def _compute_ends(segments: TrackSegments, groups: Sequence[list[int]]) -> GroupEnds:
    rows: list[tuple[int, int, Float, Float, Float, Float]] = []
    for group in groups:
        seen = fuse_segments(segments, group)
        frames = np.flatnonzero(seen.valid)
        xy = np.column_stack((seen.x, seen.y))[frames]
        head, tail = slice(None, END_FRAMES), slice(-END_FRAMES, None)
        rows.append(
            (
                int(frames[0]),
                int(frames[-1]),
                xy[0],
                xy[-1],
                _estimate_velocity(frames[head], xy[head]),
                _estimate_velocity(frames[tail], xy[tail]),
            )
        )
    first, last, entry, leave, entry_velocity, exit_velocity = zip(*rows, strict=True)
    return GroupEnds(
        np.array(first), np.array(last), np.array(entry), np.array(leave),
        np.array(entry_velocity), np.array(exit_velocity),
    )  # fmt: skip


def _estimate_velocity(frames: Int, xy: Float) -> Float:
    """Return the slope (2,) [m/frame] of a line fitted to the positions; NaN for a single one."""
    if len(frames) < 2:
        return np.full(2, np.nan)
    off = frames - frames.mean()
    return (off @ xy) / (off @ off)


def _compute_costs(segments: TrackSegments, groups: Sequence[list[int]], ends: GroupEnds, dt_s: float) -> Float:
    """Return (G, G) costs of joining the second group to the first; infinite where motion does not explain it."""
    gap = (ends.first[None, :] - ends.last[:, None]).astype(np.float64)
    gap_s = np.maximum(gap, 0.0) * dt_s
    before, after = ends.exit_velocity[:, None], ends.entry_velocity[None, :]
    before, after = np.where(np.isnan(before), after, before), np.where(np.isnan(after), before, after)
    comparable = np.isfinite(before + after).all(-1)
    moved = ends.entry[None, :] - ends.exit[:, None]
    off = np.hypot(*np.moveaxis(moved - np.nan_to_num(before + after) / 2 * gap[..., None], -1, 0))
    change = np.hypot(*np.moveaxis(np.nan_to_num(after - before), -1, 0)) / dt_s
    speed = np.hypot(*np.moveaxis(np.nan_to_num(np.stack((before, after))), -1, 0)).max(0) / dt_s
    limit = JOIN_M + np.minimum(0.5 * JOIN_ACCELERATION * gap_s**2, MAX_JOIN_M)
    named = _share_ids(segments, groups)
    here = np.hypot(moved[..., 0], moved[..., 1])
    explained = (off < limit) & (gap_s <= MAX_GAP_S) & (change < SPEED_STEP + SPEED_RATE * gap_s) & comparable
    standing = (speed < STANDING_SPEED) & (here < STANDING_M)
    jumped = named & (off < limit + SAME_ID_EXTRA_M) & (gap_s <= MAX_GAP_S)
    long_unseen = named & (gap_s > MAX_GAP_S) & (here < ORPHAN_M + (speed + 2.0) * gap_s)
    follows = (gap > -MIN_COMMON_FRAMES) & (np.subtract.outer(ends.first, ends.first) < 0)
    follows &= np.subtract.outer(ends.last, ends.last) < 0
    possible = follows & _have_same_kind(segments, groups) & (explained | standing | jumped | long_unseen)
    cost = off / limit + 0.2 * gap_s + np.where(named, 0.0, 0.3) + np.where(explained | standing, 0.0, 10.0)
    return np.where(possible, cost, np.inf)


def _share_ids(segments: TrackSegments, groups: Sequence[list[int]]) -> np.ndarray:
    """Return a (G, G) mask of groups that share an id."""
    names = [{segments.ids[i] for i in group} for group in groups]
    return np.array([[not a.isdisjoint(b) for b in names] for a in names])


def _have_same_kind(segments: TrackSegments, groups: Sequence[list[int]]) -> np.ndarray:
    """Return a (G, G) mask of groups that agree in being pedestrians or not."""
    walker = np.array([segments.categories[group[0]].kind is Kind.PEDESTRIAN for group in groups])
    return walker[:, None] == walker[None, :]


def find_orphans(segments: TrackSegments, groups: Sequence[list[int]]) -> dict[int, int]:
    """Return erroneous groups with the group they belong to: same id, and a track that is complete without them.

    Only groups cut off by jumps and very short groups are candidates.
    """
    sights = [fuse_segments(segments, group) for group in groups]
    owners: dict[int, int] = {}
    size = [int(sight.valid.sum()) for sight in sights]
    for a, group in enumerate(groups):
        if not (all(segments.is_cut[i] for i in group) or size[a] < SHORT_FRAMES):
            continue
        names = {segments.ids[i] for i in group}
        for b, other in enumerate(groups):
            if (
                size[b] > size[a]
                and not names.isdisjoint(segments.ids[i] for i in other)
                and _lies_within(sights, a, b)
            ):
                owners[a] = b
    return owners


def _lies_within(sights: Sequence[FusedTrack], a: int, b: int) -> bool:
    """Return whether group `a` lies within the time of `b` and near its interpolated positions."""
    inner, outer = sights[a], sights[b]
    there, frames = np.flatnonzero(outer.valid), np.flatnonzero(inner.valid)
    if frames[0] < there[0] or frames[-1] > there[-1]:
        return False
    x, y = (np.interp(frames, there, values[there]) for values in (outer.x, outer.y))
    return compute_median(np.hypot(inner.x[frames] - x, inner.y[frames] - y)) < ORPHAN_M
