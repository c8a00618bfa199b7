"""Classes of background vehicles: their boxes and how they are driven."""

from collections.abc import Mapping
from dataclasses import dataclass

from mdrive_sumo.scenario.background import BackgroundVehicle, CarFollowing
from mdrive_sumo.worlds.placement.bodies import BODY_SIZES


@dataclass(frozen=True, slots=True)
class VehicleClass:
    """Length and width [m] of the box, without mirrors, and car following."""

    length: float
    width: float
    driving: CarFollowing


VEHICLE_CLASSES: Mapping[str, VehicleClass] = {
    "car": VehicleClass(*BODY_SIZES["car"], CarFollowing(sigma=0.2)),
    "van": VehicleClass(*BODY_SIZES["van"], CarFollowing(sigma=0.2, accel=2.0)),
    "truck": VehicleClass(
        *BODY_SIZES["truck"], CarFollowing(sigma=0.2, accel=1.2, decel=4.0, tau_s=1.4, max_speed=24.0)
    ),
    "bus": VehicleClass(*BODY_SIZES["bus"], CarFollowing(sigma=0.2, accel=1.2, decel=4.0, tau_s=1.4, max_speed=27.0)),
    "motorcycle": VehicleClass(2.2, 0.8, CarFollowing(sigma=0.2, accel=4.0)),
    "emergency": VehicleClass(*BODY_SIZES["ambulance"], CarFollowing(sigma=0.0, accel=2.6, tau_s=0.8)),
}
"""Trucks are governed at 86 to 90 km/h and buses at 100 km/h (EU directives 92/6/EEC and 2002/85/EC). Heavy vehicles
accelerate less, motorcycles more, and drivers are more even than SUMO's (sigma 0.5), so that less of an outcome is
chance: chosen."""
LARGE = frozenset({"truck", "bus"})
"""Their boxes cut corners: they drive on ways that fit them only."""


def build_vehicle(class_name: str, edges: tuple[str, ...], **fields: object) -> BackgroundVehicle:
    """Return a vehicle of a class without a final id; `fields`: departure and whatever else differs.

    A cyclist's model is no class: its fields hold its body."""
    kind = VEHICLE_CLASSES.get(class_name, VEHICLE_CLASSES["car"])
    body = {"length": kind.length, "width": kind.width, "driving": kind.driving}
    return BackgroundVehicle.model_validate({"id": "bg", "edges": edges, "depart_s": 0.0, **body, **fields})
