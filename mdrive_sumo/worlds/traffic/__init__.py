"""Traffic of a world beside its CAVs, drawn for any network by a named demand."""

from mdrive_sumo.worlds.traffic.draw_traffic import Traffic, draw_traffic
from mdrive_sumo.worlds.traffic.traffic_demand import DEMANDS, TrafficDemand, find_demand

__all__ = ["DEMANDS", "Traffic", "TrafficDemand", "draw_traffic", "find_demand"]
