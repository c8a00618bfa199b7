"""Rebuild the links between lane segments: keep plausible links of the map and add missing ones."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from mdrive_sumo.core.geometry import Bool, Float
from real2sim.network.lane_segment import LaneLink, LaneSegment

KEPT_GAP_M = 5.0
KEPT_YAW = np.radians(60)
"""A link of the map is kept if the ends are this close and have about the same direction."""
GAP_ACROSS_M = 0.8
GAP_ALONG_M = (-1.0, 2.0)
TOUCH_YAW = np.radians(30)
"""Ends this close across and along the lane, and aligned, are linked even if the map does not link them."""
EXACT_M = 0.1
EXACT_YAW = np.radians(50)
"""The same for ends that coincide."""
LOOSE_GAP_M = 4.0
"""[m] The same for two ends without any other link."""


@dataclass(frozen=True)
class RebuiltLinks:
    """Kept links, dropped links of the map, and links added by geometry."""

    links: frozenset[LaneLink]
    dropped: tuple[LaneLink, ...]
    added: tuple[LaneLink, ...]


def rebuild_links(segments: Mapping[str, LaneSegment], source_links: Iterable[LaneLink]) -> RebuiltLinks:
    """Check the links of the map by gap and heading, then link ends that meet."""
    ids = list(segments)
    if not ids:
        return RebuiltLinks(frozenset(), (), ())
    index = {id_: i for i, id_ in enumerate(ids)}
    gap, turn, chord = _measure_end_gaps(list(segments.values()))
    believed = (gap <= KEPT_GAP_M) & (turn <= KEPT_YAW)
    kinds = np.array([segment.kind for segment in segments.values()])
    alike = (kinds[:, None] == kinds[None]) & ~np.eye(len(ids), dtype=np.bool_)
    named = {(a, b) for a, b in source_links if a in index and b in index and a != b}
    kept = {(a, b) for a, b in named if believed[index[a], index[b]]}
    linked = np.zeros_like(believed)
    for a, b in kept:
        linked[index[a], index[b]] = True
    exact = (gap <= EXACT_M) & (turn <= EXACT_YAW) & alike
    ahead, aside = gap * np.cos(chord), gap * np.abs(np.sin(chord))
    near = (aside <= GAP_ACROSS_M) & (ahead >= GAP_ALONG_M[0]) & (ahead <= GAP_ALONG_M[1])
    touching = (exact | (near & (turn <= TOUCH_YAW) & alike)) & ~linked
    steps = (linked | touching).astype(np.float32)
    touching &= exact | ~(steps @ steps > 0)  # the others are already linked through one lane between them
    linked |= touching
    loose = _find_open_pairs(linked, gap, turn, chord) & alike
    added = sorted((ids[i], ids[j]) for i, j in np.argwhere(touching | loose))
    return RebuiltLinks(frozenset(kept) | frozenset(added), tuple(sorted(named - kept)), tuple(added))


def _measure_end_gaps(segments: list[LaneSegment]) -> tuple[Float, Float, Float]:
    """Return (L, L) from the end of row to the start of column: gap [m], turn [rad], angle to the chord [rad]."""
    starts, ends = np.array([segment.start for segment in segments]), np.array([segment.end for segment in segments])
    first, last = np.array([s.start_yaw for s in segments]), np.array([s.end_yaw for s in segments])
    across = starts[None] - ends[:, None]
    turn = np.abs(np.angle(np.exp(1j * (first[None] - last[:, None]))))
    chord = np.abs(np.angle(np.exp(1j * (np.arctan2(across[..., 1], across[..., 0]) - last[:, None]))))
    return np.hypot(across[..., 0], across[..., 1]), turn, chord


def _find_open_pairs(linked: Bool, gap: Float, turn: Float, chord: Float) -> Bool:
    """Return pairs of open ends that are each other's nearest."""
    open_ = ~linked.any(axis=1, keepdims=True) & ~linked.any(axis=0, keepdims=True)
    fits = open_ & (gap <= LOOSE_GAP_M) & (turn <= TOUCH_YAW) & (chord <= TOUCH_YAW)
    distance = np.where(fits, gap, np.inf)
    nearest = (distance == distance.min(1, keepdims=True)) & (distance == distance.min(0, keepdims=True))
    return fits & nearest
