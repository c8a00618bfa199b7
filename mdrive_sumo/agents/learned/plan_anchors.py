"""Plan anchors: a fixed vocabulary of trajectories that a plan head scores, and the plan that its scores decide.

Scored anchors are a way to answer one of several futures (brake or go) where the mean of them is none: VADv2 (Chen et
al., 2024), Hydra-MDP (Li et al., 2024). Theirs are clustered from data; these come from kinematics, without a file.
"""

import hashlib
import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from mdrive_sumo.agents.learned.system_spec import PLAN_INTERVAL_S, PLAN_POINTS
from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float

ANCHORS = 384
"""Trajectories of the vocabulary: any candidate of 10 to 20 m lies 0.45 m from one on average, 0.6 m with 256."""
SCORES = ("imitation", "collision", "lane", "progress", "comfort")
"""Columns of the scores: logarithms of the probability that the expert takes the anchor, and that it is good."""
SCORE_WEIGHTS = (1.0, 1.0, 0.5, 0.5, 0.2)
"""Weights of the scores in the choice. Chosen: imitation leads, because no label knows lights and signs."""
MODE_M = 1.0
"""[m] Mean distance up to which a plan is of the chosen one's kind: with it, it is averaged."""
MODE_SCORE = 2.0
"""A plan whose weighted score is lower by that much than the best has no weight in the average."""
STEP_S = 0.05
"""Step of integration: that of a tick."""
PLAN_S = PLAN_POINTS * PLAN_INTERVAL_S
MOST_SPEED = 33.4
"""[m/s] 120 km/h, the fastest road of the places of training."""
SPEEDS = (*range(11), 12, 14, 16, 18, 21, 24, 27, 30, 33)
"""[m/s] At the beginning of a trajectory; steps grow with the speed."""
ACCELERATIONS = (-8, -6, -4.5, -3, -2, -1, 0, 1, 2, 3)
"""[m/s2] From full braking on a dry road to pulling away briskly; kept until standing or `MOST_SPEED`."""
MOST_LATERAL = 4.9
"""[m/s2] Bound of comfort of nuPlan (`scoring.metrics.comfort`)."""
TURN_RADII_M = (6.0, 9.0, 14.0, 22.0)
"""Turns at junctions and in roundabouts: begun now or later, over the whole or what is left of it."""
TURN_DELAYS_M = (0.0, 4.0, 8.0, 14.0)
TURN_ANGLES_DEG = (30.0, 60.0, 90.0)
CURVE_RADII_M = (40.0, 80.0, 160.0, 400.0)
"""Curves of roads, and changes of lane over a plan's length."""
LEAST_TURN_RAD = 0.01
"""Trajectories that turn less are the straight one again."""
NEAR_M = 40.0
"""Trajectories are chosen at equal distances after r -> r / (1 + r / NEAR_M): far ones lie farther apart."""


@dataclass(frozen=True, slots=True)
class PlanAnchors:
    """The vocabulary, in the ego frame (x ahead, y left)."""

    points: Float
    """(ANCHORS, PLAN_POINTS, 2) [m]"""
    yaws: Float
    """(ANCHORS, PLAN_POINTS) [rad]"""
    digest: str
    """Hexadecimal, of the points in millimetres: weights are those of one vocabulary."""


@lru_cache(maxsize=1)
def build_anchors() -> PlanAnchors:
    """Return the vocabulary: of all candidates the standing one, and ever the one farthest from those chosen before."""
    poses = _build_candidates()
    reach = portable.hypot(poses[..., 0].ravel(), poses[..., 1].ravel()).reshape(poses.shape[:2])
    warped = poses[..., :2] / (1.0 + reach / NEAR_M)[..., None]
    columns = warped.reshape(len(poses), -1).T
    chosen = [0]
    gap = _measure_gaps(columns, 0)
    while len(chosen) < ANCHORS:
        farthest = int(np.argmax(gap))
        chosen.append(farthest)
        gap = np.minimum(gap, _measure_gaps(columns, farthest))
    points, yaws = poses[chosen, :, :2], poses[chosen, :, 2]
    millimetres = np.rint(1e3 * points).astype("<i4")
    return PlanAnchors(points, yaws, hashlib.sha256(millimetres.tobytes()).hexdigest()[:16])


