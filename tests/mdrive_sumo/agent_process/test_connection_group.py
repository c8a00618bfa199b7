"""Agents that are asked together: none waits for another one, and none pays for the time of another."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Timer

import pytest
from testing.fake_child import FakeChild, framed
from testing.hostile_protocol import GOOD, answer

from mdrive_sumo.agent_process import reply_decoding
from mdrive_sumo.agent_process.agent_connection import AgentConnection, AgentLimits, ConnectionGroup
from mdrive_sumo.agent_process.frame_file import FrameFolder
from mdrive_sumo.agent_process.wire_protocol import LENGTH
from mdrive_sumo.contract import Control
from mdrive_sumo.loop.agent_driver import AgentFailure

Pair = tuple[FakeChild, FakeChild, AgentConnection, AgentConnection]


@contextmanager
def later(wait_s: float, act: Callable[[], object]) -> Iterator[None]:
    """Act in a thread after a while; it has ended at the end of the block."""
    timer = Timer(wait_s, act)
    timer.start()
    yield
    timer.join()


@pytest.fixture
def pair(tmp_path: Path) -> Iterator[Pair]:
    """Two agents of one episode, each with 1.5 s for all its answers: a busy machine may stop this process a while."""
    group, children = ConnectionGroup(), (FakeChild(), FakeChild())
    folders = [FrameFolder(tmp_path) for _ in children]
    limits = AgentLimits(tick_s=60.0, episode_s=1.5, pace_s=0.3)
    first, second = (AgentConnection(*each, limits, group) for each in zip(children, folders, strict=True))
    yield *children, first, second
    for child, line in zip(children, (first, second), strict=True):
        line.close()
        child.theirs.close()


def test_no_agent_pays_for_the_time_of_another(
    pair: Pair,
) -> None:
    """The answer of the second was read only after that of the first, and had its think time: a slow agent used up the
    time that another one has for an episode, also one of another team in cross-play."""
    slow, quick, first, second = pair
    for line in (first, second):
        line.send("act", 1, None)
    quick.theirs.send(framed(answer(1, GOOD))[:20])
    quick.theirs.send(framed(answer(1, GOOD))[20:])
    with later(0.6, lambda: slow.theirs.send(framed(answer(1, GOOD)))):
        for line in (first, second):
            assert line.receive(reply_decoding.read_reply).control == Control(0.25, 0.0, 0.1)
    assert second.think_times_s[0] < 0.3 < 0.5 < first.think_times_s[0]
    assert [line.usage_record()["thought_ms"]["late"] for line in (first, second)] == [1, 0]


def test_an_agent_that_does_not_read_delays_no_other(
    pair: Pair,
) -> None:
    deaf, quick, first, second = pair
    first.prepare("act", 1, b"x" * 20_000_000)
    second.prepare("act", 1, None)
    begin = time.monotonic()
    first.send_prepared()
    second.send_prepared()
    assert time.monotonic() - begin < 1.0 and quick.theirs.recv(4)
    quick.theirs.send(framed(answer(1, GOOD)))
    deaf.theirs.send(framed(answer(1, GOOD)))  # without having read
    with pytest.raises(AgentFailure, match="expected no answer before the whole request, found one"):
        first.receive(reply_decoding.read_reply)
    assert second.receive(reply_decoding.read_reply).control == Control(0.25, 0.0, 0.1)
    assert second.think_times_s[0] < 1.0


@pytest.mark.parametrize(
    ("data", "text"),
    [
        (b"", "the agent's process ended"),
        (LENGTH.pack(70_000), "at most 65536 bytes, found 70000"),
        (LENGTH.pack(0), "at most 65536 bytes, found 0"),
        (framed(answer(1, GOOD)) + b"x", "expected one answer, found more"),
        (framed(answer(1, GOOD))[:-1], "no answer within the time limit"),
    ],
    ids=["end", "long", "empty", "more", "less"],
)
def test_failures_in_a_group_are_those_of_a_single_agent(pair: Pair, data: bytes, text: str) -> None:
    good, bad, first, second = pair
    for line in (first, second):
        line.send("act", 1, None)
    good.theirs.send(framed(answer(1, GOOD)))
    if data:
        bad.theirs.send(data)
    else:
        bad.theirs.close()
    first.receive(reply_decoding.read_reply)
    with pytest.raises(AgentFailure, match=text):
        second.receive(reply_decoding.read_reply)
