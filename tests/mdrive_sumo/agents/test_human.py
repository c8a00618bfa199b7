"""The car of a person: which agents may drive it, and what it has on board."""

import pytest
from testing.planning import briefing, own, seen, things

from mdrive_sumo.agents.human import HumanAgent, HumanReplayAgent
from mdrive_sumo.agents.registry import AGENTS, ASKING_AGENTS, DETECTOR_AGENTS, HUMAN_AGENTS, LEARNED_AGENTS
from mdrive_sumo.contract import STANDSTILL
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.v2x.messages import CAM, CPM

OTHER_DETECTORS = {"idm", *(name for name in AGENTS if name.startswith("perception-swap:"))}
"""Their sensor of objects is not that on board."""


def test_every_agent_may_drive_that_needs_no_other_sensor_and_no_language_model() -> None:
    names = {*AGENTS} - {*HUMAN_AGENTS} - {*ASKING_AGENTS} - {*LEARNED_AGENTS} - {*DETECTOR_AGENTS}
    allowed: set[str] = set()
    for name in names:
        try:
            allowed.add(HumanAgent({"substitutes": name}).substitutes[0])
        except InputError as error:
            assert "expected agents that need no other sensor than is on board" in str(error)
    assert allowed == names - OTHER_DETECTORS


def test_sensors_are_those_of_the_car_and_of_all_that_may_drive() -> None:
    (plain,) = HumanAgent({"substitutes": ""}).sensors()
    assert plain == AGENTS["sharing"]({}).sensors()[0]
    many = HumanAgent({"substitutes": "single, sharing,constant-speed,omniscient,single"})
    assert many.substitutes == ("single", "sharing", "constant-speed", "omniscient")
    assert [spec.kind for spec in many.sensors()] == ["objects", "privileged"]
    assert many.sensors()[0] == plain


def test_the_car_alone_stands_and_sends() -> None:
    car = HumanAgent({})
    car.start(briefing())
    reply = car.act(seen(4, own(), things((20.0, 0.0, 0.0, 0.0))))
    assert (reply.control, [message.type for message in reply.messages]) == (STANDSTILL, [CAM, CPM])
    mute = HumanAgent({"v2x": "off"})
    mute.start(briefing())
    assert mute.act(seen(4, own(), things())).messages == ()
    assert (car.label, mute.label) == ("sharing", "single")


def test_a_replay_has_the_options_of_its_take() -> None:
    assert HumanReplayAgent({"take": "anywhere", "v2x": "off"}).label == "single"
    with pytest.raises(InputError, match="agent human: expected options among"):
        HumanAgent({"take": "anywhere"})
