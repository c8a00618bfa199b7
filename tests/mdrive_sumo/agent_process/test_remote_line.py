"""The line to an agent's process, with an other end that this test plays itself."""

import socket
import time
from collections.abc import Iterator
from pathlib import Path

import msgpack
import pytest
from testing.fake_child import FakeChild, framed
from testing.hostile_protocol import GOOD, answer

from mdrive_sumo.agent_process import reply_decoding
from mdrive_sumo.agent_process.agent_connection import AgentConnection, AgentLimits
from mdrive_sumo.agent_process.frame_file import FrameFolder
from mdrive_sumo.agent_process.wire_protocol import LENGTH
from mdrive_sumo.contract import Control
from mdrive_sumo.core.state import FailureReason
from mdrive_sumo.loop.agent_driver import AgentFailure


@pytest.fixture
def child() -> Iterator[FakeChild]:
    child = FakeChild()
    yield child
    for end in (child.socket, child.theirs):
        end.close()


@pytest.fixture
def line(child: FakeChild, tmp_path: Path) -> Iterator[AgentConnection]:
    line = AgentConnection(child, FrameFolder(tmp_path), AgentLimits(tick_s=60.0))
    yield line
    line.close()


@pytest.fixture
def hasty(child: FakeChild, tmp_path: Path) -> Iterator[AgentConnection]:
    """A line that soon gives up waiting."""
    line = AgentConnection(child, FrameFolder(tmp_path), AgentLimits(tick_s=0.3))
    yield line
    line.close()


def fails(line: AgentConnection, failure: FailureReason, text: str) -> None:
    with pytest.raises(AgentFailure) as caught:
        line.send("act", 1, None)
        line.receive(reply_decoding.read_reply)
    assert (caught.value.failure, caught.value.text) == (failure, text)
    assert line.usage_record()["failure"] == text


def test_one_request_one_answer(child: FakeChild, line: AgentConnection) -> None:
    for tick in range(3):
        line.send("act", tick, {"x": tick})
        size = LENGTH.unpack(child.theirs.recv(4))[0]
        told = msgpack.unpackb(child.theirs.recv(size))
        assert (told["call"], told["tick"]) == ("act", tick)
        child.theirs.send(framed(answer(tick, GOOD)))
        assert line.receive(reply_decoding.read_reply).control == Control(0.25, 0.0, 0.1)
    line.close()
    record = line.usage_record()
    assert (record["answers"], record["failure"], record["exit_code"]) == (3, "", 7)
    assert 0 < record["thought_ms"]["p50"] <= record["thought_ms"]["max"] <= record["thought_ms"]["sum"]


def test_an_answer_before_the_request_answers_nothing(child: FakeChild, line: AgentConnection) -> None:
    child.theirs.send(framed(answer(1, GOOD)))
    fails(line, FailureReason.INVALID, "act: expected no answer before the request, found one")
    assert child.closed == 1


def test_two_answers_are_one_too_many(child: FakeChild, line: AgentConnection) -> None:
    line.send("act", 1, None)
    child.theirs.send(framed(answer(1, GOOD)) + framed(answer(2, GOOD)))
    with pytest.raises(AgentFailure, match="expected one answer, found more"):
        line.receive(reply_decoding.read_reply)


def test_the_answer_of_another_tick_is_none(child: FakeChild, line: AgentConnection) -> None:
    line.send("act", 5, None)
    child.theirs.send(framed(answer(4, GOOD)))
    with pytest.raises(AgentFailure, match="act: expected the answer of tick 5, found that of 4"):
        line.receive(reply_decoding.read_reply)


def test_silence_runs_out_of_time(hasty: AgentConnection) -> None:
    begin = time.monotonic()
    fails(hasty, FailureReason.TIMEOUT, "act: no answer within the time limit tick (0.3 s)")
    assert 0.2 < time.monotonic() - begin < 30.0


def test_the_deadline_is_for_the_whole_answer(child: FakeChild, hasty: AgentConnection) -> None:
    child.drip = framed(answer(1, GOOD))
    begin = time.monotonic()
    fails(hasty, FailureReason.TIMEOUT, "act: no answer within the time limit tick (0.3 s)")
    assert time.monotonic() - begin < 30.0
    assert child.drip  # it would have gone on


