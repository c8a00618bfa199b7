"""Vehicles that SUMO drives: their bodies, how they drive, where they depart and where they go."""

from collections.abc import Iterable, Mapping
from functools import lru_cache

from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.background import BackgroundVehicle, CarFollowing
from mdrive_sumo.worlds.lane_routes import find_lane_routes
from mdrive_sumo.worlds.placement.bodies import BODY_SIZES

DRIVING: Mapping[str, CarFollowing] = {
    "car": CarFollowing(sigma=0.2),
    "van": CarFollowing(sigma=0.2, accel=2.0),
    "truck": CarFollowing(sigma=0.2, accel=1.2, decel=4.0, tau_s=1.3),
    "bus": CarFollowing(sigma=0.2, accel=1.2, decel=4.0, tau_s=1.3),
}
"""Heavy vehicles accelerate less. Drivers are more even than SUMO's (sigma 0.5): less of the outcome is chance."""
FAST_DRIVING: Mapping[str, CarFollowing] = {
    "car": DRIVING["car"],
    "van": CarFollowing(sigma=0.2, accel=2.0, max_speed=30.0),
    "truck": CarFollowing(sigma=0.2, accel=1.2, decel=4.0, tau_s=1.4, max_speed=24.0),
}
"""On roads with high speeds. Trucks are governed at 86 to 90 km/h (EU directive 92/6/EEC), vans without a limiter; the
rest are assumptions."""

ENTRY_GAP_M = 0.5
"""[m] From the begin of a lane to the rear of a vehicle that enters there."""


def build_background_vehicle(
    model: str, edges: tuple[str, ...], depart_lane: int, driving: CarFollowing | None = None, **departure: float
) -> BackgroundVehicle:
    """Return a vehicle of a model of `BODY_SIZES` that drives along edges, without its final id.

    departure: `depart_s` [s], `depart_pos_m` [m] of the front bumper and `depart_speed` [m/s], rounded here; without
    them it stands at the begin of the first edge from the start on.
    """
    length, width = BODY_SIZES[model]
    departure = {"depart_s": 0.0, "depart_pos_m": length + ENTRY_GAP_M} | departure
    fields = {name: round(value, 2) for name, value in departure.items()}
    driving = driving or DRIVING[model]
    return BackgroundVehicle.model_validate(
        {"id": "bg", "edges": edges, "depart_lane": depart_lane, "length": length, "width": width, "driving": driving}
        | fields
    )


def number_vehicles(vehicles: Iterable[BackgroundVehicle], prefix: str = "bg") -> tuple[BackgroundVehicle, ...]:
    """Return the vehicles with ids in their order."""
    return tuple(vehicle.model_copy(update={"id": f"{prefix}{i}"}) for i, vehicle in enumerate(vehicles))


@lru_cache(maxsize=32)
def find_continuations(roads: RoadMap) -> Mapping[str, tuple[tuple[str, ...], ...]]:
    """Return by lane the edge sequences of all routes from that lane on, for lanes outside junctions."""
    edges_by_lane: dict[str, set[tuple[str, ...]]] = {}
    for way in find_lane_routes(roads):
        for k, name in enumerate(way.lanes):
            if not roads.lanes[name].junction:
                edges_by_lane.setdefault(name, set()).add(list_edges(roads, way.lanes[k:]))
    return {name: tuple(sorted(edges)) for name, edges in sorted(edges_by_lane.items())}


def list_edges(roads: RoadMap, lanes: tuple[str, ...]) -> tuple[str, ...]:
    """Return the edges of a chain of lanes, without those inside junctions."""
    ways = (roads.lanes[lane] for lane in lanes)
    return tuple(dict.fromkeys(way.edge for way in ways if not way.junction))
