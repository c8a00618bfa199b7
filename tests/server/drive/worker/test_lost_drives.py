"""Drives whose processes are killed, whose disk is full, whose journal is damaged: nothing that was driven is lost."""

import asyncio
import os
import resource
import signal
import time
from pathlib import Path
from shutil import copytree

import pytest
from testing.drives import DriveSession, list_group, make_setup, run_drive, verify
from testing.takes import load_recorded

from mdrive_sumo.core.errors import InputError
from server.drive.protocol import FrameState
from server.drive.simulation_process import (
    SimulationEnded,
    TakeStatus,
)
from server.drive.take_tree import load_tree
from server.drive.worker.take_journal import read_journal
from server.drive.worker.waiting_takes import MAX_LEFT

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("in_process")]


@pytest.mark.full
@pytest.mark.parametrize("victim", ["supervisor", "everything"])
def test_a_killed_drive_loses_nothing(suite: Path, tmp_path: Path, victim: str) -> None:
    """Every action before the kill is in the journal: the take is finished as left; a new one goes on from there."""
    folder = tmp_path / "drive"

    async def drive(session: DriveSession) -> None:
        await session.open(make_setup(folder, suite))
        await session.drive_to(30)
        await session.process.branch(1, 20)
        await session.process.resume()
        await session.wait_for(lambda: session.frames[-1].take == 2 and session.tick > 25)
        seen = session.tick
        os.kill(session.group, signal.SIGKILL) if victim == "supervisor" else os.killpg(session.group, signal.SIGKILL)
        await session.wait_for(lambda: session.problems)
        assert "has ended; open the drive again" in session.problems[-1]
        with pytest.raises(SimulationEnded):
            await session.process.pause()
        deadline = time.monotonic() + 10
        while any(state != "Z" for state in list_group(session.group).values()) and time.monotonic() < deadline:
            time.sleep(0.05)
        _, ticks = read_journal(folder / "takes" / "2.actions.jsonl")
        assert len(ticks) >= seen
        await session.close()

    run_drive(drive)
    _, before = read_journal(folder / "takes" / "2.actions.jsonl")

    async def go_on(session: DriveSession) -> None:
        await session.open(make_setup(folder, suite))
        started = session.process.tree.takes[3]
        assert (started.parent, started.tick) == (2, len(before))
        await session.drive_to(10_000)
        await session.wait_until_ended(1, 2, 3)
        assert session.problems == []
        await session.close()

    run_drive(go_on)
    tree = load_tree(folder)
    records = {number: load_recorded(tree.find_folder(number)) for number in tree.takes}
    assert (records[3].digests[: len(before)] == records[2].digests[: len(before)]).all()
    assert tree.takes[2].left_tick == len(before)
    for number in tree.takes:
        verify(tree.find_folder(number))


def test_a_full_disk_pauses_the_drive_and_loses_nothing(suite: Path, tmp_path: Path) -> None:
    """A limit on the size of files stands for the disk: writing fails in the same place."""
    folder = tmp_path / "drive"

    async def drive(session: DriveSession) -> None:
        await session.open(make_setup(folder, suite))
        await session.drive_to(20)
        pids = list(list_group(session.group))
        before = {pid: resource.prlimit(pid, resource.RLIMIT_FSIZE) for pid in pids}
        size = (folder / "takes" / "1.actions.jsonl").stat().st_size + 200
        for pid in pids:
            resource.prlimit(pid, resource.RLIMIT_FSIZE, (size, before[pid][1]))
        await session.process.resume()
        await session.wait_for(lambda: session.problems)
        assert session.problems[-1].startswith("the drive is paused: its journal cannot be written: File too large")
        await session.wait_for(lambda: session.frames[-1].state is FrameState.PAUSED)
        stopped = session.tick
        for pid in pids:
            resource.prlimit(pid, resource.RLIMIT_FSIZE, (100, before[pid][1]))
        with pytest.raises(InputError, match="cannot be written"):
            await session.process.branch(1, stopped)
        for pid in pids:
            resource.prlimit(pid, resource.RLIMIT_FSIZE, before[pid])
        await session.drive_to(10_000)
        await session.wait_until_ended(1)
        assert [frame.tick for frame in session.frames if frame.tick == stopped + 1]
        await session.close()

    run_drive(drive)
    verify(folder / "takes" / "1")


def test_no_process_is_left_when_a_drive_is_closed(suite: Path, tmp_path: Path) -> None:
    async def drive(session: DriveSession) -> None:
        await session.open(make_setup(tmp_path / "drive", suite, checkpoint_s=0.25))
        group = session.group
        await session.drive_to(40)
        await session.process.branch(1, 30)
        await session.drive_to(60)
        await session.process.branch(2, 50)
        await session.wait_until_ended(1, 2)
        running = list_group(group)
        assert len(running) > 8  # supervisor, live take, checkpoints
        assert "Z" not in running.values(), "takes that have ended are removed while the drive goes on"
        await session.close(0.0)
        assert list_group(group) == {}

    run_drive(drive)


