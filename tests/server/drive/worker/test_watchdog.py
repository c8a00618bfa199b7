"""Processes of a drive that no longer answer are ended, people are told, and nothing that was driven is lost."""

import os
import signal
import socket
from collections.abc import Iterator
from pathlib import Path
from typing import cast

import pytest
from testing.drives import DriveSession, list_group, make_setup, run_drive, verify

from server.drive import simulation_process
from server.drive.message_socket import MessageSocket
from server.drive.protocol import FrameState
from server.drive.simulation_process import DriveFrame, TakeStatus
from server.drive.worker.child import Child, ChildProcesses, ChildRole
from server.drive.worker.orders import TakeOrder
from server.drive.worker.take_journal import read_journal
from server.drive.worker.watchdog import MAX_COUNTED_S, WORK_LIMIT_S, Watchdog

ORDER = cast(TakeOrder, object())


@pytest.fixture
def child() -> Iterator[Child]:
    """A live take whose process reads nothing."""
    ours, theirs = socket.socketpair()
    with ours, theirs:
        yield Child(MessageSocket(ours), ChildRole.LIVE, ORDER)


def show(child: Child, state: FrameState) -> None:
    child.frame = DriveFrame(1, 5, state, {}, {}, b"", {})


@pytest.mark.parametrize("state", [FrameState.RUNNING, FrameState.SLOW])
def test_a_take_that_goes_on_owes_frames(child: Child, state: FrameState) -> None:
    watchdog = Watchdog(3.0)
    show(child, state)
    assert watchdog.is_needed([child])
    assert [watchdog.find_hanging([child], 0.5) for _ in range(6)] == 6 * [[]]
    assert watchdog.find_hanging([child], 0.5) == [child]
    child.silent_s = 0.0
    assert watchdog.find_hanging([child], 0.5) == []


def test_a_take_that_is_paused_owes_answers_only(child: Child) -> None:
    watchdog = Watchdog(3.0)
    show(child, FrameState.PAUSED)
    assert not watchdog.is_needed([child])
    for _ in range(100):
        assert watchdog.find_hanging([child], 0.5) == []
    child.calls[1] = "resume"
    assert [watchdog.find_hanging([child], 0.5) for _ in range(6)] == 6 * [[]], "the time of the pause does not count"
    assert watchdog.find_hanging([child], 0.5) == [child]


def test_a_machine_that_stood_still_ends_no_process(child: Child) -> None:
    watchdog = Watchdog(3 * MAX_COUNTED_S)
    show(child, FrameState.RUNNING)
    assert watchdog.find_hanging([child], 3600.0) == []


@pytest.mark.parametrize(
    ("role", "order", "is_watched"),
    [
        (ChildRole.STARTING, ORDER, True),
        (ChildRole.FINISHING, ORDER, True),
        (ChildRole.LEFT, ORDER, False),
        (ChildRole.HELPING, ORDER, False),
        (ChildRole.HELPING, None, False),
    ],
)
def test_work_in_the_background_has_more_time(
    child: Child, role: ChildRole, order: TakeOrder, is_watched: bool
) -> None:
    child.role, child.order = role, order
    watchdog = Watchdog(3.0)
    looks = [watchdog.find_hanging([child], 1.0) for _ in range(int(WORK_LIMIT_S) + 1)]
    assert looks[:-1] == [[]] * int(WORK_LIMIT_S)
    assert looks[-1] == ([child] if is_watched else [])


def test_inputs_for_a_process_that_does_not_read_wait_for_nothing(child: Child) -> None:
    for _ in range(20_000):
        child.tell_if_ready("an input of a person")


def test_a_checkpoint_that_does_not_answer_is_asked_only_once(child: Child) -> None:
    """The person tries the branch again; then it begins from another one."""
    children, (waiting, other) = ChildProcesses(child.connection), socket.socketpair()
    with other:
        children.ladder.add(1, 40, MessageSocket(waiting), ())
        child.checkpoint = (1, 40)
        children.end(child)
        assert len(children.ladder) == 0


@pytest.mark.slow
@pytest.mark.usefixtures("in_process")
def test_a_take_that_hangs_is_ended_and_people_drive_on_from_its_last_tick(suite: Path, tmp_path: Path) -> None:
    folder = tmp_path / "drive"

    async def drive(session: DriveSession) -> None:
        await session.open(make_setup(folder, suite, checkpoint_s=0.0, tick_limit_s=1.0))
        await session.drive_to(20)
        (live,) = [pid for pid in list_group(session.group) if pid != session.group]
        await session.process.resume()
        await session.drive_on(5)
        os.kill(live, signal.SIGSTOP)
        await session.wait_for(lambda: session.problems)
        assert session.problems == [
            "the process of take 1 has said nothing for 1 s and was ended; its actions are kept: go back to a tick to"
            " drive on"
        ]
        last, journal = session.frames[-1], folder / "takes" / "1.actions.jsonl"
        assert (last.take, last.state) == (1, FrameState.FINISHED), "pages see that it no longer goes on"
        assert len(read_journal(journal)[1]) >= last.tick
        assert session.process.tree.takes[1].left_tick == last.tick
        assert await session.process.branch(1, last.tick) == 2
        await session.wait_for(lambda: session.frames[-1].take == 2)
        await session.drive_to(last.tick + 10)
        await session.close()
        assert session.process.tree.takes[1].status is TakeStatus.FINISHED

    run_drive(drive)
    for number in (1, 2):
        verify(folder / "takes" / str(number))


@pytest.mark.slow
@pytest.mark.usefixtures("in_process")
def test_a_supervisor_that_hangs_is_ended(suite: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(simulation_process, "PING_EVERY_S", 0.1)
    monkeypatch.setattr(simulation_process, "PING_LIMIT_S", 0.3)
    folder = tmp_path / "drive"

    async def drive(session: DriveSession) -> None:
        await session.open(make_setup(folder, suite))
        await session.drive_to(20)
        group = session.group
        os.killpg(group, signal.SIGSTOP)
        await session.wait_for(lambda: session.problems)
        assert "has ended; open the drive again" in session.problems[-1]
        await session.close(0.0)
        assert "R" not in list_group(group).values() and "T" not in list_group(group).values()

    run_drive(drive)
    assert len(read_journal(folder / "takes" / "1.actions.jsonl")[1]) >= 20
