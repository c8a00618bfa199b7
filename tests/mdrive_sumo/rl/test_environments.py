"""Environments with real episodes: the checks of PettingZoo and Gymnasium, and the episodes of `simulate`."""

import os
import signal
from collections.abc import Generator
from typing import Any

import gymnasium
import numpy as np
import pettingzoo
import pytest
from gymnasium.utils.env_checker import check_env
from pettingzoo.test import parallel_api_test, parallel_seed_test
from testing.short_suite import make_short_suite

import mdrive_sumo as md
from mdrive_sumo.contract import Briefing, Control, Observation, Reply, SensorSpec
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.seeding import derive_seed
from mdrive_sumo.rl import ParallelDrivingEnv, VectorDrivingEnv, VehicleEnv
from mdrive_sumo.rl.registration import ENV_ID
from mdrive_sumo.sensing.raster_sensor import LAYERS

pytestmark = [pytest.mark.slow, pytest.mark.costly_fixture]
SCENARIO = "i25_ins_oppo_boulevard"
STEADY = np.array((0.4, 0.0), np.float32)


@pytest.fixture(scope="module")
def suite(tmp_path_factory: pytest.TempPathFactory) -> str:
    return str(make_short_suite(tmp_path_factory.mktemp("rl") / "short", "i25*", "i01_ins_c_main_street_right"))


@pytest.fixture(scope="module")
def env(suite: str) -> Generator[ParallelDrivingEnv]:
    made = ParallelDrivingEnv(suite=suite, scenarios=[SCENARIO], message_bytes=16, vary=False, own_process=False)
    yield made
    made.close()


def _act(env: ParallelDrivingEnv, payload: int = 0) -> dict[str, Any]:
    return {agent: {"control": STEADY, "message": np.full(16, payload)} for agent in env.agents}


def test_pettingzoo_accepts_the_environment(suite: str) -> None:
    made = pettingzoo.make("parallel", ENV_ID, suite=suite, scenarios=[SCENARIO], message_bytes=16, own_process=False)
    parallel_api_test(made, 60)  # pyright: ignore[reportArgumentType] - warnings are errors here
    made.close()


def test_two_environments_of_one_seed_are_the_same(suite: str) -> None:
    parallel_seed_test(lambda: pettingzoo.make("parallel", ENV_ID, suite=suite, control="targets"), 10)


def test_gymnasium_accepts_the_environment(suite: str) -> None:
    made = gymnasium.make(ENV_ID, suite=suite, scenarios=[SCENARIO], learner=1)
    check_env(made.unwrapped, skip_render_check=True)
    made.close()


class _Steady:
    """The policy of these tests as an agent."""

    label = "single"

    def __init__(self, _: object) -> None:
        pass

    def sensors(self) -> tuple[SensorSpec, ...]:
        return (SensorSpec("objects"),)

    def start(self, briefing: Briefing) -> None:
        pass

    def act(self, seen: Observation) -> Reply:
        return Reply(control=Control(0.4, 0.0, 0.0))


def test_an_episode_is_that_of_the_agent_with_the_same_controls(suite: str) -> None:
    """The digest of the episode is that of `simulate`, and the rewards add up to its score."""
    made = ParallelDrivingEnv(suite=suite, scenarios=[SCENARIO], vary=False, ticks_per_decision=3, own_process=False)
    made.reset(seed=5)
    returns = dict.fromkeys(made.agents, 0.0)
    infos: dict[str, dict[str, Any]] = {}
    while made.agents:
        _, rewards, _, _, infos = made.step(dict.fromkeys(made.agents, STEADY))
        returns = {agent: returns[agent] + rewards.get(agent, 0.0) for agent in returns}
    made.close()
    scores = next(iter(infos.values()))["scores"]
    episode = md.simulate(SCENARIO, _Steady, suite=suite)
    assert {score["digest"] for score in scores.values()} == {episode.digest}
    assert {agent: score["ds"] / 100 for agent, score in scores.items()} == pytest.approx(returns, abs=1e-5)
    assert [score["end"] for score in scores.values()] == [str(one.end) for one in episode.record.endings]


def test_what_a_policy_says_reaches_the_others(env: ParallelDrivingEnv) -> None:
    first, _ = env.reset(seed=0)
    heard = slice(-3 * 18, None)
    assert not any(vector[heard].any() for vector in first.values())
    observations, *_ = env.step(_act(env, payload=51))
    for vector in observations.values():
        rows = vector[heard].reshape(3, 18)
        assert rows[:, 0].tolist() == [1, 1, 1]
        assert rows[:, 2:] == pytest.approx(np.full((3, 16), 0.2))


