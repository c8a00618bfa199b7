"""Small roads and traffic for the tests of the built-in agents: routes at a crossing, a world of moving boxes."""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mdrive_sumo.agents.registry import AGENTS
from mdrive_sumo.core.geometry import Float, Polyline, build_polyline
from mdrive_sumo.core.state import DT, Actors, EgoState, End, Kind, WorldState
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.episode.episode_options import EpisodeOptions
from mdrive_sumo.loop import EpisodeConfig, run_episode
from mdrive_sumo.loop.agent_driver import LocalDriver
from mdrive_sumo.roads import Lane, RoadMap
from mdrive_sumo.roads.network_file import StopSignBox
from mdrive_sumo.scenario.scenario import Ego, Scenario
from mdrive_sumo.scenario.scenario_part import Pose

HALF_CROSSING_M = 10.0


def crossing_route(turn: str, arm: int, run_up_m: float = 30.0) -> Float:
    """Route (N, 2) over a crossing of 2 x 2 lanes at the origin, from arm 0 (west), 1 (south) ..."""
    h, y = HALF_CROSSING_M, -1.75
    ends = {
        "straight": [(h + 25.0, y)],
        "left": [*_arc((-h, h), h - y, -90.0, 0.0), (-y, h + 25.0)],
        "right": [*_arc((-h, -h), h + y, 90.0, 0.0), (y, -h - 25.0)],
    }
    angle = arm * math.pi / 2
    turned = np.array(((math.cos(angle), math.sin(angle)), (-math.sin(angle), math.cos(angle))))
    return build_polyline(np.array([(-h - run_up_m, y), (-h, y), *ends[turn]]) @ turned).resample(1.0).xy


def _arc(centre: tuple[float, float], radius: float, start_deg: float, end_deg: float) -> list[tuple[float, float]]:
    angles = np.radians(np.linspace(start_deg, end_deg, 40))
    return [(centre[0] + radius * math.cos(a), centre[1] + radius * math.sin(a)) for a in angles]


def ego(name: str, xy: Float) -> Ego:
    """A CAV at the first point of its route."""
    yaws = Polyline(xy).yaws
    yaws = np.append(yaws, yaws[-1])
    points = tuple((float(x), float(y), float(yaw)) for (x, y), yaw in zip(xy, yaws, strict=True))
    x, y, yaw = points[0]
    return Ego(id=name, start=Pose(x=x, y=y, yaw=yaw), lanes=("r_0",), route=points)


def field(*signs: StopSignBox, light: str = "") -> RoadMap:
    """One lane along y = -1.75 from x = -100 to 100; a light, if any, stands where it goes over into "out"."""
    lights = {"out": light} if light else {}
    line = Polyline(np.array([(-100.0, -1.75), (0.0, -1.75)]))
    more = Polyline(np.array([(0.0, -1.75), (100.0, -1.75)]))
    lanes = {
        "r_0": Lane("r_0", "r", 0, 3.5, 13.89, line, False, ("out",), "", "", lights),
        "out": Lane("out", "out", 0, 3.5, 13.89, more, False, (), "", "", {}),
    }
    return RoadMap("field", Path("/nowhere"), lanes, (), (), (), (), signs, "none")


@dataclass(frozen=True)
class Box:
    """A car that goes straight on at its speed whatever happens: x, y [m], yaw [rad], speed [m/s]."""

    x: float
    y: float
    yaw: float
    speed: float = 0.0


class BoxWorld:
    """A world of blind cars, and of lights that are red until a tick."""

    def __init__(self, boxes: Sequence[Box] = (), red_until: int = 0) -> None:
        self._boxes, self._red_until, self._tick = boxes, red_until, -1

    def start(self, egos: Mapping[str, EgoState], scripted: Actors) -> WorldState:
        return self.advance(egos, scripted, ())

    def advance(self, egos: Mapping[str, EgoState], scripted: Actors, struck: Collection[str]) -> WorldState:
        self._tick += 1
        t = self._tick * DT
        table = np.array(
            [(b.x + b.speed * t * math.cos(b.yaw), b.y + b.speed * t * math.sin(b.yaw)) for b in self._boxes]
        )
        signals = {"L": "r" if self._tick < self._red_until else "g"}
        if not self._boxes:
            return WorldState(Actors.empty(), signals)
        ones = np.ones(len(table))
        actors = Actors(
            tuple(f"b{i}" for i in range(len(table))),
            np.full(len(table), Kind.VEHICLE, dtype=np.uint8),
            table[:, 0],
            table[:, 1],
            np.array([b.yaw for b in self._boxes]),
            np.array([b.speed for b in self._boxes]),
            4.5 * ones,
            1.8 * ones,
        )
        return WorldState(actors, signals)


def drive(
    agent: str,
    routes: Mapping[str, Float],
    boxes: Sequence[Box] = (),
    roads: RoadMap | None = None,
    red_until: int = 0,
) -> EpisodeRecord:
    """One episode in which every CAV has the same built-in agent, exact sensing and its id of the scenario."""
    egos = tuple(
        ego(name, xy).model_copy(update={"lanes": ("r_0", "out")} if red_until else {}) for name, xy in routes.items()
    )
    scenario = Scenario(id="field", bucket="Test", category="test", network="field", egos=egos)
    drivers = {name: LocalDriver(AGENTS[agent]({})) for name in routes}
    options = EpisodeOptions.parse(sensing="perfect", ids="scenario")
    config = EpisodeConfig(scenario, roads or field(), seed=0, options=options)
    return run_episode(config, BoxWorld(boxes, red_until), drivers)


def all_arrived(episode: EpisodeRecord) -> bool:
    """Whether every CAV reached its goal."""
    return all(ending.end is End.ARRIVED for ending in episode.endings)
