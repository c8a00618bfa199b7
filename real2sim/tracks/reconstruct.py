"""Reconstruction: cleaned tracks become smooth, dynamically plausible trajectories close to the log.

Positions: least squares with a soft penalty on jerk (`smoothing`); a track that is still implausible becomes the
nearest trajectory of bounded jerk and acceleration (`bounded_trajectory`). Standstill is exact, and vehicles do not
roll back.

Heading of vehicles: that of a car whose rear axle follows its centre (`HITCH`), so that it can neither flip nor slide;
the yaw of a turning box lags behind its course in the same way.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mdrive_sumo.core.geometry import Bool, Float, wrap_angles
from mdrive_sumo.core.state import Kind
from real2sim.percentile import compute_median, compute_percentile
from real2sim.recording import RecordedTrack
from real2sim.tracks.bounded_trajectory import TrajectoryBounds, fit_bounded_trajectory
from real2sim.tracks.kinematics import WINDOW, acceleration_magnitudes, find_runs, jerk_magnitudes
from real2sim.tracks.smoothing import smooth_positions
from real2sim.tracks.stationary import hold_still

JERK_PENALTY = 0.3
"""Suppresses motion faster than 2 Hz, which no road user has."""
CALM_PENALTY = 100.0
"""Keeps motion slower than 0.7 Hz: the position without noise."""
JERK_P95, JERK_MAX, ACCELERATION_MAX = 4.7, 15.0, 5.8
"""[m/s³], [m/s²] A trajectory that exceeds one of these is rough. The fidelity targets are 5 (95th percentile) and
6."""
JERK_BOUND, ACCELERATION_BOUND = 4.6, 5.7
"""[m/s³], [m/s²] Bounds of a rough trajectory, at every frame."""
ERROR_MEDIAN, ERROR_P95 = 0.3, 1.0
"""[m] Limits of the fidelity targets: no smoother trajectory than these allow."""
STAND_SPEED = 0.25
"""[m/s] Slower than this over `STAND_S` is a standstill."""
STAND_S = 1.0
"""[s] Time over which `STAND_SPEED` is measured."""
CREEP_M = 0.6
"""[m] An object that moves further than this meanwhile does not stand, but drives slowly."""
BRAKING_S = 0.6
"""[s] Time that braking and driving off may take from either end of a standstill if they would be too hard
otherwise."""
TIE = 1e7
"""Weight of the steps at a standstill: far above every other penalty, so that nothing moves there."""
OUTLIER_M = 0.5
"""[m] A position this far from the smooth path has half the weight."""
MAX_ROUNDS = 6
"""Maximum number of solutions until no vehicle rolls back; remaining backward steps are then set to zero."""
HITCH = 0.28
"""Distance from the box centre to the rear axle, as a share of the length."""
SHORTEST_FRAMES = 4
"""The fewest frames that have a third difference."""
FIRST_M, FIRST_RAD = 1.0, float(np.radians(20.0))
"""Largest angle between the box and the course over the first metre after driving off."""
ACROSS_RAD = float(np.radians(45.0))
"""A box turned further than this against the motion, modulo pi, does not tell the heading."""


@dataclass(frozen=True)
class _Batch:
    """Stretches without gaps, stacked: arrays (K, T, ...), padded at the end with frames of zero weight."""

    xy: Float
    valid: Bool
    vehicle: Bool
    """Whether the object is a vehicle, (K,)."""
    yaw: Float
    length: Float
    """Length [m] of the object, (K,)."""


def reconstruct_tracks(tracks: Sequence[RecordedTrack], dt_s: float) -> tuple[RecordedTrack, ...]:
    """Return smooth trajectories of cleaned tracks on the same frames; parked objects get one position."""
    moving = [(n, run) for n, track in enumerate(tracks) if not track.parked for run in find_runs(track.valid)]
    long = [(n, run) for n, run in moving if run.stop - run.start >= SHORTEST_FRAMES]
    results = [hold_still(track) if track.parked else track for track in tracks]
    if long:
        batch = _stack_runs(tracks, long)
        xy, yaw = _reconstruct_batch(batch, dt_s)
        for row, (n, run) in enumerate(long):
            results[n] = _replace_run(results[n], run, xy[row], yaw[row])
    return tuple(results)


def _stack_runs(tracks: Sequence[RecordedTrack], stretches: Sequence[tuple[int, slice]]) -> _Batch:
    frames = max(run.stop - run.start for _, run in stretches)
    xy, yaw = np.zeros((len(stretches), frames, 2)), np.zeros((len(stretches), frames))
    valid = np.zeros((len(stretches), frames), dtype=np.bool_)
    for row, (n, run) in enumerate(stretches):
        size = run.stop - run.start
        xy[row, :size], yaw[row, :size], valid[row, :size] = tracks[n].xy[run], tracks[n].yaw[run], True
    vehicle = np.array([tracks[n].category.kind is not Kind.PEDESTRIAN for n, _ in stretches], dtype=np.bool_)
    length = np.array([np.nanmedian(tracks[n].length) for n, _ in stretches])
    return _Batch(xy, valid, vehicle, yaw, np.nan_to_num(length, nan=4.5))


def _replace_run(track: RecordedTrack, run: slice, xy: Float, yaw: Float) -> RecordedTrack:
    size = run.stop - run.start
    x, y, heading = track.x.copy(), track.y.copy(), track.yaw.copy()
    x[run], y[run], heading[run] = xy[:size, 0], xy[:size, 1], yaw[:size]
    return replace(track, x=x, y=y, yaw=heading)


def _reconstruct_batch(batch: _Batch, dt_s: float) -> tuple[Float, Float]:
    """Return positions (K, T, 2) and headings (K, T), smoothed only as far as necessary."""
    weights = _compute_robust_weights(batch)
    calm = smooth_positions(batch.xy, weights, np.full((len(weights), weights.shape[1] - 3), CALM_PENALTY))
    batch = replace(batch, yaw=_select_headings(batch.yaw, _compute_headings(batch, calm)))
    standing = _find_standstill(batch, calm, dt_s)
    tracks, frames = weights.shape
    xy = _smooth_with_standstill(batch, weights, standing, np.full((tracks, frames - 3), JERK_PENALTY))
    for row in range(tracks):
        if _is_rough(xy[row][batch.valid[row]], dt_s):
            course = calm[row] + weights[row, :, None] * (batch.xy[row] - calm[row])
            xy[row] = _bound_trajectory(batch, row, (course, standing[row], xy[row]), dt_s)
    return xy, _compute_headings(batch, xy)


def _bound_trajectory(batch: _Batch, row: int, start: tuple[Float, Bool, Float], dt_s: float) -> Float:
    """Return positions (T, 2) of one track within the bounds; unchanged if those deviate too far from the log."""
    course, standing, xy = start
    size = int(batch.valid[row].sum())
    raw, heading = batch.xy[row, :size], batch.yaw[row, : size - 1] if batch.vehicle[row] else None
    for still in (standing[: size - 1], _shorten_standstills(standing[: size - 1], round(BRAKING_S / dt_s))):
        for wanted in (course[:size], raw):
            result = fit_bounded_trajectory(
                wanted, TrajectoryBounds(JERK_BOUND, ACCELERATION_BOUND, still, heading), dt_s
            )
            result = _enforce_standstill(result, still, heading)
            if _is_near_log(result, raw) and not _is_rough(result, dt_s):
                return np.concatenate((result, xy[size:]))
    return xy


def _shorten_standstills(standing: Bool, frames: int) -> Bool:
    """Remove the first and last frames of every standstill (T-1,), except at the ends of the track."""
    padded = np.pad(standing, frames, constant_values=True)
    return np.asarray(np.lib.stride_tricks.sliding_window_view(padded, 2 * frames + 1).all(axis=-1))


def _enforce_standstill(xy: Float, still: Bool, heading: Float | None) -> Float:
    """Return the path (T, 2) with exact standstill and no step backward; `fit_bounded_trajectory` meets both within
    millimetres."""
    step = np.where(still[:, None], 0.0, np.diff(xy, axis=0))
    if heading is not None:
        ahead = np.column_stack((np.cos(heading), np.sin(heading)))
        step = step - np.minimum((step * ahead).sum(axis=1), 0.0)[:, None] * ahead
    path = np.concatenate((np.zeros((1, 2)), np.cumsum(step, axis=0)))
    return path + np.mean(xy - path, axis=0)


def _select_headings(box: Float, follows: Float) -> Float:
    """Return the headings of the log, but where the box lies across its course, those of a car that follows the
    course."""
    return np.where(np.abs(np.sin(box - follows)) < np.sin(ACROSS_RAD), box, follows)


def _is_near_log(xy: Float, raw: Float) -> bool:
    """Return whether a trajectory is within the fidelity limits of the log; a log that is implausible throughout stays
    rough."""
    off = np.hypot(*(xy - raw).T)
    return compute_median(off) <= ERROR_MEDIAN and compute_percentile(off, 95) <= ERROR_P95


def _is_rough(xy: Float, dt_s: float) -> bool:
    """Return whether a trajectory exceeds the jerk or acceleration limits; False if it is shorter than the derivative
    window."""
    if len(xy) < WINDOW:
        return False
    jerk = jerk_magnitudes(xy, dt_s)
    return bool(
        compute_percentile(jerk, 95) > JERK_P95
        or jerk.max() > JERK_MAX
        or acceleration_magnitudes(xy, dt_s).max() > ACCELERATION_MAX
    )


def _compute_robust_weights(batch: _Batch) -> Float:
    """Return weights (K, T): 1, less where a position deviates from the smooth course of its neighbours."""
    weights = batch.valid.astype(np.float64)
    for _ in range(2):
        course = smooth_positions(batch.xy, weights, np.full((len(weights), weights.shape[1] - 3), CALM_PENALTY / 10))
        off = np.hypot(*np.moveaxis(batch.xy - course, -1, 0))
        weights = batch.valid / (1 + (off / OUTLIER_M) ** 2)
    return weights


def _find_standstill(batch: _Batch, calm: Float, dt_s: float) -> Bool:
    """Return a mask (K, T-1): less than `STAND_SPEED` over `STAND_S` around the step."""
    frames = batch.xy.shape[1]
    half = max(round(STAND_S / dt_s / 2), 1)
    step_numbers = np.arange(frames - 1)
    last = batch.valid.sum(axis=1)[:, None] - 1
    low, high = np.maximum(step_numbers - half + 1, 0)[None, :], np.minimum(step_numbers + half, np.maximum(last, 1))
    rows = np.arange(len(calm))[:, None]
    gone = calm[rows, np.maximum(high, low + 1)] - calm[rows, low]
    speed = np.hypot(gone[..., 0], gone[..., 1]) / (np.maximum(high - low, 1) * dt_s)
    slow = (speed < STAND_SPEED) & (step_numbers[None, :] < last)
    return _keep_lasting(slow, calm, half - 1)


def _keep_lasting(slow: Bool, calm: Float, least: int) -> Bool:
    """Keep runs of at least `least` slow frames that end where they began: shorter runs are slow moments, the others
    creep forward."""
    result = np.zeros_like(slow)
    for n, row in enumerate(slow):
        for run in find_runs(row):
            around = calm[n, run.start : run.stop + 1]
            if run.stop - run.start >= least and np.hypot(*np.ptp(around, axis=0)) < CREEP_M:
                result[n, run] = True
    return result


def _smooth_with_standstill(batch: _Batch, weights: Float, standing: Bool, stiff: Float) -> Float:
    """Return smoothed positions (K, T, 2) with standstill held; steps of vehicles against their heading are held as
    well."""
    tied = standing.copy()
    xy = batch.xy
    for _ in range(MAX_ROUNDS):
        xy = smooth_positions(batch.xy, weights, stiff, np.where(tied, TIE, 0.0))
        back = _find_backward_steps(batch, xy) & ~tied
        if not back.any():
            break
        tied |= back
    return _hold_positions(xy, tied | _find_backward_steps(batch, xy))


def _find_backward_steps(batch: _Batch, xy: Float) -> Bool:
    """Return a mask (K, T-1): the vehicle moves against its heading."""
    moved = np.diff(xy, axis=1)
    ahead = moved[..., 0] * np.cos(batch.yaw[:, :-1]) + moved[..., 1] * np.sin(batch.yaw[:, :-1])
    return (ahead < 0) & batch.vehicle[:, None] & batch.valid[:, 1:]


def _hold_positions(xy: Float, tied: Bool) -> Float:
    """Set consecutive held frames to exactly the position of the first."""
    frames = xy.shape[1]
    first = np.maximum.accumulate(
        np.where(np.pad(~tied, ((0, 0), (1, 0)), constant_values=True), np.arange(frames), 0), 1
    )
    return np.take_along_axis(xy, first[..., None], axis=1)


def _compute_headings(batch: _Batch, xy: Float) -> Float:
    """Return headings (K, T): of vehicles that of a box whose rear axle follows its centre, of pedestrians that of
    motion, held at standstill.

    With the centre going straight by ds, the angle between box and course shrinks: tan(b/2) by exp(-ds/hitch).
    """
    hitch = np.where(batch.vehicle, np.maximum(HITCH * batch.length, 0.3), 0.2)
    moved = np.diff(xy, axis=1)
    step = np.hypot(moved[..., 0], moved[..., 1])
    course = np.arctan2(moved[..., 1], moved[..., 0])
    yaw = np.empty(batch.yaw.shape)
    yaw[:, 0] = _compute_first_heading(batch, xy)
    for k in range(step.shape[1]):
        away = wrap_angles(yaw[:, k] - course[:, k])
        shrunk = 2 * np.arctan(np.tan(away / 2) * np.exp(-step[:, k] / hitch))
        yaw[:, k + 1] = np.where(step[:, k] > 0, course[:, k] + shrunk, yaw[:, k])
    return wrap_angles(yaw)


def _compute_first_heading(batch: _Batch, xy: Float) -> Float:
    """Return the initial heading (K,): that of the log, or the course over the first metre if the log's box lies across
    it. Cars may reverse."""
    away = np.hypot(*np.moveaxis(xy - xy[:, :1], -1, 0))
    reached = np.where(batch.valid & (away > FIRST_M), np.arange(xy.shape[1]), xy.shape[1]).min(axis=1)
    moves = reached < xy.shape[1]
    gone = xy[np.arange(len(xy)), np.minimum(reached, xy.shape[1] - 1)] - xy[:, 0]
    course = np.arctan2(gone[:, 1], gone[:, 0])
    wrong = moves & ~(np.abs(np.sin(batch.yaw[:, 0] - course)) < np.sin(FIRST_RAD))
    return np.where(wrong, course, np.nan_to_num(batch.yaw[:, 0]))
