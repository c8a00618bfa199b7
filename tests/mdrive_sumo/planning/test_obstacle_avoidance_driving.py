"""Obstacle avoidance in closed loop on packaged networks."""

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np
import pytest
import shapely
from testing.agents_driving import ego
from testing.bent_road import CAR, WIDTH

from mdrive_sumo.agents.registry import AGENTS
from mdrive_sumo.core.geometry import boxes_corners
from mdrive_sumo.core.state import DT, Actors, EgoState, End, Kind, WorldState
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.loop import EpisodeConfig, run_episode
from mdrive_sumo.loop.agent_driver import LocalDriver
from mdrive_sumo.roads import Lane, RoadMap, list_packaged_networks, load_road_map
from mdrive_sumo.scenario.scenario import Scenario

pytestmark = pytest.mark.slow


@dataclass(frozen=True)
class Thing:
    """A box that goes straight on at its speed [m/s], or stands; pose [m, m, rad] and size [m]."""

    kind: Kind
    x: float
    y: float
    yaw: float
    speed: float = 0.0
    length: float = 4.5
    width: float = 1.8


class ThingWorld:
    """A world of things; every light shows g."""

    def __init__(self, things: tuple[Thing, ...]) -> None:
        self._things, self._tick = things, -1

    def start(self, egos: Mapping[str, EgoState], scripted: Actors) -> WorldState:
        return self.advance(egos, scripted, ())

    def advance(self, egos: Mapping[str, EgoState], scripted: Actors, struck: Collection[str]) -> WorldState:
        self._tick += 1
        if not self._things:
            return WorldState(Actors.empty(), {})
        columns = [(t.x, t.y, t.yaw, t.speed, t.length, t.width) for t in self._things]
        x, y, yaw, speed, length, width = np.array(columns).T
        gone = speed * self._tick * DT
        names = tuple(f"b{i}" for i in range(len(columns)))
        kinds = np.array([t.kind for t in self._things], dtype=np.uint8)
        actors = Actors(names, kinds, x + gone * np.cos(yaw), y + gone * np.sin(yaw), yaw, speed, length, width)
        return WorldState(actors, {})


def lane_of(network: str, lane: str) -> tuple[RoadMap, Lane]:
    roads = load_road_map(list_packaged_networks()[network])
    return roads, roads.lanes[lane]


def beside(lane: Lane, s: float, aside: float, kind: Kind, size: tuple[float, float] = (4.5, 1.8)) -> Thing:
    """Something that stands in or beside a lane."""
    (x, y), yaw = lane.centre.at(s), lane.centre.yaw_at(s)
    return Thing(kind, x - math.sin(yaw) * aside, y + math.cos(yaw) * aside, yaw, 0.0, *size)


def driven(network: str, lane: str, things: tuple[Thing, ...], agent: str = "single", seed: int = 0) -> EpisodeRecord:
    """One CAV along a lane of a packaged network."""
    roads, way = lane_of(network, lane)
    one = ego("0", way.centre.resample(1.0).xy[5:-15]).model_copy(update={"lanes": (lane,)})
    scenario = Scenario(id="detour", bucket="Test", category="test", network=network, egos=(one,))
    return run_episode(
        EpisodeConfig(scenario, roads, seed=seed), ThingWorld(things), {"0": LocalDriver(AGENTS[agent]({}))}
    )


def off_road_m(episode: EpisodeRecord, roads: RoadMap) -> float:
    """How far [m] the CAV's corners come off the lanes, at most."""
    lines = [shapely.LineString(lane.centre.xy) for lane in roads.driving]
    surface = shapely.union_all([shapely.buffer(line, WIDTH / 2) for line in lines])
    size = np.array(CAR.length), np.array(CAR.width)
    present = episode.valid[:, 0]
    boxes = boxes_corners(episode.x[present, 0], episode.y[present, 0], episode.yaw[present, 0], *size)
    return float(shapely.distance(shapely.points(boxes), surface).max())


STREETS = [("town_crossing", "east_out_1"), ("old_town", "west_in_1")]


