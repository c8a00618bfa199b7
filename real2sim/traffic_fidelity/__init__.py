"""How close reactive traffic stays to the log while the CAVs repeat what they did in the log."""

from real2sim.traffic_fidelity.traffic_fidelity import (
    MEDIAN_5S_M,
    ORDER_SHARE,
    PositionErrors,
    TrafficFidelity,
    measure_traffic_fidelity,
)

__all__ = ["MEDIAN_5S_M", "ORDER_SHARE", "TrafficFidelity", "PositionErrors", "measure_traffic_fidelity"]
