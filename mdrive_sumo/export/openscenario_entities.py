"""OpenSCENARIO: road users and props as entities with boxes and axles."""

# pyright: reportArgumentType=false
# scenariogeneration annotates members of its enumerations with another class than it demands.
import numpy as np
from scenariogeneration import xosc

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import Kind
from mdrive_sumo.export.scored_recording import ScoredRecording
from mdrive_sumo.vehicle.dynamics import VehicleParameters

REAR_SHARE = 0.28
"""Distance from the box centre to the rear axle, as a share of the length: 1.37 m of a car of 4.9 m. Recordings have no
axles; that of a CAV is known (`VehicleParameters.rear_to_centre`)."""
WHEEL_M = 0.65
"""Diameter of wheels, which the format demands; assumed."""
MASS_KG = {"pedestrian": 75.0, "static": 50.0}
"""Assumed, as the format demands one."""
CATEGORY = {
    "car": xosc.VehicleCategory.car,
    "van": xosc.VehicleCategory.van,
    "truck": xosc.VehicleCategory.truck,
    "bus": xosc.VehicleCategory.bus,
    "motorcycle": xosc.VehicleCategory.motorbike,
    "bicycle": xosc.VehicleCategory.bicycle,
}


def compute_rear_to_centre(recording: ScoredRecording) -> Float:
    """Return how far (N,) [m] the reference point lies behind the box centre: the rear axle of vehicles, else 0."""
    record = recording.record
    is_vehicle = np.isin(record.kind, (Kind.VEHICLE, Kind.CYCLIST))
    assumed = np.where(is_vehicle, REAR_SHARE * record.length, 0.0)
    return np.where(np.arange(len(record.ids)) < record.egos, VehicleParameters().rear_to_centre, assumed)


def build_entity(
    recording: ScoredRecording, column: int, name: str
) -> xosc.Vehicle | xosc.Pedestrian | xosc.MiscObject:
    """Return the entity of a column with its box, which lies around the reference point."""
    record, category = recording.record, recording.categories[column]
    rear = float(compute_rear_to_centre(recording)[column])
    length, width = float(record.length[column]), float(record.width[column])
    height = float(recording.heights[column])
    box = xosc.BoundingBox(width, length, height, round(rear, 4), 0.0, height / 2)
    if category == "pedestrian":
        return xosc.Pedestrian(name, MASS_KG[category], xosc.PedestrianCategory.pedestrian, box)
    if category == "static":
        return xosc.MiscObject(name, MASS_KG[category], xosc.MiscObjectCategory.obstacle, box)
    car = VehicleParameters()
    front = xosc.Axle(car.max_steer_angle, WHEEL_M, width, round(2 * rear, 4), WHEEL_M / 2)
    back = xosc.Axle(0.0, WHEEL_M, width, 0.0, WHEEL_M / 2)
    limits = (car.max_speed, car.max_acceleration, car.max_deceleration)
    vehicle = xosc.Vehicle(name, CATEGORY[category], box, front, back, *limits)
    vehicle.add_property("mdrive_role", "cav" if column < record.egos else "traffic")
    return vehicle
