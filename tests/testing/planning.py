"""A straight route, objects and motions on it: shared by tests of planning, perception and baselines."""

import math
from collections.abc import Sequence

import numpy as np

from mdrive_sumo.contract import Briefing, Cause, Message, Objects, Observation, OwnState, Reason, VehicleFacts
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import DT, Kind
from mdrive_sumo.planning.motion_prediction import TIMES, PredictedMotion
from mdrive_sumo.planning.space_time_planner import SpaceTimePlanner

LENGTH, WIDTH = 4.5, 1.8
STANDS, MOVES = Reason(Cause.BLOCKED, ("standing",)), Reason(Cause.AVOID, ("moving",))
FACTS = VehicleFacts(LENGTH, WIDTH, 2.8, 1.42, 1500.0, 0.6, 20.0, 3.0, 8.0)


def straight(length_m: float = 100.0) -> Float:
    """Route (N, 2) along +x from the origin."""
    x = np.arange(length_m + 1.0)
    return np.column_stack((x, np.zeros(len(x))))


def briefing(route_xy: Float | None = None, limit: float = 13.9, name: str = "me", seed: int = 1) -> Briefing:
    """Return the briefing of a car on that route, without stop lines and without a measured road width."""
    xy = straight() if route_xy is None else route_xy
    steps = np.diff(xy, axis=0)
    s = np.concatenate(((0.0,), np.cumsum(np.hypot(steps[:, 0], steps[:, 1]))))
    yaw = np.arctan2(steps[:, 1], steps[:, 0])
    same = np.ones(len(xy))
    return Briefing(name, seed, DT, 60.0, FACTS, xy, np.append(yaw, yaw[-1]), s, 3.5 * same, limit * same)


def own(x: float = 0.0, y: float = 0.0, yaw: float = 0.0, speed: float = 0.0) -> OwnState:
    """The own instruments."""
    return OwnState(x, y, yaw, speed, 0.0, 0.0, 0.0)


def things(*rows: Sequence[float], ids: Sequence[str] = (), kind: Kind = Kind.VEHICLE) -> Objects:
    """Car-sized objects of x, y [m], yaw [rad], speed [m/s]; (N,) rows."""
    table = np.array(rows, dtype=np.float64).reshape(-1, 4)
    names = tuple(ids) or tuple(f"t{i:08x}" for i in range(len(table)))
    size = (0.6, 0.6) if kind == Kind.PEDESTRIAN else (LENGTH, WIDTH)
    sizes = (np.full(len(table), value) for value in size)
    return Objects(names, np.full(len(table), kind, dtype=np.uint8), *table.T, *sizes)


def seen(tick: int, state: OwnState, objects: Objects, messages: Sequence[Message] = ()) -> Observation:
    """An observation with these parts."""
    return Observation(tick, state, objects=objects, messages=tuple(messages))


def standing(x: float, y: float, yaw: float = 0.0) -> PredictedMotion:
    """Return the motion of a car that stands there."""
    return PredictedMotion(np.tile((x, y, yaw), (len(TIMES), 1)), LENGTH, WIDTH, STANDS, stands_at_end=True)


def moving(x: float, y: float, yaw: float, speed: float) -> PredictedMotion:
    """Return the motion of a car that goes straight on at that speed."""
    xy = np.array((x, y)) + np.outer(speed * TIMES, (math.cos(yaw), math.sin(yaw)))
    return PredictedMotion(np.column_stack((xy, np.full(len(TIMES), yaw))), LENGTH, WIDTH, MOVES)


def stations(planner: SpaceTimePlanner, tick: int = 0) -> Float:
    """(50,) arc lengths [m] of the plan every 0.2 s, for the straight way along +x."""
    return planner.get_planned_points(tick)[:, 0]
