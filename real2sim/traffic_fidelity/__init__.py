"""How close reactive traffic stays to the log while the CAVs repeat what they did in the log."""

from real2sim.traffic_fidelity.traffic_fidelity import MEDIAN_5S_M, ORDER_SHARE, Closeness, ErrorAt, closeness

__all__ = ["MEDIAN_5S_M", "ORDER_SHARE", "Closeness", "ErrorAt", "closeness"]
