"""Errors of a plan against what was recorded: displacement, time to collision, and overlap of boxes (protocol 13)."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mdrive_sumo.contract import Plan
from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Bool, Float, Int, boxes_corners, boxes_overlap
from mdrive_sumo.core.state import DT
from mdrive_sumo.episode import EpisodeRecord


@dataclass(frozen=True, slots=True)
class PlanErrorParameters:
    """Horizon and bounds of the open-loop metrics (paper, evaluation metrics; protocol 13.1)."""

    points: int = 6
    step_s: float = 0.5
    min_ttc_s: float = 0.9
    max_lateral_m: float = 3.5
    min_closing_speed: float = 1e-6
    """[m/s] Below, nothing is approached. Our own choice: the paper does not define its time to collision."""


PARAMETERS = PlanErrorParameters()
STEP_TICKS = round(PARAMETERS.step_s / DT)
HORIZON_TICKS = PARAMETERS.points * STEP_TICKS
"""Length of what is compared: 3 s."""


class PlanErrors(NamedTuple):
    """Errors of one plan."""

    ade: float
    """Mean distance of the six points from the recorded drive [m]."""
    fde: float
    """Distance of the last one, after 3 s [m]."""
    near: bool
    """Whether the plan comes within a time to collision of 0.9 s of a road user less than 3.5 m aside."""
    near_mdrive: bool
    """Whether anything is less than 3.5 m aside of its point at 0.5 s, at any distance ahead (K10)."""
    overlaps: bool
    """Whether its box overlaps another at one of the six points."""


def compute_plan_errors(episode: EpisodeRecord, tick: int, column: int, plan: Plan) -> PlanErrors | None:
    """Return the errors of a plan that the agent of a CAV made in a tick.

    None if the plan is shorter than 3 s, or the CAV's recorded drive ends before them.
    """
    ticks = tick + STEP_TICKS * np.arange(1, PARAMETERS.points + 1)
    if ticks[-1] >= episode.ticks or not episode.valid[ticks, column].all():
        return None
    points = sample_plan(plan, (float(episode.x[tick, column]), float(episode.y[tick, column])))
    if points is None:
        return None
    apart = portable.hypot(points[:, 0] - episode.x[ticks, column], points[:, 1] - episode.y[ticks, column])
    others = np.array([other for other in range(len(episode.ids)) if other != column], dtype=np.int64)
    motion = _PlannedMotion.derive(episode, tick, column, points)
    return PlanErrors(
        ade=math.fsum(apart.tolist()) / len(apart),
        fde=float(apart[-1]),
        near=bool(_find_near(episode, ticks, column, others, motion).any()),
        near_mdrive=_is_near_aside(episode, tick, int(ticks[0]), column, others, points[0]),
        overlaps=_overlaps(episode, ticks, column, others, motion),
    )


def sample_plan(plan: Plan, start: tuple[float, float]) -> Float | None:
    """Return the points (6, 2) [m] of a plan after 0.5 to 3 s, linear between its own; None if it is shorter.

    start: where the CAV is now [m].
    """
    times = np.arange(len(plan.points) + 1) * plan.interval_s
    wanted = PARAMETERS.step_s * np.arange(1, PARAMETERS.points + 1)
    if times[-1] < wanted[-1] - 1e-9:
        return None
    path = np.concatenate((np.array([start]), plan.points))
    return np.stack([np.interp(wanted, times, path[:, axis]) for axis in (0, 1)], axis=-1)


class _PlannedMotion(NamedTuple):
    """States at the six points; where the plan stands still, the yaw is the one before."""

    points: Float
    """(6, 2) [m]"""
    yaw: Float
    """(6,) [rad]"""
    speed: Float
    """(6,) [m/s], from the point before."""

    @classmethod
    def derive(cls, episode: EpisodeRecord, tick: int, column: int, points: Float) -> "_PlannedMotion":
        start = np.array([[episode.x[tick, column], episode.y[tick, column]]])
        steps = np.diff(np.concatenate((start, points)), axis=0)
        lengths = portable.hypot(steps[:, 0], steps[:, 1])
        yaw = np.empty(len(steps))
        last = float(episode.yaw[tick, column])
        for i, (dx, dy) in enumerate(steps.tolist()):
            last = portable.atan2(dy, dx) if lengths[i] > 0.1 else last
            yaw[i] = last
        return cls(points, yaw, lengths / PARAMETERS.step_s)


def _find_near(episode: EpisodeRecord, ticks: Int, column: int, others: Int, motion: _PlannedMotion) -> Bool:
    """Return a (6, M) mask of the points and road users within the bounds; both keep their speed of that moment.

    The time to collision is the gap between the boxes along the CAV's direction divided by the closing speed.
    """
    cos, sin = (values[:, None] for values in portable.cos_sin(motion.yaw))
    cells = np.ix_(ticks, others)
    dx, dy = episode.x[cells] - motion.points[:, :1], episode.y[cells] - motion.points[:, 1:]
    ahead, aside = cos * dx + sin * dy, cos * dy - sin * dx
    other_cos, other_sin = portable.cos_sin(episode.yaw[cells])
    closing = motion.speed[:, None] - episode.speed[cells] * (other_cos * cos + other_sin * sin)
    gap = np.maximum(ahead - (episode.length[others] + episode.length[column]) / 2, 0.0)
    soon = (ahead > 0.0) & (closing > PARAMETERS.min_closing_speed) & (gap < PARAMETERS.min_ttc_s * closing)
    return episode.valid[cells] & soon & (np.abs(aside) < PARAMETERS.max_lateral_m)


def _is_near_aside(episode: EpisodeRecord, tick: int, then: int, column: int, others: Int, point: Float) -> bool:
    """Return what the original code flags: an offset across the present heading below the bound at 0.5 s."""
    cos, sin = portable.cos_sin(float(episode.yaw[tick, column]))
    dx, dy = episode.x[then, others] - point[0], episode.y[then, others] - point[1]
    aside = np.abs(cos * dy - sin * dx)
    return bool((episode.valid[then, others] & (aside < PARAMETERS.max_lateral_m)).any())


def _overlaps(episode: EpisodeRecord, ticks: Int, column: int, others: Int, motion: _PlannedMotion) -> bool:
    cells = np.ix_(ticks, others)
    x, y = motion.points[:, 0], motion.points[:, 1]
    own = boxes_corners(x, y, motion.yaw, episode.length[column], episode.width[column])
    boxes = boxes_corners(
        episode.x[cells], episode.y[cells], episode.yaw[cells], episode.length[others], episode.width[others]
    )
    return bool((episode.valid[cells] & boxes_overlap(own[:, None], boxes)).any())
