"""`Simulation`: the caller owns the loop."""

from collections.abc import Callable

import pytest

import mdrive_sumo as md
from mdrive_sumo.agents.registry import AGENTS
from mdrive_sumo.core.state import End

pytestmark = pytest.mark.slow

SCENARIO = "i02_ins_c_boulevard_straight"


def drive(simulation: md.Simulation, stop: Callable[[], bool] = lambda: False) -> None:
    agents = {ego: AGENTS["constant-speed"]({}) for ego in simulation.briefings}
    for ego, briefing in simulation.briefings.items():
        agents[ego].start(briefing)
    observations = simulation.reset()
    while not simulation.is_done and not stop():
        observations = simulation.step({ego: agents[ego].act(seen) for ego, seen in observations.items()})


def test_the_loop_of_the_caller_gives_the_episode_of_simulate_also_after_a_reset() -> None:
    simulation = md.Simulation(SCENARIO, sensors=())
    drive(simulation, stop=lambda: simulation.tick == 10)
    assert simulation.tick == 10 and simulation.active_egos and simulation.frame.egos
    drive(simulation)
    assert simulation.episode.digest == md.simulate(SCENARIO, agent="constant-speed").digest
    assert simulation.episode.result.ds < 100


def test_only_declared_sensors_are_observed() -> None:
    first, *others = md.Simulation(SCENARIO).briefings
    with md.Simulation(SCENARIO, sensors={first: [md.SensorSpec("speedometer")]}) as simulation:
        observations = simulation.reset()
    assert observations[first].speedometer is not None and observations[first].objects is None
    assert all(observations[ego].speedometer is None for ego in others)


def test_a_second_simulation_closes_the_first() -> None:
    first, second = md.Simulation(SCENARIO), md.Simulation(SCENARIO)
    first.reset()
    second.reset()
    with pytest.raises(md.InputError, match=r"found a closed one; reset\(\) starts it anew"):
        first.step({})
    second.close()


def test_unusable_replies_are_named() -> None:
    with md.Simulation(SCENARIO) as simulation:
        ego = next(iter(simulation.reset()))
        with pytest.raises(md.InputError, match=f"reply of CAV {ego}: throttle: expected a number in"):
            simulation.step({ego: md.Reply(control=md.Control(2.0, 0.0, 0.0))})
        with pytest.raises(md.InputError, match=r"expected replies of .*, found 'stranger'"):
            simulation.step({"stranger": md.Reply()})


def test_the_caller_may_end_a_cav() -> None:
    with md.Simulation(SCENARIO) as simulation:
        for ego in simulation.reset():
            simulation.end(ego)
        assert simulation.step({}) == {}
    assert {ending.end for ending in simulation.episode.record.endings} == {End.AGENT_FAILED}
