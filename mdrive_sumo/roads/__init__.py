"""Road networks: lanes, routing, stop lines, buildings. The only room that imports sumolib."""

from mdrive_sumo.roads.network_file import NetworkFile, StopSignBox
from mdrive_sumo.roads.road_map import Lane, RoadMap, load, network_folder, packaged_networks
from mdrive_sumo.roads.routing import Route, dense_route, drivable_path, route_along

__all__ = [
    "Lane",
    "RoadMap",
    "load",
    "network_folder",
    "packaged_networks",
    "NetworkFile",
    "StopSignBox",
    "Route",
    "dense_route",
    "drivable_path",
    "route_along",
]
