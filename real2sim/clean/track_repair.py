"""One track's own repairs: gaps filled by motion, steps spread, headings resolved."""

import numpy as np

from mdrive_sumo.core.geometry import Bool, Float, Int, wrap_angles
from real2sim.clean.track_segments import BREAK_M, compute_unexplained_steps
from real2sim.tracks.kinematics import find_runs

SPREAD_S = 1.5
"""A step that no other observer corrects is spread over so much time on both sides."""
EXCURSION_M, EXCURSION_ACCELERATION = 0.5, 6.0
"""[m], [m/s²] So far from its usual place it is elsewhere; MDrive's limit of acceleration."""
HEADING_SPEED = 0.5
"""[m/s] Slower than this the direction of motion says nothing."""
TURN_M = 1.0
"""Net motion [m] that settles which way a box looks."""
CHORD_FRAMES = 3
"""The direction of motion at a frame is that from so many frames before it to as many after."""


def fill_gaps(valid: Bool, x: Float, y: Float, longest: int) -> tuple[Bool, Float, Float]:
    """Gaps of at most `longest` frames filled by the cubic that meets position and velocity on both sides.

    Gaps at which it stood (the same place within 0.7 m) are filled however long they are.
    """
    valid, x, y = valid.copy(), x.copy(), y.copy()
    frames = np.flatnonzero(valid)
    for at in np.flatnonzero(np.diff(frames) > 1):
        before, after = int(frames[at]), int(frames[at + 1])
        gone = float(np.hypot(x[after] - x[before], y[after] - y[before]))
        if after - before - 1 <= longest or gone < 0.7:
            missing = np.arange(before + 1, after)
            for values in (x, y):
                slopes = _estimate_slope(values, frames, at, -1), _estimate_slope(values, frames, at + 1, 1)
                slopes = (0.0, 0.0) if gone < 0.7 and after - before > longest else slopes
                values[missing] = _interpolate_cubic(missing, (before, after), (values[before], values[after]), slopes)
            valid[missing] = True
    return valid, x, y


def _estimate_slope(values: Float, frames: Int, at: np.intp, side: int) -> float:
    """Change per frame over up to five frames before (side -1) or after a gap; NaN with one alone."""
    rows = frames[max(at - 4, 0) : at + 1] if side < 0 else frames[at : at + 5]
    rows = rows[np.abs(rows - frames[at]) < 10]
    if len(rows) < 2:
        return float("nan")
    off = rows - rows.mean()
    return float(off @ values[rows] / (off @ off))


def _interpolate_cubic(
    at: Int, ends: tuple[int, int], values: tuple[float, float], slopes: tuple[float, float]
) -> Float:
    """Hermite cubic at frames `at`; unknown slopes are that of the chord, and none may overshoot it threefold."""
    span = ends[1] - ends[0]
    chord = (values[1] - values[0]) / span
    begin, end = (chord if np.isnan(slope) else slope for slope in slopes)
    t = (at - ends[0]) / span
    bump = t * (1 - t) * ((begin - chord) * (1 - t) - (end - chord) * t) * span
    return values[0] + chord * span * t + bump


def spread_steps(valid: Bool, x: Float, y: Float, dt_s: float) -> tuple[Float, Float, list[tuple[int, float]]]:
    """Steps that motion does not explain, spread over the time around them: half before, half after.

    Returns positions and (frame, size [m]) of every step.
    """
    off, since = (found[0] for found in compute_unexplained_steps(x[None], y[None], valid[None]))
    size = np.where(since > 1, 0.0, np.hypot(off[:, 0], off[:, 1]))  # what it did in a gap that stays open nobody knows
    steps = [(int(frame), float(size[frame])) for frame in np.flatnonzero(size > BREAK_M)]
    at, span = np.arange(len(x)), SPREAD_S / dt_s
    for frame, _ in steps:
        side = np.where(at >= frame, 1.0, -1.0)
        away = np.clip(np.abs(at + 0.5 - frame) / span, 0.0, 1.0)
        share = side * (1 + np.cos(np.pi * away)) / 4
        x, y = x - share * off[frame, 0], y - share * off[frame, 1]
    return x, y, steps