def test_a_take_whose_process_is_killed_is_finished_from_its_journal(suite: Path, tmp_path: Path) -> None:
    folder = tmp_path / "drive"

    async def drive(session: DriveSession) -> None:
        await session.open(make_setup(folder, suite))
        await session.drive_to(20)
        await session.process.branch(1, 10)
        await session.wait_for(lambda: session.frames[-1].take == 2)
        await session.drive_to(15)
        killed = {*list_group(session.group)} - {session.group}  # the live take and the checkpoints
        for pid in killed:
            os.kill(pid, signal.SIGKILL)
        while killed & {*list_group(session.group)}:  # one that still dies would take an order and not answer
            await asyncio.sleep(0.01)
        await session.wait_for(lambda: any("process of take 2 has ended" in text for text in session.problems))
        await session.process.branch(2, 12)
        await session.wait_for(lambda: session.frames[-1].take == 3)
        await session.drive_to(14)
        await session.close()

    run_drive(drive)
    tree = load_tree(folder)
    assert {number: take.status for number, take in tree.takes.items()} == dict.fromkeys((1, 2, 3), TakeStatus.FINISHED)
    for number in tree.takes:
        verify(tree.find_folder(number))


def test_going_back_to_a_take_that_is_just_being_dropped_is_going_back_to_its_parent(
    suite: Path, tmp_path: Path
) -> None:
    """A take was left before its first tick, and its process, here a slow one, has not said so yet."""
    folder = tmp_path / "drive"

    async def drive(session: DriveSession) -> None:
        process = session.process
        await session.open(make_setup(folder, suite, checkpoint_s=0.0))
        await session.drive_to(12)
        assert await process.branch(1, 10) == 2
        slow = [pid for pid in list_group(session.group) if pid != session.group]
        for pid in slow:
            os.kill(pid, signal.SIGSTOP)
        assert await process.branch(1, 8) == 3
        assert await process.branch(2, 10) == 4
        for pid in slow:
            os.kill(pid, signal.SIGCONT)
        await session.wait_for(lambda: 2 not in process.tree.takes and session.frames[-1].take == 4)
        await session.drive_to(15)
        await session.close()

    run_drive(drive)
    tree = load_tree(folder)
    assert {number: (take.parent, take.tick) for number, take in tree.takes.items()} == {1: (None, 0), 4: (1, 10)}
    verify(tree.find_folder(4))


@pytest.mark.full
def test_many_takes_that_wait_are_no_processes_and_are_finished_all_the_same(suite: Path, tmp_path: Path) -> None:
    folder, count = tmp_path / "drive", MAX_LEFT + 8

    async def drive(session: DriveSession) -> None:
        await session.open(make_setup(folder, suite, speed_up=100.0, checkpoint_s=1.0))
        await session.drive_to(30)
        for _ in range(count):
            number = await session.process.branch(1, 20)
            await session.wait_for(lambda number=number: session.frames[-1].take == number)
            await session.drive_to(22)
        others = 3 + session.tick // 20  # supervisor, live take, one that is finished, checkpoints
        async with asyncio.timeout(30):  # those that are put aside take a while to end
            while len(list_group(session.group)) > MAX_LEFT + others + 2:
                await asyncio.sleep(0.1)
        await session.close()
        assert session.problems == []

    run_drive(drive)
    tree = load_tree(folder)
    assert len(tree.takes) == count + 1
    assert {take.status for take in tree.takes.values()} == {TakeStatus.FINISHED}
    verify(tree.find_folder(2))


@pytest.mark.full
def test_a_take_whose_journal_is_damaged_is_void_and_the_drive_goes_on(suite: Path, tmp_path: Path) -> None:
    folder = tmp_path / "drive"

    async def drive(session: DriveSession) -> None:
        await session.open(make_setup(folder, suite))
        await session.drive_to(12)
        os.killpg(session.group, signal.SIGKILL)
        await session.wait_for(lambda: session.problems)

    run_drive(drive)
    damaged = copytree(folder, tmp_path / "damaged")
    journal = damaged / "takes" / "1.actions.jsonl"
    lines = journal.read_bytes().splitlines(keepends=True)
    journal.write_bytes(b"".join([*lines[:4], b"xxx\n", *lines[5:]]))
    changed = copytree(folder, tmp_path / "changed")
    journal = changed / "takes" / "1.actions.jsonl"
    journal.write_bytes(journal.read_bytes().replace(b'"u":[0.4,0.0,0.0]', b'"u":[0.5,0.0,0.0]', 3))
    for place, sentence in ((damaged, "line 5: expected a JSON object"), (changed, "differs from the recorded one")):

        async def go_on(session: DriveSession, place: Path = place, sentence: str = sentence) -> None:
            await session.open(make_setup(place, suite))
            await session.wait_for(lambda: session.problems)
            assert sentence in session.problems[0]
            tree = session.process.tree
            assert tree.takes[1].status is TakeStatus.VOID
            live = tree.takes[max(tree.takes)]
            assert (live.parent, live.tick) == (None, 0)
            await session.drive_to(10)
            assert len(session.problems) == 1, "the end of its process is no other problem"
            assert session.process.tree.takes[1].status is TakeStatus.VOID

        run_drive(go_on)
