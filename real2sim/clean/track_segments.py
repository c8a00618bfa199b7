"""Track segments: stretches of one id of one observer without a jump, the units of fusion and joining."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Bool, Float, Int
from real2sim.recording import ObjectCategory, Recording

BREAK_M = 0.8
"""[m] A step that differs this much from its neighbours is not motion: several times the noise of any source."""
BREAK_ACCELERATION = 4.0
"""[m/s²] Change of speed allowed while a track is not observed."""
MAX_BREAK_M = 6.0
"""[m] The allowance for acceleration while a track is not observed (`BREAK_ACCELERATION`) grows no further."""
HALF_WINDOW = 4
"""Number of steps on each side whose median tells how the object moves."""
EXCURSION_S = 1.5
"""[s] Positions that stay away for longer are no excursion."""
FROZEN_M = 0.02
"""[m] A smaller step is a repeated position."""
FROZEN_SPEED = 2.0
"""[m/s] An object this fast cannot stop within one frame."""


@dataclass(frozen=True, slots=True)
class RemovedFrames:
    """Frames dropped from one observer's track."""

    track: int
    """Index among the unsplit tracks of `collect_segments`."""
    frames: int
    detail: str


@dataclass(frozen=True)
class FusedTrack:
    """Joint estimate of several segments: arrays (T,), NaN where none of them is valid."""

    valid: Bool
    x: Float
    y: Float
    axis: Float
    """Direction of the box modulo pi [rad]; NaN where no observer gives one."""


@dataclass(frozen=True, eq=False)
class TrackSegments:
    """K segments over T frames. Arrays (K, T) hold NaN where a segment is not valid."""

    observer: Int
    """Index (K,) of the view that a segment is from."""
    ids: tuple[str, ...]
    """Ids (K,) of the tracks in the source."""
    categories: tuple[ObjectCategory, ...]
    parked: Bool
    """Whether the source labels the object static, (K,)."""
    is_cut: Bool
    """(K,) Whether a jump bounds the segment on either side."""
    valid: Bool
    x: Float
    y: Float
    yaw: Float
    length: Float
    width: Float

    def __len__(self) -> int:
        return len(self.ids)

    @cached_property
    def fused(self) -> dict[tuple[int, ...], FusedTrack]:
        """What `fuse_segments` has computed, by the rows."""
        return {}

    def select(self, keep: np.ndarray, valid: Bool) -> "TrackSegments":
        """Return segments `keep` (M,), valid only where `valid` (M, T)."""
        hidden = {
            name: np.where(valid, getattr(self, name)[keep], np.nan) for name in ("x", "y", "yaw", "length", "width")
        }
        return replace(
            self,
            observer=self.observer[keep],
            ids=tuple(self.ids[i] for i in keep),
            categories=tuple(self.categories[i] for i in keep),
            parked=self.parked[keep],
            is_cut=self.is_cut[keep],
            valid=valid,
            **hidden,
        )


def collect_segments(recording: Recording) -> TrackSegments:
    """Collect the unsplit tracks of all views; raise InputError if a track does not fit the recording."""
    tracks = [(i, track) for i, view in enumerate(recording.views) for track in view.tracks]
    shape = (len(tracks), recording.frame_count)
    for i, track in tracks:
        if len(track.valid) != recording.frame_count:
            raise InputError(
                f"log {recording.id}, observer {recording.views[i].observer}, track {track.id}: "
                f"expected {recording.frame_count} frames, found {len(track.valid)}"
            )
    valid = np.array([track.valid for _, track in tracks], dtype=np.bool_).reshape(shape)
    arrays = {
        name: np.array([getattr(track, name) for _, track in tracks], dtype=np.float64).reshape(shape)
        for name in ("x", "y", "yaw", "length", "width")
    }
    valid &= np.isfinite(arrays["x"]) & np.isfinite(arrays["y"])
    return TrackSegments(
        np.array([i for i, _ in tracks], dtype=np.int64),
        tuple(track.id for _, track in tracks),
        tuple(track.category for _, track in tracks),
        np.array([track.parked for _, track in tracks], dtype=np.bool_),
        np.zeros(len(tracks), dtype=np.bool_),
        valid,
        **{name: np.where(valid, values, np.nan) for name, values in arrays.items()},
    )


