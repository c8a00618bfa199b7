"""Detections that an observation computes when they are first read."""

import copy
from dataclasses import fields, replace

import numpy as np
import pytest

from mdrive_sumo.agent_process import wire_protocol
from mdrive_sumo.contract import STANDSTILL, Briefing, Objects, Observation, OwnState, Reply, SensorSpec
from mdrive_sumo.core.clock import parse_clock
from mdrive_sumo.core.errors import WorldError
from mdrive_sumo.loop.agent_driver import AgentFailure, LocalDriver
from mdrive_sumo.loop.agent_scheduler import AgentScheduler
from mdrive_sumo.sensing.observation_builder import _sense_or_void  # pyright: ignore[reportPrivateUsage]

OWN = OwnState(1, 2, 3, 4, 5, 6, 7)
CAR = Objects(("a",), np.zeros(1, dtype=np.uint8), *(np.arange(1.0) for _ in range(6)))


def deferred() -> tuple[Observation, list[int]]:
    """An observation, and a list that grows with each computation of its detections."""
    calls: list[int] = []
    seen = Observation(5, OWN)
    seen.defer(lambda: calls.append(1) or CAR)
    return seen, calls


def test_detections_are_computed_once_and_only_if_they_are_read() -> None:
    seen, calls = deferred()
    assert (seen.tick, seen.messages, calls) == (5, (), [])
    assert seen.objects is CAR and seen.objects is CAR
    assert calls == [1]


def test_every_other_use_of_an_observation_finds_them() -> None:
    plain = Observation(5, OWN, CAR)
    assert replace(deferred()[0], tick=6).objects is CAR
    assert copy.copy(deferred()[0]).objects is CAR
    assert wire_protocol.encode(deferred()[0]) == wire_protocol.encode(plain)
    assert repr(deferred()[0]) == repr(plain)
    assert [field.name for field in fields(deferred()[0])][:3] == ["tick", "own", "objects"]


def test_a_misspelt_field_is_an_attribute_error() -> None:
    seen, calls = deferred()
    with pytest.raises(AttributeError, match="'Observation' object has no attribute 'object'"):
        _ = seen.object  # pyright: ignore[reportAttributeAccessIssue, reportUnknownMemberType]
    assert not calls


class Looks:
    """An agent that reads its detections."""

    label = "single"

    def sensors(self) -> tuple[SensorSpec, ...]:
        return ()

    def start(self, briefing: Briefing) -> None: ...

    def act(self, seen: Observation) -> Reply:
        raise ValueError(f"{seen.objects}")


def test_a_failure_of_the_sensor_is_none_of_the_agent_that_reads_it() -> None:
    def fail() -> Objects:
        raise ValueError("negative radius")

    driver, seen = LocalDriver(Looks()), Observation(0, OWN)
    seen.defer(lambda: _sense_or_void(fail))
    driver.ask(seen)
    with pytest.raises(WorldError, match="objects sensor: ValueError: negative radius"):
        driver.answer()
    driver.ask(Observation(0, OWN))
    with pytest.raises(AgentFailure, match="ValueError: None"):
        driver.answer()


@pytest.mark.parametrize(("clock", "computed"), [("measured", [1]), ("ideal", [])])
def test_a_measured_clock_does_not_count_sensing_as_think_time(clock: str, computed: list[int]) -> None:
    class Driver(LocalDriver):
        def answer(self) -> Reply:
            assert calls == computed
            return Reply(control=STANDSTILL)

    seen, calls = deferred()
    scheduler = AgentScheduler({"a": Driver(Looks())}, parse_clock(clock), (), lambda *_: None)
    assert scheduler.collect_replies(5, {"a": seen})