def _measure_gaps(columns: Float, row: int) -> Float:
    """Return the squared distances (N,) of all candidates, columns (numbers, N), from one; added in one order."""
    total = np.zeros(columns.shape[1])
    for column in columns:
        step = column - column[row]
        total += step * step
    return total


def _build_candidates() -> Float:
    """Return poses (N, PLAN_POINTS, 3) x, y [m], yaw [rad] of all pairs of pace and path a car can drive; 0 stands."""
    distances, speeds = _build_paces()
    shapes = [(0.0, 0.0, 0.0), *_list_turns()]
    return np.concatenate([_drive_path(distances, speeds, *shape) for shape in shapes])


def _build_paces() -> tuple[Float, Float]:
    """Return distances [m] and speeds [m/s] (paces, steps + 1) over a plan's time."""
    times = STEP_S * np.arange(round(PLAN_S / STEP_S) + 1, dtype=np.float64)
    speed, acceleration = (each.ravel() for each in np.meshgrid(SPEEDS, ACCELERATIONS, indexing="ij"))
    speeds = np.clip(speed[:, None] + acceleration[:, None] * times, 0.0, MOST_SPEED)
    steps = (speeds[:, 1:] + speeds[:, :-1]) * (STEP_S / 2.0)
    return np.concatenate((np.zeros((len(steps), 1)), np.cumsum(steps, axis=1)), axis=1), speeds


def _list_turns() -> list[tuple[float, float, float]]:
    """Return distance to its beginning [m], curvature [1/m] and angle [rad] of every turn, to both sides."""
    turns = [(delay, radius, 90.0) for radius in TURN_RADII_M for delay in TURN_DELAYS_M]
    turns += [(0.0, radius, angle) for radius in TURN_RADII_M for angle in TURN_ANGLES_DEG[:-1]]
    turns += [(0.0, radius, TURN_ANGLES_DEG[-1]) for radius in CURVE_RADII_M]
    return [(delay, side / radius, math.radians(angle)) for side in (1.0, -1.0) for delay, radius, angle in turns]


def _drive_path(distances: Float, speeds: Float, delay_m: float, curvature: float, angle: float) -> Float:
    """Return poses (n, PLAN_POINTS, 3) of the paces at which a path can be driven: straight, an arc, straight again."""
    sharpness = abs(curvature)
    turned = np.clip(sharpness * (distances - delay_m), 0.0, angle)
    is_turning = (distances >= delay_m) & (turned < angle)
    lateral = speeds * speeds * sharpness * is_turning
    is_driven = np.all(lateral <= MOST_LATERAL, axis=1)
    if curvature:
        is_driven &= turned[:, -1] > LEAST_TURN_RAD
    yaw = turned[is_driven] * math.copysign(1.0, curvature)
    step = np.diff(distances[is_driven], axis=1)
    cos, sin = portable.cos_sin((yaw[:, 1:] + yaw[:, :-1]) / 2.0)
    poses = np.stack((np.cumsum(step * cos, axis=1), np.cumsum(step * sin, axis=1), yaw[:, 1:]), axis=-1)
    every = round(PLAN_INTERVAL_S / STEP_S)
    return poses[:, every - 1 :: every]


def decode_plans(scores: npt.NDArray[np.float32], offsets: npt.NDArray[np.float32]) -> Float:
    """Return the plans (..., PLAN_POINTS, 2) [m, ego frame] that scores and offsets of all anchors decide.

    scores: (..., ANCHORS, len(SCORES)) logarithms. offsets: (..., ANCHORS, PLAN_POINTS, 2) [m], added to the anchors.
    The best anchor decides; what lies near its plan and is nearly as good is averaged with it, so that rounding does
    not decide between neighbours.
    """
    total = np.zeros(scores.shape[:-1])
    for column, weight in enumerate(SCORE_WEIGHTS):
        total += weight * scores[..., column].astype(np.float64)
    plans = build_anchors().points + offsets
    best = np.argmax(total, axis=-1)[..., None]
    leader = np.take_along_axis(plans, best[..., None, None], axis=-3)
    step = plans - leader
    gap = np.sqrt(step[..., 0] * step[..., 0] + step[..., 1] * step[..., 1]).mean(axis=-1)
    behind = np.take_along_axis(total, best, axis=-1) - total
    weight = np.maximum(1.0 - behind / MODE_SCORE, 0.0) * (gap <= MODE_M)
    share = weight / weight.sum(axis=-1, keepdims=True)
    return (plans * share[..., None, None]).sum(axis=-3)
