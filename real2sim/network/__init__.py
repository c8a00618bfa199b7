"""Build a SUMO network from the map of a log."""

from real2sim.network.network_builder import NetworkReport, build_network

__all__ = ["NetworkReport", "build_network"]
