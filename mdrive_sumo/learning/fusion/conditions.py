"""Conditions under which detectors are measured: which scan of a sender arrives, and where it seems to be."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mdrive_sumo.agents.learned.fusion_spec import DELAYS_TICKS, MAX_CAVS
from mdrive_sumo.core.clock import TICKS_PER_SECOND
from mdrive_sumo.core.seeding import draw_normals
from mdrive_sumo.learning.fusion.frames import FusionFrames


@dataclass(frozen=True, slots=True)
class SharingCondition:
    """Errors of what senders share; those of the pose are normal, for each sender and frame anew."""

    name: str
    pose_error_m: float = 0.0
    """Standard deviation of x and of y."""
    pose_error_deg: float = 0.0
    """Standard deviation of the yaw [degrees]."""
    delay_ticks: int = 0
    """One of DELAYS_TICKS."""
    uses_estimates: bool = False
    """Whether errors are added to estimated poses instead of true ones."""


CONDITIONS = (
    SharingCondition("clean"),
    SharingCondition("0.2 m", 0.2, 0.2),
    SharingCondition("0.4 m", 0.4, 0.4),
    SharingCondition("0.6 m", 0.6, 0.6),
    SharingCondition("100 ms", delay_ticks=2),
    SharingCondition("300 ms", delay_ticks=6),
    SharingCondition("0.2 m, 100 ms", 0.2, 0.2, 2),
    SharingCondition("estimated", uses_estimates=True),
)
"""Columns of the tables. V2XSet's noise has 0.2 m and 0.2 degrees; as there, degrees grow with metres."""


@dataclass(frozen=True, slots=True)
class SharedScans:
    """What senders share of some frames under a condition. Slot 0 is the own car."""

    scan: npt.NDArray[np.int32]
    """(F, MAX_CAVS) index of a scan; -1: none."""
    pose: npt.NDArray[np.float32]
    """(F, MAX_CAVS, 3) x, y [m], yaw [rad] in the own frame, as the receiver takes it to be; 0 where there is none."""
    age_s: npt.NDArray[np.float32]
    """(F, MAX_CAVS)"""


def choose_scans(frames: FusionFrames, condition: SharingCondition, seed: int = 0) -> SharedScans:
    """Return what is shared; the same frame, condition and seed have the same errors in any data set."""
    delay = np.zeros(MAX_CAVS, np.int64)
    delay[1:] = DELAYS_TICKS.index(condition.delay_ticks)
    cars = np.arange(MAX_CAVS)
    scan = frames.scan[:, cars, delay]
    base = frames.estimated_pose if condition.uses_estimates else frames.true_pose
    pose = np.where(scan[..., None] >= 0, base[:, cars, delay], np.float32(0.0))
    if condition.pose_error_m or condition.pose_error_deg:
        scales = np.array((condition.pose_error_m, condition.pose_error_m, np.radians(condition.pose_error_deg)))
        for i, car in zip(*np.nonzero(scan[:, 1:] >= 0), strict=True):
            place = frames.places[frames.place[i]]
            drawn = draw_normals(
                seed, "fusion pose error", condition.name, place, int(frames.episode[i]), int(frames.tick[i]), int(car)
            )
            pose[i, car + 1] += scales * drawn[:3]
    ages = np.asarray(DELAYS_TICKS, np.float32)[delay] / np.float32(TICKS_PER_SECOND)
    return SharedScans(scan, pose, np.where(scan >= 0, ages, np.float32(0.0)))
