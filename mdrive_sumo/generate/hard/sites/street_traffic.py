"""Reactive traffic on all streets of a place, at the speeds of their limits."""

from collections.abc import Sequence

from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.background import BackgroundVehicle
from mdrive_sumo.scenario.scenario import Ego
from mdrive_sumo.scenario.scripted_actor import Actor
from mdrive_sumo.worlds.lane_routes import find_lane_routes
from mdrive_sumo.worlds.placement.background_vehicles import list_edges
from mdrive_sumo.worlds.streams.edge_streams import TrafficStream, build_traffic

MINOR_SHARE = 0.3
"""Weight of a street of at most 30 km/h beside one of 50 km/h."""
MINOR_MPS = 9.0
"""Between 30 and 50 km/h."""


def build_street_traffic(
    roads: RoadMap, count: int, seed: str, keep_clear: Sequence[Ego | Actor]
) -> tuple[BackgroundVehicle, ...]:
    """Return reactive vehicles on the ways through a place; cars and vans alone, which stay in narrow lanes."""
    streams: dict[tuple[str, ...], TrafficStream] = {}
    for way in find_lane_routes(roads):
        first = roads.lanes[way.lanes[0]]
        edges = list_edges(roads, way.lanes)
        if way.turn == "u_turn" or len(edges) < 2 or first.speed_limit < 5.0:
            continue
        share = MINOR_SHARE if first.speed_limit < MINOR_MPS else 1.0
        streams.setdefault(edges, TrafficStream(edges, (first.index,), share, large=False))
    return build_traffic(roads, tuple(streams.values()), count, seed, keep_clear) if streams else ()
