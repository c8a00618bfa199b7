"""Repair a single track: fill gaps, spread steps, resolve headings."""

import numpy as np

from mdrive_sumo.core.geometry import Bool, Float, Int, wrap_angles
from real2sim.clean.track_segments import BREAK_M, compute_unexplained_steps
from real2sim.percentile import compute_median
from real2sim.tracks.kinematics import find_runs

SPREAD_S = 1.5
"""[s] A step that no other observer corrects is spread over this time on both sides."""
EXCURSION_M, EXCURSION_ACCELERATION = 0.5, 6.0
"""[m], [m/s²] Distance from the usual place that counts as an excursion; MDrive's limit of acceleration."""
HEADING_SPEED = 0.5
"""[m/s] Below this speed the direction of motion is meaningless."""
TURN_M = 1.0
"""[m] Net motion that decides between front and rear of a box."""
CHORD_FRAMES = 3
"""The direction of motion is the chord from this many frames before to as many after."""


def fill_gaps(valid: Bool, x: Float, y: Float, longest: int) -> tuple[Bool, Float, Float]:
    """Fill gaps of at most `longest` frames with the cubic that matches position and velocity on both sides.

    Gaps without motion (less than 0.7 m) are filled regardless of their length.
    """
    valid, x, y = valid.copy(), x.copy(), y.copy()
    frames = np.flatnonzero(valid)
    for gap in np.flatnonzero(np.diff(frames) > 1):
        before, after = int(frames[gap]), int(frames[gap + 1])
        gone = float(np.hypot(x[after] - x[before], y[after] - y[before]))
        if after - before - 1 <= longest or gone < 0.7:
            missing = np.arange(before + 1, after)
            for values in (x, y):
                slopes = _estimate_slope(values, frames, gap, -1), _estimate_slope(values, frames, gap + 1, 1)
                slopes = (0.0, 0.0) if gone < 0.7 and after - before > longest else slopes
                values[missing] = _interpolate_cubic(missing, (before, after), (values[before], values[after]), slopes)
            valid[missing] = True
    return valid, x, y


def _estimate_slope(values: Float, frames: Int, gap: np.intp, side: int) -> float:
    """Return the change per frame over up to five frames before (side -1) or after a gap; NaN for a single frame."""
    rows = frames[max(gap - 4, 0) : gap + 1] if side < 0 else frames[gap : gap + 5]
    rows = rows[np.abs(rows - frames[gap]) < 10]
    if len(rows) < 2:
        return float("nan")
    off = rows - rows.mean()
    return float(off @ values[rows] / (off @ off))


def _interpolate_cubic(
    frames: Int, ends: tuple[int, int], values: tuple[float, float], slopes: tuple[float, float]
) -> Float:
    """Evaluate a Hermite cubic at frames `at`; unknown slopes are replaced by that of the chord."""
    span = ends[1] - ends[0]
    chord = (values[1] - values[0]) / span
    begin, end = (chord if np.isnan(slope) else slope for slope in slopes)
    t = (frames - ends[0]) / span
    bump = t * (1 - t) * ((begin - chord) * (1 - t) - (end - chord) * t) * span
    return values[0] + chord * span * t + bump


def spread_steps(valid: Bool, x: Float, y: Float, dt_s: float) -> tuple[Float, Float, list[tuple[int, float]]]:
    """Spread steps that motion does not explain over the time around them, half before and half after.

    Returns positions and (frame, size [m]) of every step.
    """
    off, since = (steps[0] for steps in compute_unexplained_steps(x[None], y[None], valid[None]))
    size = np.where(since > 1, 0.0, np.hypot(off[:, 0], off[:, 1]))  # motion in an open gap is unknown
    steps = [(int(frame), float(size[frame])) for frame in np.flatnonzero(size > BREAK_M)]
    rows, span = np.arange(len(x)), SPREAD_S / dt_s
    for frame, _ in steps:
        side = np.where(rows >= frame, 1.0, -1.0)
        away = np.clip(np.abs(rows + 0.5 - frame) / span, 0.0, 1.0)
        share = side * (1 + np.cos(np.pi * away)) / 4
        x, y = x - share * off[frame, 0], y - share * off[frame, 1]
    return x, y, steps


