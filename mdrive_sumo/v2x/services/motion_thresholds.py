"""How far a road user has to move before stations tell of it again: the thresholds that CAM and CPM share."""

import math
from dataclasses import dataclass

from mdrive_sumo.core.state import TICKS_PER_SECOND


@dataclass(frozen=True, slots=True)
class MotionThresholds:
    """Changes since the last message that trigger the next one, the same in both standards.

    ETSI EN 302 637-2 V1.4.1, section 6.1.3, and TS 103 324 V2.1.1, section 6.1.2.
    """

    distance_m: float = 4.0
    """[m]"""
    speed: float = 0.5
    """[m/s]"""
    heading: float = math.radians(4.0)
    """[rad]"""


MOTION_THRESHOLDS = MotionThresholds()
MIN_INTERVAL_TICKS = TICKS_PER_SECOND // 10
"""T_GenCamMin and T_GenCpmMin: 100 ms."""
MAX_INTERVAL_TICKS = TICKS_PER_SECOND
"""T_GenCamMax and T_GenCpmMax: 1 s."""
