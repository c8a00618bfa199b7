"""Classes of background vehicles: their boxes and how they are driven."""

from collections.abc import Mapping
from dataclasses import dataclass

from mdrive_sumo.scenario.background import BackgroundVehicle, CarFollowing
from mdrive_sumo.worlds.placement.background_vehicles import DRIVING, FAST_DRIVING
from mdrive_sumo.worlds.placement.bodies import BODY_SIZES


@dataclass(frozen=True, slots=True)
class VehicleClass:
    """Length and width [m] of the box, without mirrors, and car following."""

    length: float
    width: float
    driving: CarFollowing


VEHICLE_CLASSES: Mapping[str, VehicleClass] = {
    "car": VehicleClass(*BODY_SIZES["car"], DRIVING["car"]),
    "van": VehicleClass(*BODY_SIZES["van"], DRIVING["van"]),
    "truck": VehicleClass(*BODY_SIZES["truck"], FAST_DRIVING["truck"]),
    "bus": VehicleClass(*BODY_SIZES["bus"], CarFollowing(sigma=0.2, accel=1.2, decel=4.0, tau_s=1.4, max_speed=27.0)),
    "motorcycle": VehicleClass(2.2, 0.8, CarFollowing(sigma=0.2, accel=4.0)),
    "emergency": VehicleClass(*BODY_SIZES["ambulance"], CarFollowing(sigma=0.0, accel=2.6, tau_s=0.8)),
}
"""Buses are governed at 100 km/h (EU directive 2002/85/EC), motorcycles accelerate more than cars, and ambulances keep
less distance: chosen. The others drive as in `placement.background_vehicles`."""
LARGE = frozenset({"truck", "bus"})
"""Their boxes cut corners: they drive on ways that fit them only."""


def build_vehicle(class_name: str, edges: tuple[str, ...], **fields: object) -> BackgroundVehicle:
    """Return a vehicle of a class without a final id; `fields`: departure and whatever else differs.

    A cyclist's model is no class: its fields hold its body."""
    kind = VEHICLE_CLASSES.get(class_name, VEHICLE_CLASSES["car"])
    body = {"length": kind.length, "width": kind.width, "driving": kind.driving}
    return BackgroundVehicle.model_validate({"id": "bg", "edges": edges, "depart_s": 0.0, **body, **fields})
