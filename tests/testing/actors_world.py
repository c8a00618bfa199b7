"""Scripted road users on a straight road, without CAVs' agents and without SUMO."""

import math
from collections.abc import Callable, Collection
from typing import Any

import numpy as np

from mdrive_sumo.actors import ActorMode, ScriptedActors
from mdrive_sumo.core.geometry import Float, Polyline
from mdrive_sumo.core.state import Actors, EgoState, Frame
from mdrive_sumo.roads import Lane, RoadMap
from mdrive_sumo.scenario.scenario_part import Pose
from mdrive_sumo.scenario.scripted_actor import Actor, PathMotion, ReplayMotion
from testing.worlds import straight_ego, straight_road, straight_scenario

SIZES = {"vehicle": (4.6, 1.9), "pedestrian": (0.5, 0.5), "cyclist": (1.8, 0.6), "static": (0.5, 0.5)}
Egos = Callable[[int], dict[str, EgoState]]
Row = tuple[float, float, float, float]


def no_egos(tick: int) -> dict[str, EgoState]:
    """No CAV near: one far away."""
    return {"0": EgoState(1000.0, 1000.0, 0.0, 0.0)}


def standing_car(x: float, y: float, until: int = 10**9) -> Egos:
    """CAV 0 stands there across the path along y, and is moved far away at a tick."""
    return lambda tick: {"0": EgoState(x, y, 0.0, 0.0) if tick < until else EgoState(1000.0, 1000.0, 0.0, 0.0)}


def actor(name: str, kind: Any, **parts: Any) -> Actor:
    """An actor of a usual size; `points` and `speed` make it go along a path."""
    length, width = SIZES[kind]
    if "points" in parts:
        points = tuple(parts.pop("points"))
        parts["motion"] = PathMotion(points=points, speed=parts.pop("speed"), start_speed=parts.pop("start_speed", 0.0))
        (x, y), (u, v) = points[:2]
        parts["start"] = Pose(x=x, y=y, yaw=math.atan2(v - y, u - x))
    elif "poses" in parts:
        poses = tuple(parts.pop("poses"))
        parts["motion"] = ReplayMotion(poses=poses, stays=parts.pop("stays", False))
        parts["start"] = Pose(x=poses[0][1], y=poses[0][2], yaw=poses[0][3])
    elif "at" in parts:
        x, y = parts.pop("at")
        parts["start"] = Pose(x=x, y=y, yaw=parts.pop("yaw", 0.0))
    return Actor(id=name, kind=kind, length=length, width=width, **parts)


def two_lanes(length: float = 400.0) -> RoadMap:
    """Two eastbound lanes: r_0 along y = 0, r_1 along y = 3.5 to its left."""
    lanes = {
        f"r_{i}": Lane(
            f"r_{i}", "r", i, 3.5, 13.89, Polyline(np.array([(0.0, 3.5 * i), (length, 3.5 * i)])),
            False, (), "r_1" if i == 0 else "", "r_0" if i == 1 else "", {},
        )
        for i in (0, 1)
    }  # fmt: skip
    return RoadMap("two", straight_road().folder, lanes, (), (), (), (), (), "none")


class Film:
    """What a cast did: rows (x, y, yaw, speed) by actor and tick; missing where it was not there."""

    def __init__(
        self,
        *actors: Actor,
        seconds: float = 20.0,
        egos: Egos = no_egos,
        mode: ActorMode = ActorMode.DEFAULT,
        roads: RoadMap | None = None,
        struck: Callable[[int], Collection[str]] = lambda tick: (),
        background: Actors | None = None,
    ) -> None:
        scenario = straight_scenario(straight_ego("0"), straight_ego("1", x=30.0)).model_copy(
            update={"actors": tuple(actors)}
        )
        cast = ScriptedActors(scenario, roads or straight_road(), mode)
        self.frames: list[Actors] = [cast.present]
        for tick in range(round(seconds * 20)):
            merged = (background or Actors.empty()).merge(cast.present)
            self.frames.append(cast.advance(Frame(tick, egos(tick), merged, {}), struck(tick)))

    def of(self, name: str) -> Float:
        """(T, 4) x, y, yaw, speed; NaN where it is not there."""
        return np.array([self._row(frame, name) for frame in self.frames])

    @staticmethod
    def _row(frame: Actors, name: str) -> Row:
        if name not in frame.ids:
            return math.nan, math.nan, math.nan, math.nan
        i = frame.ids.index(name)
        return float(frame.x[i]), float(frame.y[i]), float(frame.yaw[i]), float(frame.speed[i])