def remove_excursions(valid: Bool, x: Float, y: Float, dt_s: float) -> tuple[Float, Float, int]:
    """Remove excursions of an object that mostly stands and leaves its place faster than possible.

    Moving a distance d away and back in a time t, from rest to rest, takes an acceleration of 16 d / t². Returns
    positions and the number of changed frames.
    """
    if not valid.any():
        return x, y, 0
    off = np.hypot(x - compute_median(x[valid]), y - compute_median(y[valid]))
    out = valid & ~(off <= EXCURSION_M)
    if out.sum() > valid.sum() / 2:
        return x, y, 0
    x, y, held_frames, frames = x.copy(), y.copy(), 0, np.flatnonzero(valid)
    for run in find_runs(out):
        before, after, time = run.start - 1, run.stop, (run.stop - run.start + 1) * dt_s
        returns = before >= frames[0] and after <= frames[-1] and bool(valid[before] and valid[after])
        if returns and 16 * off[run].max() / time**2 > EXCURSION_ACCELERATION:
            for values in (x, y):
                values[run] = np.interp(np.arange(run.start, run.stop), (before, after), values[[before, after]])
            held_frames += run.stop - run.start
    return x, y, held_frames


def compute_motion_directions(valid: Bool, x: Float, y: Float, dt_s: float) -> tuple[Float, Float]:
    """Return direction (T,) [rad] and speed (T,) [m/s] of motion over `CHORD_FRAMES` on both sides; NaN if invalid."""
    frames = np.flatnonzero(valid)
    course, speed = np.full(len(x), np.nan), np.full(len(x), np.nan)
    if len(frames) < 2:
        speed[frames] = 0.0
        return course, speed
    rows = np.arange(len(frames))
    low, high = np.maximum(rows - CHORD_FRAMES, 0), np.minimum(rows + CHORD_FRAMES, len(frames) - 1)
    dx, dy = (values[frames[high]] - values[frames[low]] for values in (x, y))
    course[frames] = np.arctan2(dy, dx)
    speed[frames] = np.hypot(dx, dy) / ((frames[high] - frames[low]) * dt_s)
    return course, speed


def compute_vehicle_heading(axis: Float, votes: Float, motion: tuple[Float, Float, Bool], dt_s: float) -> Float:
    """Return the heading (T,) of a vehicle from its box axis, with front and rear resolved by its motion.

    `axis` (T,) is known modulo pi, NaN where unknown; `votes` (T,) is the agreement (cosine) of the observed headings
    with it, used for objects that never move; `motion` is direction, speed and validity. Frames without a box are
    interpolated; without any box the direction of motion is used and held while standing.
    """
    course, speed, valid = motion
    frames = np.flatnonzero(valid)
    with_axis = frames[np.isfinite(axis[frames])]
    if len(with_axis) == 0:
        return hold_last_heading(np.where(valid & (speed > HEADING_SPEED), course, np.nan), valid)
    straight = axis.copy()
    straight[with_axis] = np.unwrap(axis[with_axis], period=np.pi)
    turned = np.round((straight[with_axis] - axis[with_axis]) / np.pi) % 2
    forward = np.nan_to_num(speed[with_axis]) * np.cos(np.nan_to_num(course[with_axis]) - straight[with_axis])
    box_says = np.where(turned > 0, -1.0, 1.0) * np.nan_to_num(votes[with_axis])
    ahead = forward.sum() if np.abs(forward.sum()) * dt_s > TURN_M else box_says.sum()
    heading = np.full(len(axis), np.nan)
    heading[with_axis] = straight[with_axis] + (np.pi if ahead < 0 else 0.0)
    heading[frames] = np.interp(frames, with_axis, heading[with_axis])
    return np.where(valid, wrap_angles(heading), np.nan)


def compute_pedestrian_heading(course: Float, speed: Float, valid: Bool, box: Float) -> Float:
    """Return the heading (T,) of a pedestrian: direction of motion, held while standing; else that of the box, or 0."""
    moving = valid & (speed > HEADING_SPEED)
    if moving.any():
        return hold_last_heading(np.where(moving, course, np.nan), valid)
    angles = box[valid & np.isfinite(box)]
    return np.where(valid, angles[0] if len(angles) else 0.0, np.nan)


def hold_last_heading(heading: Float, valid: Bool) -> Float:
    """Replace unknown headings (NaN) by the last known one, or the first one at the beginning; 0 if none is known."""
    known_frames = np.flatnonzero(np.isfinite(heading))
    if len(known_frames) == 0:
        return np.where(valid, 0.0, np.nan)
    last_known = np.maximum(np.searchsorted(known_frames, np.arange(len(heading)), side="right") - 1, 0)
    return np.where(valid, heading[known_frames[last_known]], np.nan)
