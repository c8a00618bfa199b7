"""Plans, paths and the closed loop of a controller with the plant: shared by tests of controllers. No tests in here."""

import math
from collections.abc import Callable

import numpy as np

from mdrive_sumo.contract import Plan
from mdrive_sumo.core.geometry import Float, Polyline, build_polyline
from mdrive_sumo.core.state import DT, EgoState
from mdrive_sumo.vehicle.control import CONTROLLERS
from mdrive_sumo.vehicle.dynamics import MKZ_2017, VehicleState, step, to_ego_state, to_vehicle_facts

Profile = Callable[[float], float]
"""Arc length [m] over time [s]."""


def plan_of(*points: tuple[float, float], interval_s: float = 0.2) -> Plan:
    return Plan(np.array(points, dtype=float), interval_s)


def straight_plan(speed: float, interval_s: float = 0.2, count: int = 20) -> Plan:
    return plan_of(*[(speed * interval_s * (k + 1), 0.0) for k in range(count)], interval_s=interval_s)


def own(speed: float, x: float = 0.0, y: float = 0.0, yaw: float = 0.0) -> EgoState:
    return EgoState(x, y, yaw, speed)


def turn(radius: float, left: bool = True, run: float = 30.0) -> Polyline:
    """Straight, a quarter circle, straight; points 0.1 m apart."""
    side = 1.0 if left else -1.0
    angles = np.arange(0.0, math.pi / 2, 0.1 / radius)
    before = [(x, 0.0) for x in np.arange(0.0, run, 0.1)]
    arc = [(run + radius * math.sin(a), side * radius * (1 - math.cos(a))) for a in angles]
    after = [(run + radius, side * (radius + y)) for y in np.arange(0.0, 90.0, 0.1)]
    return build_polyline(before + arc + after)


def circle(radius: float) -> Polyline:
    angles = np.arange(0.0, 4 * math.pi, 0.1 / radius)
    return build_polyline([(radius * math.sin(a), radius * (1 - math.cos(a))) for a in angles])


def drive(name: str, path: Polyline, wanted: Profile, seconds: float, hold: int, body: VehicleState) -> Float:
    """Closed loop; a plan of 4 s is made every `hold` ticks. Rows: s error [m], lateral error [m], speed [m/s]."""
    controller = CONTROLLERS[name](to_vehicle_facts(MKZ_2017))
    rows: list[tuple[float, float, float]] = []
    plan = straight_plan(0.0)
    for tick in range(round(seconds / DT)):
        if tick % hold == 0:
            plan = plan_of(*[path.at(wanted(tick * DT + 0.2 * (k + 1))) for k in range(20)])
        body = step(body, controller.follow(plan, to_ego_state(body), tick % hold), MKZ_2017)
        due = wanted((tick + 1) * DT)
        s, d = path.project(body.x, body.y, between=(due - 10.0, due + 10.0))
        rows.append((due - s, d, body.vx))
    return np.array(rows)
