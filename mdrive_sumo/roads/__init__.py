"""Road networks: lanes, routing, stop lines, buildings. The only room that imports sumolib."""

from mdrive_sumo.roads.network_file import BusStop, DrivableArea, NetworkFile, ParkingRow, StopSignBox, YieldSign
from mdrive_sumo.roads.road_map import (
    Footway,
    Lane,
    RoadMap,
    find_network_folder,
    list_packaged_networks,
    load_road_map,
)
from mdrive_sumo.roads.routing import Route, build_lane_route, find_lane_path, join_route_pieces

__all__ = [
    "Lane",
    "RoadMap",
    "load_road_map",
    "find_network_folder",
    "list_packaged_networks",
    "NetworkFile",
    "DrivableArea",
    "StopSignBox",
    "YieldSign",
    "Footway",
    "ParkingRow",
    "BusStop",
    "Route",
    "join_route_pieces",
    "find_lane_path",
    "build_lane_route",
]
