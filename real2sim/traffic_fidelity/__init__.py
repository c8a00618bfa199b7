"""How close reactive traffic stays to the log while the CAVs repeat what they did in the log, and which vehicles stall
when they do not."""

from real2sim.traffic_fidelity.stalled_traffic import StalledVehicle, measure_stalled_traffic
from real2sim.traffic_fidelity.traffic_fidelity import (
    MEDIAN_5S_M,
    ORDER_SHARE,
    PositionErrors,
    TrafficFidelity,
    measure_traffic_fidelity,
)

__all__ = [
    "MEDIAN_5S_M",
    "ORDER_SHARE",
    "PositionErrors",
    "StalledVehicle",
    "TrafficFidelity",
    "measure_stalled_traffic",
    "measure_traffic_fidelity",
]