def compute_unexplained_steps(x: Float, y: Float, valid: Bool) -> tuple[Float, Int]:
    """Return steps that motion does not explain, for K tracks at once.

    Returns vectors (K, T, 2) [m] from the position expected from the median step to the observed one (0 at the first
    frame and where invalid), and the number of frames (K, T) since the previous observation.
    """
    tracks, frames = valid.shape
    last_valid = np.where(valid, np.arange(frames), -1)
    last = np.concatenate((np.full((tracks, 1), -1), np.maximum.accumulate(last_valid, axis=1)[:, :-1]), axis=1)
    stepped = valid & (last >= 0)
    since = np.where(stepped, np.arange(frames) - last, 1)
    xy = np.stack((x, y), axis=-1)
    before = np.take_along_axis(xy, np.maximum(last, 0)[..., None], axis=1)
    step = np.where(stepped[..., None], xy - before, np.nan)
    usual = _compute_neighbour_median(step / since[..., None])
    off = np.where(stepped[..., None], step - usual * since[..., None], 0.0)
    return np.nan_to_num(off), since


def _compute_neighbour_median(step: Float) -> Float:
    """Return the median (K, T, 2) over `HALF_WINDOW` steps on both sides without the step itself."""
    padded = np.pad(step, ((0, 0), (HALF_WINDOW, HALF_WINDOW), (0, 0)), constant_values=np.nan)
    windows = sliding_window_view(padded, 2 * HALF_WINDOW + 1, axis=1)
    others = np.sort(np.delete(windows, HALF_WINDOW, axis=-1), axis=-1)
    count = np.isfinite(others).sum(-1)
    low = np.take_along_axis(others, np.maximum((count - 1) // 2, 0)[..., None], axis=-1)[..., 0]
    high = np.take_along_axis(others, np.minimum(count // 2, others.shape[-1] - 1)[..., None], axis=-1)[..., 0]
    return np.where(count > 0, (low + high) / 2, step)


def split_at_jumps(unsplit: TrackSegments, dt_s: float) -> tuple[TrackSegments, tuple[RemovedFrames, ...]]:
    """Split segments at jumps and drop impossible frames: excursions, and frozen frames before a jump."""
    off, since = compute_unexplained_steps(unsplit.x, unsplit.y, unsplit.valid)
    gate = BREAK_M + np.minimum(0.5 * BREAK_ACCELERATION * ((since - 1) * dt_s) ** 2, MAX_BREAK_M)
    breaks = np.hypot(off[..., 0], off[..., 1]) > gate
    away = _find_excursions(off, breaks, round(EXCURSION_S / dt_s)) & unsplit.valid
    part = np.cumsum(breaks, axis=1)
    rows = [(k, n) for k in range(len(unsplit)) for n in range(int(part[k, -1]) + 1)] if len(unsplit) else []
    keep = np.array([k for k, _ in rows], dtype=np.int64)
    valid = (unsplit.valid & ~away)[keep] & (part[keep] == np.array([n for _, n in rows], dtype=np.int64)[:, None])
    removals = [
        RemovedFrames(int(k), int(away[k].sum()), "elsewhere for a moment") for k in np.flatnonzero(away.any(axis=1))
    ]
    for row, (k, n) in enumerate(rows):
        if n < part[k, -1] and (tail := _find_frozen_tail(unsplit, k, valid[row], dt_s)):
            valid[row, tail] = False
            removals.append(RemovedFrames(k, len(tail), "frozen before a jump"))
    broken = part[keep, -1] > 0 if len(keep) else np.zeros(0, dtype=np.bool_)
    return replace(unsplit.select(keep, valid), is_cut=broken), tuple(removals)


def _find_excursions(off: Float, breaks: Bool, longest: int) -> Bool:
    """Return frames (K, T) between two jumps that cancel each other, and clear both in `breaks`."""
    away = np.zeros_like(breaks)
    for k in np.flatnonzero(breaks.sum(axis=1) > 1):
        frames, n = np.flatnonzero(breaks[k]), 0
        while n + 1 < len(frames):
            there, back = frames[n], frames[n + 1]
            if back - there <= longest and np.hypot(*(off[k, there] + off[k, back])) < BREAK_M:
                away[k, there:back] = True
                breaks[k, [there, back]] = False
                n += 1
            n += 1
    return away


def _find_frozen_tail(unsplit: TrackSegments, k: int, valid: Bool, dt_s: float) -> list[int]:
    """Return the last frames of a stretch that stand still although the object was moving."""
    frames = np.flatnonzero(valid)
    if len(frames) < 5:
        return []
    step = np.hypot(np.diff(unsplit.x[k, frames]), np.diff(unsplit.y[k, frames]))
    moving = np.flatnonzero(step > FROZEN_M)
    if len(moving) < 3 or moving[-1] == len(step) - 1:
        return []
    speed = np.median(step[moving[-3:]]) / dt_s
    return [int(frame) for frame in frames[moving[-1] + 2 :]] if speed > FROZEN_SPEED else []
