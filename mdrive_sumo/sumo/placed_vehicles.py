"""Vehicles that we place in SUMO on every step: doubles of what moves by itself, so that SUMO's traffic sees it."""

# pyright: basic
import libsumo

from mdrive_sumo.roads import RoadMap
from mdrive_sumo.sumo.sumo_frames import angle_to_sumo

EGO, GHOST = "ego:", "ghost:"
"""Prefixes of SUMO ids, of the vehicle types and of the vehicles. Background vehicles have ids without a colon."""
DUMMY = "dummy:"
"""Prefix of the routes of what we place; a background vehicle's route has its id."""
MATCH_M = 5.0
"""How far [m] SUMO looks for a lane to put a placed vehicle on. Its default, 100 m, takes twice as long."""
KEEP_ROUTE = 2
"""moveToXY: take x, y, angle as they are, on any lane and off the road too (sumo_pitfalls 1.1)."""


def add_types() -> None:
    """Vehicle types of what we place; once after the start of SUMO."""
    for name in (EGO, GHOST):
        libsumo.vehicletype.copy("DEFAULT_VEHTYPE", name)
        libsumo.vehicletype.setMinGap(name, 2.5)


def add_remote(name: str, kind: str, size: tuple[float, float], edge: str, roads: RoadMap) -> None:
    """A vehicle of (length, width) [m] that we place on every step.

    Its route is a dummy: with keepRoute=2 SUMO rewrites it anyway.
    """
    road = edge if not edge.startswith(":") else next(lane.edge for lane in roads.driving if not lane.junction)
    route = DUMMY + road
    if route not in libsumo.route.getIDList():
        libsumo.route.add(route, [road])
    libsumo.vehicle.add(name, route, typeID=kind)
    libsumo.vehicle.setLength(name, size[0])
    libsumo.vehicle.setWidth(name, size[1])
    libsumo.vehicle.setSpeedMode(name, 0)
    libsumo.vehicle.setLaneChangeMode(name, 0)


def place(name: str, x: float, y: float, yaw: float, speed: float, hint: tuple[str, int] = ("", -1)) -> None:
    """Puts the front bumper there for the coming step.

    Without setSpeed SUMO reports a phantom speed (sumo_pitfalls 1.6).
    """
    libsumo.vehicle.moveToXY(name, *hint, x, y, angle_to_sumo(yaw), KEEP_ROUTE, MATCH_M)
    libsumo.vehicle.setSpeed(name, max(speed, 0.0))