@pytest.mark.slow
def test_an_answer_in_pieces_in_time_is_one(child: FakeChild, tmp_path: Path) -> None:
    line = AgentConnection(child, FrameFolder(tmp_path), AgentLimits(tick_s=60.0))
    child.drip = framed(answer(1, GOOD))
    line.send("act", 1, None)
    assert line.receive(reply_decoding.read_reply).control == Control(0.25, 0.0, 0.1)
    line.close()


@pytest.mark.slow
def test_an_agent_that_does_not_read_runs_out_of_time(child: FakeChild, tmp_path: Path) -> None:
    line = AgentConnection(child, FrameFolder(tmp_path), AgentLimits(tick_s=1.0))
    begin = time.monotonic()
    with pytest.raises(AgentFailure, match="act: the agent does not read within the time limit") as caught:
        line.prepare("act", 1, b"x" * 20_000_000)
        sent = time.monotonic()
        line.send_prepared()
        assert time.monotonic() - sent < 0.8, "other agents are asked meanwhile"
        line.receive(reply_decoding.read_reply)
    line.close()
    assert caught.value.failure is FailureReason.TIMEOUT
    assert time.monotonic() - begin < 30.0


def test_lengths_beyond_the_limit_are_not_read(child: FakeChild, line: AgentConnection) -> None:
    line.send("act", 1, None)
    child.theirs.send(LENGTH.pack(65537))
    with pytest.raises(AgentFailure, match="expected an answer of at most 65536 bytes, found 65537") as caught:
        line.receive(reply_decoding.read_reply)
    assert caught.value.failure is FailureReason.INVALID


def test_the_limit_is_a_setting(child: FakeChild, tmp_path: Path) -> None:
    notes = [{"": "Note", "kind": "llm", "text": "x" * 100_000}]
    line = AgentConnection(child, FrameFolder(tmp_path), AgentLimits(reply_bytes=200_000))
    line.send("act", 1, None)
    child.theirs.sendall(framed(answer(1, {**GOOD, "notes": notes})))
    assert len(line.receive(reply_decoding.read_reply).notes[0].text) == 100_000
    line.close()


def test_all_answers_of_an_episode_together_have_a_limit_of_bytes(child: FakeChild, tmp_path: Path) -> None:
    line = AgentConnection(child, FrameFolder(tmp_path), AgentLimits(episode_bytes=500))
    with pytest.raises(
        AgentFailure, match="act: expected answers of at most 500 bytes in an episode, found more"
    ) as found:
        for tick in range(100):
            line.send("act", tick, None)
            child.theirs.sendall(framed(answer(tick, GOOD)))
            line.receive(reply_decoding.read_reply)
    assert found.value.failure is FailureReason.INVALID
    assert 2 <= line.usage_record()["answers"] < 10


def test_the_end_of_the_process_is_seen_at_once(child: FakeChild, line: AgentConnection) -> None:
    line.send("act", 1, None)
    child.theirs.send(b"\x05")
    child.theirs.close()
    begin = time.monotonic()
    with pytest.raises(AgentFailure, match=r"act: the agent's process ended \(exit code 7\)") as caught:
        line.receive(reply_decoding.read_reply)
    assert caught.value.failure is FailureReason.CRASHED
    assert time.monotonic() - begin < 30.0


def test_descriptors_that_are_passed_along_are_dropped(child: FakeChild, line: AgentConnection) -> None:
    line.send("act", 1, None)
    before = len(list(Path("/proc/self/fd").iterdir()))
    socket.send_fds(child.theirs, [framed(answer(1, GOOD))], [child.theirs.fileno()] * 50)
    assert line.receive(reply_decoding.read_reply).control == Control(0.25, 0.0, 0.1)
    assert len(list(Path("/proc/self/fd").iterdir())) == before


def test_all_answers_of_an_episode_have_a_limit(child: FakeChild, tmp_path: Path) -> None:
    line = AgentConnection(child, FrameFolder(tmp_path), AgentLimits(tick_s=60.0, episode_s=0.1))
    begin = time.monotonic()
    with pytest.raises(AgentFailure, match=r"no answer within the time limit episode \(0.1 s\)$"):
        line.send("act", 1, None)
        line.receive(reply_decoding.read_reply)
    assert time.monotonic() - begin < 30.0


def test_a_socket_that_is_readable_without_data_observes_the_deadline(child: FakeChild, hasty: AgentConnection) -> None:
    child.false_alarms = 200
    fails(hasty, FailureReason.TIMEOUT, "act: no answer within the time limit tick (0.3 s)")
    assert child.false_alarms > 100