@pytest.mark.parametrize(
    ("actions", "sentence"),
    [
        ({"cav_0": STEADY}, "step: action of cav_0: expected a dictionary with control and message, found an array"),
        ({"cav_0": {"control": STEADY[:1], "message": bytes(16)}}, "expected an array of shape (2,), found an array"),
        (
            {"cav_0": {"control": STEADY * np.nan, "message": bytes(16)}},
            "expected numbers in [-1, 1], found [nan, nan]",
        ),
        ({"cav_0": {"control": STEADY * 3, "message": bytes(16)}}, "expected numbers in [-1, 1], found [1.2"),
        ({"cav_0": {"control": "left", "message": bytes(16)}}, "action of cav_0: expected numbers, found 'left'"),
        ({"cav_0": {"control": STEADY, "message": bytes(17)}}, "message: expected 16 bytes, found 17 bytes"),
        ({"cav_0": {"control": STEADY, "message": [256] * 16}}, "message: expected whole numbers from 0 to 255"),
        ({"cav_9": {}}, "found 'cav_9': no such agent"),
    ],
)
def test_bad_actions_are_one_sentence(env: ParallelDrivingEnv, actions: dict[str, Any], sentence: str) -> None:
    if not env.agents:
        env.reset(seed=0)
    with pytest.raises(InputError) as error:
        env.step(actions)
    assert sentence in str(error.value)
    assert "\n" not in str(error.value)


def test_an_action_after_the_end_is_one_sentence(env: ParallelDrivingEnv) -> None:
    env.reset(seed=0)
    while "cav_0" in env.agents:
        env.step({"cav_0": _act(env)["cav_0"]})  # the others stand
    with pytest.raises(InputError, match="expected actions of cav_1, cav_2, cav_3, found 'cav_0': it has ended"):
        env.step({"cav_0": {}})
    while env.agents:
        env.step(_act(env))
    with pytest.raises(InputError, match="found none; reset\\(\\) starts one"):
        env.step({})


def test_an_unknown_scenario_is_one_sentence(env: ParallelDrivingEnv) -> None:
    with pytest.raises(InputError, match="reset: scenario: expected one of"):
        env.reset(options={"scenario": "i99"})


def test_other_cavs_are_driven_by_an_agent(suite: str) -> None:
    made = VehicleEnv(suite=suite, scenarios=[SCENARIO], learner=2, others="constant-speed", own_process=False)
    observation, info = made.reset(seed=1)
    assert info["cav"] == "2"
    ended = False
    while not ended:
        observation, _, ended, _, _ = made.step(STEADY)
        assert made.observation_space.contains(observation)
    made.close()


@pytest.mark.parametrize("grid", ["raster", "lidar"])
def test_a_grid_shows_what_the_sensors_see(suite: str, grid: str) -> None:
    made = VehicleEnv(suite=suite, scenarios=[SCENARIO], grid=grid, control="anchors", nearest=2, own_process=False)
    check_env(made, skip_render_check=True)
    observation, _ = made.reset(seed=0)
    seen, *_ = made.step(0)
    made.close()
    assert isinstance(observation, dict)
    assert isinstance(seen, dict)
    assert made.observation_space.contains(seen)
    if grid == "raster":
        layers = dict(zip(LAYERS, seen["grid"], strict=True))
        assert layers["self"][31:33, 31:33].all()  # 2 m x 2 m of the car, in the middle
        assert (layers["self"] > 0).sum() == pytest.approx(4.9 * 2.1, abs=6)  # cells of 1 m2
        assert layers["route"][:32].any()  # ahead
    else:
        assert seen["grid"].sum() > 10_000  # of 25 024 rays
        assert not seen["grid"][:, 48, 32].any()  # under the car


def test_workers_drive_episodes_of_their_own_and_a_lost_one_is_replaced(suite: str) -> None:
    made = VectorDrivingEnv(2, suite=suite, scenarios=[SCENARIO], control="targets")
    first, infos = made.reset(seed=3)
    assert isinstance(first, np.ndarray)
    assert first.shape == made.observation_space.shape
    assert len(first) == 8
    assert infos["is_active"].all()
    assert not np.array_equal(first[:4], first[4:])
    alone = ParallelDrivingEnv(suite=suite, scenarios=[SCENARIO], control="targets", own_process=False)
    of_worker, _ = alone.reset(seed=derive_seed(3, "rl-worker", "1"))
    alone.close()
    assert np.array_equal(first[4:], np.array(list(of_worker.values())))
    scores: dict[int, Any] = {}
    while len(scores) < 8:
        observations, _, terminated, truncated, infos = made.step(np.full(8, 10))
        assert not truncated.any()
        assert made.observation_space.contains(observations)
        scores |= infos["scores"]
    os.kill(made.process_ids[1], signal.SIGKILL)
    with pytest.warns(RuntimeWarning, match=f"worker 1 \\(process {made.process_ids[1]}\\) has died"):
        _, _, terminated, truncated, infos = made.step(np.full(8, 10))
    assert truncated[4:].all()
    assert not truncated[:4].any()
    assert not terminated[4:].any()
    assert infos["restarted"] == (1,)
    made.step(np.full(8, 10))
    with pytest.raises(InputError, match="step: expected 8 actions, found 7"):
        made.step(np.full(7, 10))
    made.close()


def test_bad_number_of_workers() -> None:
    with pytest.raises(InputError, match="workers: expected an integer from 1 to 512, found 0"):
        VectorDrivingEnv(0)
