"""CAVs in SUMO's traffic, whole episodes: recording, contacts, scores and reproducibility."""

from functools import cache

import numpy as np
import pytest

from mdrive_sumo.agents.registry import AGENTS
from mdrive_sumo.core.geometry import boxes_corners, boxes_overlap
from mdrive_sumo.core.state import End
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.loop import VEHICLE, EpisodeConfig, run_episode
from mdrive_sumo.loop.agent_driver import LocalDriver
from mdrive_sumo.roads import build_lane_route, find_network_folder, load_road_map
from mdrive_sumo.scenario.background import Background, BackgroundVehicle
from mdrive_sumo.scenario.scenario import Ego, Scenario
from mdrive_sumo.scenario.scenario_part import Pose
from mdrive_sumo.scoring import ScoreMode, score_episode
from mdrive_sumo.sumo import SumoWorld

pytestmark = pytest.mark.slow

ROADS = load_road_map(find_network_folder("motorway"))


def scenario() -> Scenario:
    """A CAV on the second lane of a motorway with traffic before, beside and behind it."""
    lane = ROADS.lanes["weave_2"]
    route = build_lane_route(ROADS, (lane.id,), 60.0, 180.0)
    points = tuple((float(x), float(y), float(yaw)) for (x, y), yaw in zip(route.xy, route.yaw, strict=True))
    x, y, yaw = points[0]
    ego = Ego(id="0", start=Pose(x=x, y=y, yaw=yaw), lanes=(lane.id,), route=points)
    traffic = [
        BackgroundVehicle(id=f"bg{i}", depart_s=0, edges=("weave", "after"), depart_lane=i % 4 + 1, depart_pos_m=pos)
        for i, pos in enumerate((10.0, 20.0, 30.0, 40.0, 100.0, 110.0, 120.0, 130.0))
    ]
    return Scenario(
        id="busy", bucket="Test", category="test", network="motorway", egos=(ego,),
        background=Background(vehicles=tuple(traffic)),
    )  # fmt: skip


@cache
def driven(agent: str, seed: int = 0) -> EpisodeRecord:
    return drive(agent, seed)


def drive(agent: str, seed: int = 0) -> EpisodeRecord:
    made = scenario()
    sizes = {"0": (VEHICLE.length, VEHICLE.width)}
    with SumoWorld(made, ROADS, sizes, seed) as world:
        return run_episode(EpisodeConfig(made, ROADS, seed), world, {"0": LocalDriver(AGENTS[agent]({}))})


@pytest.mark.parametrize("agent", ["idm", pytest.param("constant-speed", marks=pytest.mark.full), "omniscient"])
def test_a_cav_arrives_in_flowing_traffic_without_a_scratch(agent: str) -> None:
    episode = driven(agent)
    assert episode.find_ending("0").end is End.ARRIVED
    assert episode.contacts == ()
    assert set(episode.ids) == {"0", *(f"bg{i}" for i in range(8))}
    assert score_episode(episode, scenario(), ROADS, ScoreMode.MDRIVE, 0).ds == 100.0


def test_followers_wait_behind_a_cav_that_stands() -> None:
    episode = driven("stationary")
    ego = boxes_corners(episode.x[:, :1], episode.y[:, :1], episode.yaw[:, :1], *_size(episode, 0))
    others = boxes_corners(episode.x[:, 1:], episode.y[:, 1:], episode.yaw[:, 1:], *_size(episode, slice(1, None)))
    touching = boxes_overlap(ego, others) & episode.valid[:, 1:]
    assert not touching.any()
    assert episode.find_ending("0").end is End.BLOCKED


def _size(episode: EpisodeRecord, column: int | slice) -> tuple[np.ndarray, np.ndarray]:
    return np.atleast_1d(episode.length[column]), np.atleast_1d(episode.width[column])


def test_the_same_seed_gives_the_same_traffic_to_the_last_digit() -> None:
    assert driven("idm").digest == drive("idm").digest
    assert driven("idm").digest != driven("idm", 4).digest
