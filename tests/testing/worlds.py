"""Small worlds for tests: a straight road without SUMO, and agents that do one thing."""

from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from types import MappingProxyType

import numpy as np

from mdrive_sumo.contract import Briefing, Control, Observation, Reply, SensorSpec
from mdrive_sumo.core.geometry import Polyline
from mdrive_sumo.core.state import Actors, EgoState, WorldState
from mdrive_sumo.roads import Lane, RoadMap
from mdrive_sumo.scenario.scenario import Ego, Scenario
from mdrive_sumo.scenario.scenario_part import Pose


def straight_road(length: float = 300.0) -> RoadMap:
    """One eastbound lane along y = 0."""
    lane = Lane("r_0", "r", 0, 3.5, 13.89, Polyline(np.array([(0.0, 0.0), (length, 0.0)])), False, (), "", "", {})
    return RoadMap("straight", Path("/nowhere"), {"r_0": lane}, (), (), (), (), (), "none")


def straight_ego(name: str, x: float = 10.0, length: int = 50, y: float = 0.0) -> Ego:
    """A CAV that shall drive `length` metres east."""
    route = tuple((x + i, y, 0.0) for i in range(length + 1))
    return Ego(id=name, start=Pose(x=x, y=y, yaw=0.0), lanes=("r_0",), route=route)


def straight_scenario(*egos: Ego) -> Scenario:
    """A scenario on `straight_road`."""
    return Scenario(id="straight", bucket="Test", category="test", network="straight", egos=egos)


class EmptyWorld:
    """A world in which nothing but the CAVs exists; remembers which of them were placed."""

    def __init__(self) -> None:
        self.placed: list[tuple[str, ...]] = []

    def start(self, egos: Mapping[str, EgoState], scripted: Actors) -> WorldState:
        return self.advance(egos, scripted, ())

    def advance(self, egos: Mapping[str, EgoState], scripted: Actors, struck: Collection[str]) -> WorldState:
        self.placed.append(tuple(egos))
        return WorldState(Actors.empty(), MappingProxyType({}))


class Says:
    """An agent that answers by a function of what it sees, and remembers it."""

    label = "single"

    def __init__(self, answer: Callable[[Observation], object], *sensors: SensorSpec) -> None:
        self._answer, self._sensors = answer, sensors
        self.seen: list[Observation] = []
        self.briefing: Briefing | None = None

    def sensors(self) -> tuple[SensorSpec, ...]:
        return self._sensors

    def start(self, briefing: Briefing) -> None:
        self.briefing = briefing

    def act(self, seen: Observation) -> Reply:
        self.seen.append(seen)
        return self._answer(seen)  # type: ignore[return-value]  # tests answer nonsense too


def pedals(throttle: float = 0.0, brake: float = 0.0, steer: float = 0.0) -> Reply:
    """A reply with a control."""
    return Reply(control=Control(throttle, brake, steer))
