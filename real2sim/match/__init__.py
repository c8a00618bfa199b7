"""Match tracks and waypoints to the lanes of a network."""

from real2sim.match.lane_matcher import LaneMatch, match_track

__all__ = ["LaneMatch", "match_track"]
