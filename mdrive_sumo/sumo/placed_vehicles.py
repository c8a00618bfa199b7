"""Vehicles that are placed in SUMO on every step, so that SUMO's traffic reacts to what SUMO does not drive."""

# pyright: basic
# Because libsumo has no type information.
import libsumo

from mdrive_sumo.roads import RoadMap
from mdrive_sumo.sumo.sumo_frames import convert_yaw_to_sumo

EGO, GHOST = "ego:", "ghost:"
"""Prefixes of the ids of placed vehicles and of their types. Ids of background vehicles have no colon."""
DUMMY = "dummy:"
"""Prefix of the routes of placed vehicles; a background vehicle's route has the vehicle's id."""
MATCH_M = 5.0
"""Distance [m] within which SUMO searches a lane for a placed vehicle. Its default, 100 m, takes twice as long."""
KEEP_ROUTE = 2
"""moveToXY: use x, y and angle exactly, on any lane and off the road as well (sumo_pitfalls 1.1)."""


def add_placed_types() -> None:
    """Add the vehicle types of placed vehicles, once after the start of SUMO."""
    for name in (EGO, GHOST):
        libsumo.vehicletype.copy("DEFAULT_VEHTYPE", name)
        libsumo.vehicletype.setMinGap(name, 2.5)


def add_placed_vehicle(name: str, kind: str, size: tuple[float, float], edge: str, roads: RoadMap) -> None:
    """Add a placed vehicle of (length, width) [m]. Its route is a dummy: with keepRoute=2 SUMO rewrites it anyway."""
    road = edge if not edge.startswith(":") else next(lane.edge for lane in roads.driving if not lane.junction)
    route = DUMMY + road
    if route not in libsumo.route.getIDList():
        libsumo.route.add(route, [road])
    libsumo.vehicle.add(name, route, typeID=kind)
    libsumo.vehicle.setLength(name, size[0])
    libsumo.vehicle.setWidth(name, size[1])
    libsumo.vehicle.setSpeedMode(name, 0)
    libsumo.vehicle.setLaneChangeMode(name, 0)


def place_vehicle(name: str, x: float, y: float, yaw: float, speed: float, hint: tuple[str, int] = ("", -1)) -> None:
    """Place the front bumper of a vehicle for the coming step.

    Without setSpeed SUMO derives a wrong speed from the displacement (sumo_pitfalls 1.6).
    """
    libsumo.vehicle.moveToXY(name, *hint, x, y, convert_yaw_to_sumo(yaw), KEEP_ROUTE, MATCH_M)
    libsumo.vehicle.setSpeed(name, max(speed, 0.0))
