"""Resolve overlaps of appearing tracks: drop early frames, else shrink both boxes, else drop the track."""

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from mdrive_sumo.core.geometry import Bool, boxes_overlap
from real2sim.clean.cleaning_report import ChangeReason, TrackChange
from real2sim.recording import RecordedTrack
from real2sim.tracks.kinematics import WINDOW
from real2sim.tracks.reconstruct import reconstruct_tracks
from real2sim.tracks.stationary import hold_still
from real2sim.tracks.track_contacts import TrackBoxes, find_contacts

SLACK_M = 0.05
"""[m] Boxes are labelled by hand: each side is reduced by this. The fidelity check allows 0.1 m."""
RECONSTRUCTION_SHIFT_M = 0.5
"""[m] Reconstruction hardly moves boxes further than this."""
FIRST_SHARE = 1 / 3
"""A track that overlaps another one only in this first share of its frames begins later."""
SHRINK = (0.95, 0.9, 0.85)
"""Factors to shrink both boxes: observers of one car differ by 15 percent (data_formats 2.2)."""


def resolve_overlaps(
    tracks: Sequence[RecordedTrack], cavs: Collection[str], dt_s: float
) -> tuple[tuple[RecordedTrack, ...], tuple[TrackChange, ...]]:
    """Return tracks of which none appears inside another, and the changes. Connected vehicles are kept unchanged."""
    kept, changes = list(tracks), list[TrackChange]()
    for _ in range(3 * len(tracks)):
        there = _reconstructed(kept, dt_s)
        pairs = find_contacts(there, SLACK_M).spawn_overlaps
        pair = next(((i, j) for i, j in pairs if not {kept[i].id, kept[j].id} <= set(cavs)), None)
        if pair is None:
            break
        changes.append(_resolve_pair(kept, there, _later(kept, pair, cavs)))
    return tuple(kept), tuple(changes)


def _reconstructed(tracks: Sequence[RecordedTrack], dt_s: float) -> list[RecordedTrack]:
    """Return the tracks as reconstruction changes them, computed only for those that appear near another one."""
    there = [hold_still(track) if track.parked else track for track in tracks]
    near = sorted(
        {
            i
            for pair in find_contacts(there, -RECONSTRUCTION_SHIFT_M).spawn_overlaps
            for i in pair
            if not there[i].parked
        }
    )
    for i, track in zip(near, reconstruct_tracks([there[i] for i in near], dt_s), strict=True):
        there[i] = track
    return there


def _later(tracks: Sequence[RecordedTrack], pair: tuple[int, int], cavs: Collection[str]) -> tuple[int, int]:
    """Return the index of the track to change: not a CAV, later, or shorter."""
    rank = [(tracks[i].id not in cavs, int(tracks[i].valid_frames[0]), -int(tracks[i].valid.sum()), i) for i in pair]
    late = max(rank)[-1]
    return late, pair[0] if late == pair[1] else pair[1]


def _resolve_pair(kept: list[RecordedTrack], there: Sequence[RecordedTrack], pair: tuple[int, int]) -> TrackChange:
    """Change `kept` so that the pair does not overlap when the later one appears."""
    late, other = pair
    frames = kept[late].valid_frames
    hit = _compute_overlap_mask(there[late], there[other], 1.0)[frames]
    inside = f"overlaps {kept[other].id}"
    first = int(hit.argmin()) if not hit.all() else len(frames)
    if 0 < first <= FIRST_SHARE * len(frames) and len(frames) - first >= WINDOW:
        kept[late] = kept[late].restrict(kept[late].valid & (np.arange(len(kept[late].valid)) >= frames[first]))
        return TrackChange(ChangeReason.OVERLAP, kept[late].id, first, f"{inside} at first: begins later")
    for share in SHRINK:
        if not _compute_overlap_mask(there[late], there[other], share)[frames].any():
            for n in pair:
                kept[n] = replace(kept[n], length=share * kept[n].length, width=share * kept[n].width)
            return TrackChange(
                ChangeReason.OVERLAP, kept[late].id, len(frames), f"{inside}: both taken as {share:.0%} of their size"
            )
    gone = kept.pop(late)
    return TrackChange(
        ChangeReason.INSIDE, gone.id, len(frames), f"{inside} in {hit.sum()} of {len(frames)} frames: left out"
    )


def _compute_overlap_mask(first: RecordedTrack, second: RecordedTrack, share: float) -> Bool:
    """Return a mask (T,) where the boxes, scaled by `share`, overlap."""
    boxes = TrackBoxes.from_tracks(
        [replace(track, length=share * track.length, width=share * track.width) for track in (first, second)]
    )
    frames = np.flatnonzero(first.valid & second.valid)
    result = np.zeros(len(first.valid), dtype=np.bool_)
    corners = [boxes.corners(np.full(len(frames), n), frames, SLACK_M) for n in (0, 1)]
    result[frames] = boxes_overlap(corners[0], corners[1])
    return result
