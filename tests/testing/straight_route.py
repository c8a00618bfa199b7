"""A briefing with a straight route of 100 m along +x, for environments. No tests in here."""

import numpy as np

from mdrive_sumo.contract import Briefing, OwnState
from mdrive_sumo.loop import VEHICLE
from mdrive_sumo.vehicle import dynamics


def make_straight_briefing() -> Briefing:
    """Return the briefing of a CAV that starts at the origin; the limit is 10 m/s."""
    s = np.arange(101.0)
    return Briefing(
        ego_id="a", seed=0, tick_s=0.05, time_limit_s=50.0, vehicle=dynamics.to_vehicle_facts(VEHICLE),
        route_xy=np.stack((s, np.zeros(101)), axis=-1), route_yaw=np.zeros(101), route_s=s,
        route_lane_width=np.full(101, 3.5), route_speed_limit=np.full(101, 10.0),
    )  # fmt: skip


def make_own_state(x: float, y: float = 0.0, yaw: float = 0.0, speed: float = 0.0) -> OwnState:
    """Return an exact own state."""
    return OwnState(x, y, yaw, speed, 0.0, 0.0, 0.0)
