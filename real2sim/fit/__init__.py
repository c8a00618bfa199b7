"""Reconstructed tracks of a log become the traffic of a scenario."""

from real2sim.fit.cavs import choose_cavs, passed_over, unfit
from real2sim.fit.traffic_fit import Fitted, fit, scenario_names

__all__ = ["Fitted", "choose_cavs", "fit", "passed_over", "scenario_names", "unfit"]
