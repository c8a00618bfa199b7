"""`EpisodeSimulation`: the caller owns the loop, and the tick is the one of `run_episode`."""

from collections.abc import Mapping

import pytest
from testing.worlds import EmptyWorld, Says, pedals, straight_ego, straight_road, straight_scenario

from mdrive_sumo.contract import Message, Observation, Reply, SensorSpec
from mdrive_sumo.core.clock import parse_clock
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.state import End, FailureReason
from mdrive_sumo.episode.episode_options import EpisodeOptions
from mdrive_sumo.loop import EpisodeConfig, EpisodeSimulation, SimulatedFrames, run_episode
from mdrive_sumo.loop.agent_driver import AgentFailure, LocalDriver
from mdrive_sumo.v2x.comm_settings import PRESETS

SCENARIO = straight_scenario(straight_ego("0", x=60), straight_ego("1", x=10, length=80))
SENSORS = {"0": (SensorSpec("objects", range_m=100.0),), "1": (SensorSpec("privileged"),)}


def make_config() -> EpisodeConfig:
    return EpisodeConfig(SCENARIO, straight_road(), seed=3, options=EpisodeOptions(comm=PRESETS["realistic"]))


def make_simulation(sensors: Mapping[str, tuple[SensorSpec, ...]]) -> EpisodeSimulation:
    config = make_config()
    return EpisodeSimulation(config, SimulatedFrames(config, EmptyWorld()), sensors)


def decide(ego: str, observation: Observation) -> Reply:
    """Drive on, faster after a message; the first CAV sends one in every tick."""
    throttle = 0.6 if observation.messages else 0.4
    messages = (Message("note", b"hello"),) if ego == "0" else ()
    return Reply(control=pedals(throttle).control, messages=messages)


def run_with_drivers() -> tuple[str, int]:
    drivers = {ego: LocalDriver(Says(lambda seen, ego=ego: decide(ego, seen), *SENSORS[ego])) for ego in "01"}
    record = run_episode(make_config(), EmptyWorld(), drivers)
    return record.digest, len(record.messages)


@pytest.mark.slow
def test_stepping_from_outside_gives_the_digest_of_run_episode() -> None:
    simulation = make_simulation(SENSORS)
    observations = simulation.reset()
    while not simulation.is_done:
        assert set(observations) == set(simulation.active_egos)
        assert all(seen.tick == simulation.tick for seen in observations.values())
        observations = simulation.step({ego: decide(ego, seen) for ego, seen in observations.items()})
    record = simulation.finish()
    assert observations == {}
    assert (record.digest, len(record.messages)) == run_with_drivers()
    assert {ending.end for ending in record.endings} == {End.ARRIVED}


def test_a_caller_sees_what_arrived_how_cavs_ended_and_the_digest_so_far() -> None:
    simulation = make_simulation(SENSORS)
    observations = simulation.reset()
    digests, received, endings = [simulation.digest], 0, []
    while not simulation.is_done:
        received += len(simulation.received_messages.get("1", ()))
        assert {one.sender for one in simulation.received_messages.get("1", ())} <= {"0"}  # not its pseudonym
        endings.append(dict(simulation.endings))
        observations = simulation.step({ego: decide(ego, seen) for ego, seen in observations.items()})
        digests.append(simulation.digest)
    record = simulation.finish()
    assert digests[0] == ""
    assert digests[1:-1] == [bytes(digest).hex() for digest in record.digests[: len(digests) - 2]]
    assert digests[-1] == simulation.digest == record.digest  # the last step records the last two ticks
    assert received > 10
    assert endings[0] == {}
    assert tuple(simulation.endings.values()) == tuple(sorted(record.endings, key=lambda ending: ending.tick))


def test_a_busy_cav_gets_no_observation_and_keeps_its_messages_until_the_next_one() -> None:
    simulation = make_simulation(SENSORS)
    observations = simulation.reset()
    counts: list[int] = []
    for _ in range(12):
        replies = {ego: decide(ego, seen) for ego, seen in observations.items()}
        busy = {"1"} if simulation.tick % 4 != 3 else set[str]()
        observations = simulation.step(replies, busy)
        assert ("1" in observations) == (not busy)
        if not busy:
            counts.append(len(observations["1"].messages))
    assert max(counts) > 1


def test_a_fixed_clock_lets_a_cav_repeat_its_last_control() -> None:
    config = EpisodeConfig(SCENARIO, straight_road(), seed=3, options=EpisodeOptions(clock=parse_clock("fixed:100")))
    seen: Mapping[str, Says] = {ego: Says(lambda seen: decide("1", seen)) for ego in "01"}
    run_episode(config, EmptyWorld(), {ego: LocalDriver(agent) for ego, agent in seen.items()})
    assert [one.tick for one in seen["1"].seen[:4]] == [0, 2, 4, 6]


def test_a_failed_agent_gets_no_more_observations_from_the_current_tick_on() -> None:
    simulation = make_simulation(SENSORS)
    observations = simulation.reset()
    for _ in range(3):
        observations = simulation.step({ego: decide(ego, seen) for ego, seen in observations.items()})
    simulation.fail_agent("0", AgentFailure(FailureReason.CRASHED, "out of memory"))
    observations = simulation.step({ego: decide(ego, seen) for ego, seen in observations.items()})
    assert list(observations) == ["1"]
    simulation.fail_agent("1", AgentFailure(FailureReason.TIMEOUT, "no answer"))
    while not simulation.is_done:
        assert simulation.step({}) == {}
    assert [(ending.failed_tick, ending.failure) for ending in simulation.finish().endings] == [
        (3, FailureReason.CRASHED),
        (4, FailureReason.TIMEOUT),
    ]


def test_calls_out_of_order_are_refused() -> None:
    simulation = make_simulation(SENSORS)
    with pytest.raises(RuntimeError, match="expected reset"):
        simulation.step({})
    simulation.reset()
    with pytest.raises(RuntimeError, match="expected one reset"):
        simulation.reset()
    with pytest.raises(RuntimeError, match="expected every CAV to have ended"):
        simulation.finish()
    for ego in "01":
        simulation.fail_agent(ego, AgentFailure(FailureReason.CRASHED, ""))
    simulation.step({})
    with pytest.raises(RuntimeError, match="expected no step"):
        simulation.step({})


def test_an_unknown_sensor_is_refused_before_the_first_tick() -> None:
    with pytest.raises(InputError, match="sensor 'sonar': expected one of"):
        make_simulation({"0": (SensorSpec("sonar"),), "1": ()})