def remove_excursions(valid: Bool, x: Float, y: Float, dt_s: float) -> tuple[Float, Float, int]:
    """Positions of a thing that mostly stands, held where it left its place and came back faster than it can.

    From rest to rest and back over a distance d in a time t takes accelerations of 16 d / t². Returns how many frames.
    """
    if not valid.any():
        return x, y, 0
    off = np.hypot(x - np.median(x[valid]), y - np.median(y[valid]))
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
    """Direction of motion (T,) [rad] and speed (T,) [m/s] over `CHORD_FRAMES` to both sides; NaN where not there."""
    frames = np.flatnonzero(valid)
    course, speed = np.full(len(x), np.nan), np.full(len(x), np.nan)
    if len(frames) < 2:
        speed[frames] = 0.0
        return course, speed
    at = np.arange(len(frames))
    low, high = np.maximum(at - CHORD_FRAMES, 0), np.minimum(at + CHORD_FRAMES, len(frames) - 1)
    dx, dy = (values[frames[high]] - values[frames[low]] for values in (x, y))
    course[frames] = np.arctan2(dy, dx)
    speed[frames] = np.hypot(dx, dy) / ((frames[high] - frames[low]) * dt_s)
    return course, speed


def compute_vehicle_heading(axis: Float, votes: Float, motion: tuple[Float, Float, Bool], dt_s: float) -> Float:
    """Heading (T,) of a vehicle from the axis of its box, which way it looks decided by its motion.

    `axis` (T,) is known up to half turns, NaN where unknown; `votes` (T,) says how far the boxes' own headings agree
    with it (cosine), for things that never move; `motion` is course, speed and where it is there. Frames without a box
    lie between those with one; if there is none at all, the course while it moves counts, held while it stands.
    """
    course, speed, valid = motion
    frames = np.flatnonzero(valid)
    known = frames[np.isfinite(axis[frames])]
    if len(known) == 0:
        return hold_last_heading(np.where(valid & (speed > HEADING_SPEED), course, np.nan), valid)
    straight = axis.copy()
    straight[known] = np.unwrap(axis[known], period=np.pi)
    turned = np.round((straight[known] - axis[known]) / np.pi) % 2
    forward = np.nan_to_num(speed[known]) * np.cos(np.nan_to_num(course[known]) - straight[known])
    box_says = np.where(turned > 0, -1.0, 1.0) * np.nan_to_num(votes[known])
    ahead = forward.sum() if np.abs(forward.sum()) * dt_s > TURN_M else box_says.sum()
    heading = np.full(len(axis), np.nan)
    heading[known] = straight[known] + (np.pi if ahead < 0 else 0.0)
    heading[frames] = np.interp(frames, known, heading[known])
    return np.where(valid, wrap_angles(heading), np.nan)


def compute_pedestrian_heading(course: Float, speed: Float, valid: Bool, box: Float) -> Float:
    """Heading (T,) of a walker: that of motion, held while standing; of one who never moves that of the box, or 0."""
    moving = valid & (speed > HEADING_SPEED)
    if moving.any():
        return hold_last_heading(np.where(moving, course, np.nan), valid)
    known = box[valid & np.isfinite(box)]
    return np.where(valid, known[0] if len(known) else 0.0, np.nan)


def hold_last_heading(heading: Float, valid: Bool) -> Float:
    """Unknown headings (NaN) take the last known one, those before the first take the first; 0 if none is known."""
    known = np.flatnonzero(np.isfinite(heading))
    if len(known) == 0:
        return np.where(valid, 0.0, np.nan)
    at = np.maximum(np.searchsorted(known, np.arange(len(heading)), side="right") - 1, 0)
    return np.where(valid, heading[known[at]], np.nan)
