"""How stations move that have warned of their own emergency braking (DENM)."""

import numpy as np

from mdrive_sumo.contract import Cause, Reason
from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import DT
from mdrive_sumo.planning.motion_prediction import TIMES, PredictedMotion
from mdrive_sumo.v2x.messages import Denm
from mdrive_sumo.v2x.services.hazard_detector import HAZARDS


def predict_braking_station(name: str, denm: Denm, tick: int) -> PredictedMotion:
    """Return the motion of a station that has warned of its emergency braking: straight on to a stop, and it stays."""
    travelled = _predict_stop(denm.speed, (tick - denm.pose.tick) * DT)
    cos, sin = portable.cos_sin(denm.pose.yaw)
    poses = np.column_stack(
        (denm.pose.x + cos * travelled, denm.pose.y + sin * travelled, np.full(len(TIMES), denm.pose.yaw))
    )
    return PredictedMotion(poses, denm.length, denm.width, Reason(Cause.ANNOUNCED, (name,)), stands_at_end=True)


def _predict_stop(speed: float, age_s: float) -> Float:
    """Return the distance (T,) [m] travelled at `TIMES`, since the state that is `age_s` old."""
    speed = max(speed, 0.0)
    braking_s = np.minimum(age_s + TIMES, speed / HAZARDS.braking)
    return speed * braking_s - HAZARDS.braking * (braking_s * braking_s) / 2
