"""Match tracks and waypoints to the lanes of a network."""

from real2sim.match.lane_matcher import Match, match

__all__ = ["Match", "match"]
