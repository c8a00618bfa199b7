"""The gap to a vehicle ahead in the own direction: larger where its position is less certain (decision 040)."""

from dataclasses import dataclass

from mdrive_sumo.planning.parameters import PLANNER


@dataclass(frozen=True, slots=True)
class QueueGapParameters:
    """The least gap to a vehicle ahead, moving or standing, whatever smaller margin the planner has at that time."""

    exact_m: float = PLANNER.min_margin.longitudinal
    """If the position of the vehicle is exact, ..."""
    sigmas: float = 4.0
    """... and so many standard deviations of its estimated position more: a car that waits plans twice a second and
    never drives back, so that the largest of many errors counts. Tracks 6 m away, detector `lidar-single`: standard
    deviation 0.16 m, largest error of the rear end 0.44 m in 40 s at walking pace."""
    most_m: float = 1.5
    """Not more than this: the position of a vehicle that is not seen any more becomes uncertain within a second."""


QUEUE_GAP = QueueGapParameters()


def compute_queue_gap(sigma: float, parameters: QueueGapParameters = QUEUE_GAP) -> float:
    """Return the gap [m] to a vehicle ahead whose estimated position has that standard deviation [m]."""
    return min(parameters.exact_m + parameters.sigmas * sigma, parameters.most_m)