class TestOnTheRoad:
    @pytest.mark.parametrize(
        ("network", "name", "kind"),
        [
            (*STREETS[0], Kind.STATIC),
            (*STREETS[1], Kind.VEHICLE),
            pytest.param(*STREETS[0], Kind.VEHICLE, marks=pytest.mark.full),
            pytest.param(*STREETS[1], Kind.STATIC, marks=pytest.mark.full),
        ],
    )
    def test_a_standing_object_is_passed(self, network: str, name: str, kind: Kind) -> None:
        roads, lane = lane_of(network, name)
        thing = beside(lane, 45.0, 0.2, kind, (4.5, 1.8) if kind == Kind.VEHICLE else (2.0, 2.0))
        episode = driven(network, name, (thing,))
        assert episode.find_ending("0").end is End.ARRIVED
        assert episode.contacts == ()
        assert off_road_m(episode, roads) < 0.05

    def test_idm_passes_a_standing_object_too(self) -> None:
        roads, lane = lane_of(*STREETS[0])
        episode = driven(*STREETS[0], (beside(lane, 45.0, 0.2, Kind.STATIC, (2.0, 2.0)),), "idm")
        assert episode.find_ending("0").end is End.ARRIVED
        assert episode.contacts == ()
        assert off_road_m(episode, roads) < 0.05

    def test_no_detour_on_a_free_road(self) -> None:
        _, lane = lane_of(*STREETS[0])
        episode = driven(*STREETS[0], (beside(lane, 45.0, -3.6, Kind.STATIC, (1.0, 1.0)),))
        assert episode.find_ending("0").end is End.ARRIVED
        # Less than a detour: five standard deviations of the estimated own position.
        assert np.abs(episode.y[episode.valid[:, 0], 0] + WIDTH / 2).max() < 1.0

    @pytest.mark.full
    def test_the_car_stops_at_a_wall_across_the_road(self) -> None:
        _, lane = lane_of(*STREETS[0])
        wall = beside(lane, 45.0, 1.75, Kind.STATIC, (1.0, 12.0))
        episode = driven(*STREETS[0], (wall,))
        assert episode.find_ending("0").end is End.BLOCKED
        assert episode.contacts == ()
        assert episode.x[:, 0].max() > wall.x - 16.0

    @pytest.mark.parametrize("gap_m", [30.0, pytest.param(60.0, marks=pytest.mark.full)])
    def test_oncoming_traffic_goes_first(self, gap_m: float) -> None:
        _, lane = lane_of(*STREETS[0])
        thing = beside(lane, 45.0, 0.0, Kind.STATIC, (2.0, 2.0))
        cars = tuple(Thing(Kind.VEHICLE, 110.0 + gap_m * i, WIDTH / 2, math.pi, 8.0, 4.5, 1.8) for i in range(3))
        episode = driven(*STREETS[0], (thing, *cars))
        assert episode.find_ending("0").end is End.ARRIVED
        assert episode.contacts == ()

    def test_several_obstacles_in_a_row_are_passed(self) -> None:
        roads, lane = lane_of(*STREETS[0])
        things = (
            beside(lane, 25.0, 0.0, Kind.STATIC, (1.0, 1.0)),
            beside(lane, 38.0, -0.8, Kind.STATIC, (1.0, 1.0)),
            beside(lane, 66.0, 0.3, Kind.STATIC, (1.0, 1.0)),
        )
        episode = driven(*STREETS[0], things)
        assert episode.find_ending("0").end is End.ARRIVED
        assert episode.contacts == ()
        assert off_road_m(episode, roads) < 0.05

    @pytest.mark.full
    @pytest.mark.parametrize("agent", ["single", "sharing", "sharing+negotiation", "colmdriver-rule"])
    @pytest.mark.parametrize("seed", range(3))
    def test_with_other_errors_of_the_detector(self, agent: str, seed: int) -> None:
        for network, name in STREETS:
            _, lane = lane_of(network, name)
            for kind in (Kind.STATIC, Kind.VEHICLE):
                episode = driven(network, name, (beside(lane, 45.0, 0.0, kind),), agent, seed)
                assert episode.find_ending("0").end is End.ARRIVED
                assert episode.contacts == ()
