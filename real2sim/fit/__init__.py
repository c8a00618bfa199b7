"""Reconstructed tracks of a log become the traffic of a scenario."""

from real2sim.fit.cavs import choose_cavs, explain_unusable, explain_unused_cavs
from real2sim.fit.traffic_fit import Disposition, FittedTraffic, TrackRole, fit_traffic, make_scenario_names

__all__ = [
    "Disposition",
    "FittedTraffic",
    "TrackRole",
    "choose_cavs",
    "fit_traffic",
    "explain_unused_cavs",
    "make_scenario_names",
    "explain_unusable",
]
