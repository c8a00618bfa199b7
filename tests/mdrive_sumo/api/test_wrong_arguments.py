"""Arguments of the Python front door that are of a wrong type get a sentence, not an AttributeError from inside."""

from typing import Any

import numpy as np
import pytest

import mdrive_sumo as md
from mdrive_sumo.contract import Briefing, Observation, SensorSpec
from mdrive_sumo.core.errors import InputError

SCENARIO = "i01_ins_c_main_street_right"


class Agent:
    label = "single"

    def __init__(self, config: object) -> None:
        """It needs no options."""

    def sensors(self) -> Any:
        return ()

    def start(self, briefing: Briefing) -> None: ...

    def act(self, seen: Observation) -> Any:
        return {"throttle": 0.5}


class NoSensors(Agent):
    def sensors(self) -> Any:
        return None


class DictSensors(Agent):
    def sensors(self) -> Any:
        return ({"kind": "lidar"},)


@pytest.mark.parametrize("agent", [3, None, ["idm"], md])
def test_what_is_no_agent_is_refused(agent: Any) -> None:
    for call in (lambda: md.simulate(SCENARIO, agent), lambda: md.evaluate(agent=agent, scenario=SCENARIO)):
        with pytest.raises(InputError, match=r"agent: expected a name .* found "):
            call()


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda: md.simulate(3), "scenario: expected the id of a scenario, or a scenario, found 3"),  # pyright: ignore
        (lambda: md.simulate(SCENARIO, "imd"), "found neither; did you mean 'idm'?"),
        (lambda: md.simulate(SCENARIO, agent_config=3), "agent_config: expected a mapping"),  # pyright: ignore
        (lambda: md.simulate(SCENARIO, seed="a"), "seed: expected an integer, found 'a'"),  # pyright: ignore
        (lambda: md.Simulation(SCENARIO, seed=1.5), "seed: expected an integer, found 1.5"),  # pyright: ignore
        (lambda: md.evaluate(seeds=1.5), "seeds: expected an integer, found 1.5"),  # pyright: ignore
        (lambda: md.evaluate(seeds=["a"]), "seed: expected an integer, found 'a'"),  # pyright: ignore
        (lambda: md.simulate(SCENARIO, seed=-1), "seed: expected an integer from 0 to 2147483647, found -1"),
        (lambda: md.evaluate(md.load_suite("v2xpnp@0"), scenario=4), "scenario: expected a text, found 4"),  # pyright: ignore
        (lambda: md.evaluate(workers=0), "workers: expected a whole number from 1, found 0"),
        (lambda: md.evaluate_open(workers=0), "workers: expected a whole number from 1, found 0"),
        (lambda: md.evaluate(progres=True), "found 'progres'; did you mean 'progress'?"),  # pyright: ignore
        (lambda: md.simulate(SCENARIO, sede=1), "found 'sede'; did you mean 'seed'?"),  # pyright: ignore
        (lambda: md.Simulation(SCENARIO, sensor=()), "did you mean 'sensors'?"),  # pyright: ignore
        (lambda: md.evaluate_open(scenarios="i01*"), "did you mean 'scenario'?"),  # pyright: ignore
        (lambda: md.simulate(SCENARIO, suite=4), "suite: expected the name or the folder"),  # pyright: ignore
        (lambda: md.simulate(SCENARIO, comm=4), "comm: expected one of ideal"),  # pyright: ignore
        (lambda: md.load_suite(4), "suite: expected the name or the folder of a suite, found 4"),  # pyright: ignore
        (lambda: md.evaluate(4), "suite: expected a suite, its name or its folder, found 4"),  # pyright: ignore
        (lambda: md.Simulation(SCENARIO, sensors=3), "sensors(): expected a tuple of SensorSpec, found int"),  # pyright: ignore
        (lambda: md.simulate(SCENARIO, NoSensors), "sensors(): expected a tuple of SensorSpec, found NoneType"),
        (lambda: md.simulate(SCENARIO, DictSensors), "expected a tuple of SensorSpec, found {'kind': 'lidar'} in it"),
        (lambda: md.simulate(SCENARIO, agent=Agent), "CAV 0: expected a Reply, found dict; return Reply(control="),
    ],
)
def test_a_wrong_type_is_named(call: Any, sentence: str) -> None:
    with pytest.raises(md.MdriveError) as caught:
        call()
    assert sentence in str(caught.value)


def test_sensors_may_be_a_list() -> None:
    with md.Simulation(SCENARIO, sensors=[SensorSpec("speedometer")]) as simulation:
        assert next(iter(simulation.reset().values())).speedometer is not None


def test_a_seed_of_numpy_is_a_seed() -> None:
    simulation = md.Simulation(SCENARIO, seed=np.int64(3))  # pyright: ignore
    md.Simulation.close_open()
    assert type(simulation.seed) is int and simulation.seed == 3
