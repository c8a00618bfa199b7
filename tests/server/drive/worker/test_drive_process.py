"""Drives through the simulation process: real processes, and the commands for runs on what they leave."""

import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from testing.drives import DriveSession, list_group, make_setup, run_drive, verify
from testing.takes import load_recorded

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.state import End, FailureReason
from server.drive.protocol import ROW, FrameState
from server.drive.simulation_process import (
    HandedOver,
    TakeEnded,
    TakeStarted,
    TakeStatus,
)
from server.drive.take_tree import DriverChange, load_tree
from server.drive.worker.take_journal import read_journal

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("in_process")]


def test_a_branch_equals_its_parent_up_to_its_tick_and_every_take_verifies(suite: Path, tmp_path: Path) -> None:
    folder = tmp_path / "drive"

    async def drive(session: DriveSession) -> None:
        process = session.process
        await session.open(make_setup(folder, suite))
        assert (session.process.facts.people, process.facts.agents) == (("0",), ("sharing",))
        await session.drive_to(50)
        assert await process.branch(1, 33) == 2
        await session.wait_for(lambda: session.frames[-1].take == 2)
        assert (session.frames[-1].tick, session.frames[-1].state) == (33, FrameState.PAUSED)
        await process.hand_over("0", "sharing")
        await process.say("0", "go on")
        await session.drive_to(45)
        assert await process.branch(2, 20) == 3  # before the begin of take 2: it is take 1 there
        await session.drive_to(10_000)
        await session.wait_until_ended(1, 2, 3)
        assert session.problems == []
        await session.close()

    run_drive(drive)
    tree = load_tree(folder)
    assert {n: (t.parent, t.tick, t.status, t.left_tick is not None) for n, t in tree.takes.items()} == {
        1: (None, 0, TakeStatus.FINISHED, True),
        2: (1, 33, TakeStatus.FINISHED, False),  # `sharing` drove: no person left
        3: (2, 20, TakeStatus.FINISHED, False),
    }
    records = {number: load_recorded(tree.find_folder(number)) for number in tree.takes}
    for number, take in tree.takes.items():
        if take.parent is not None:
            same = records[number].digests[: take.tick] == records[take.parent].digests[: take.tick]
            assert same.all()
            assert records[number].digest != records[take.parent].digest
    left = records[1].find_ending("0")
    assert (left.end, left.failure, left.failed_tick) == (End.AGENT_FAILED, FailureReason.LEFT, tree.takes[1].left_tick)
    for number in tree.takes:
        verify(tree.find_folder(number))


def test_frames_tell_what_a_page_needs(suite: Path, tmp_path: Path) -> None:
    async def drive(session: DriveSession) -> None:
        await session.open(make_setup(tmp_path / "drive", suite, speed_up=2.0))
        process = session.process
        await session.drive_to(30)
        first, last = session.frames[0], session.frames[-1]
        assert (first.tick, first.state, first.take) == (0, FrameState.PAUSED, 1)
        assert first.extra["drivers"] == {"0": "human", "1": "sharing"}
        assert [row[:3] for row in first.extra["names"]] == [[0, "0", 0], [1, "1", 0]]
        ticks = [frame.tick for frame in session.frames]
        assert sorted(set(ticks)) == list(range(last.tick + 1))  # none is skipped
        rows = np.frombuffer(last.rows, ROW)
        own = last.own["0"]
        x, y = process.facts.origin
        assert rows["x"][0] == pytest.approx(own[0] - x, abs=2e-3)
        assert rows["y"][0] == pytest.approx(own[1] - y, abs=2e-3)
        assert len(own) == 10
        acks = [frame.acks["0"] for frame in session.frames]
        assert acks == sorted(acks)
        assert acks[-1] > 10
        cpm = next(
            message
            for frame in session.frames
            for message in frame.extra.get("messages", ())
            if message["kind"] == "cpm" and message["to"] == ["0"]
        )
        assert cpm["from"] == "1"
        assert process.known_extra["drivers"] == {"0": "human", "1": "sharing"}
        motion = await process.load_motion(1)
        length = int.from_bytes(motion[:4], "little")
        header = json.loads(motion[4 : 4 + length])
        begins = np.frombuffer(motion, "<u4", header["ticks"] + 1, 4 + length)
        assert header["ticks"] == last.tick + 1
        assert motion.endswith(last.rows)
        assert len(motion) == 4 + length + begins.nbytes + begins[-1] * ROW.itemsize

    run_drive(drive)


def check_motion(motion: bytes, frames: dict[int, bytes]) -> None:
    """frames: rows by tick, as a page got them."""
    length = int.from_bytes(motion[:4], "little")
    header = json.loads(motion[4 : 4 + length])
    begins = np.frombuffer(motion, "<u4", header["ticks"] + 1, 4 + length)
    rows = np.frombuffer(motion, ROW, begins[-1], 4 + length + begins.nbytes)
    assert header["ticks"] == len(frames)
    for tick, (begin, end) in enumerate(pairwise(begins.tolist())):
        live = np.frombuffer(frames[tick], ROW)
        for name in ("x", "y", "yaw", "speed", "lamps", "flags"):
            assert (rows[begin:end][name] == live[name]).all()


def test_a_finished_take_is_told_and_its_motion_is_that_of_its_frames(suite: Path, tmp_path: Path) -> None:
    """The motion also when the drive is opened again, and the recording is all that there is."""
    frames: dict[int, bytes] = {}

    async def drive(session: DriveSession) -> None:
        await session.open(make_setup(tmp_path / "drive", suite))
        await session.process.note_input("wheel", 12.5)
        await session.drive_to(10_000)
        await session.wait_until_ended(1)
        frames.update({frame.tick: frame.rows for frame in session.frames})
        check_motion(await session.process.load_motion(1), frames)
        assert [(event.take, event.parent, event.tick) for event in session.select(TakeStarted)] == [(1, None, 0)]
        (ended,) = session.select(TakeEnded)
        assert set(ended.ds) == {"0", "1"}
        losses = session.process.tree.takes[1].losses
        assert set(losses) == {cav for cav, score in ended.ds.items() if score < 100}
        assert all(losses.values())
        assert 0 <= ended.score <= 100
        assert not ended.is_left
        assert session.frames[-1].state is FrameState.FINISHED
        await session.close()

    async def load_again(session: DriveSession) -> None:
        await session.open(make_setup(tmp_path / "drive", suite))
        check_motion(await session.process.load_motion(1), frames)

    run_drive(drive)
    about = json.loads((tmp_path / "drive" / "takes" / "1" / "journal.jsonl").read_text().splitlines()[0])
    assert '"device":"wheel"' in json.dumps(about).replace("\\", "").replace(" ", "")
    assert '"latency_ms":12.5' in json.dumps(about).replace("\\", "").replace(" ", "")
    run_drive(load_again)


def test_what_an_agent_would_have_done_changes_no_take(suite: Path, tmp_path: Path) -> None:
    async def drive(session: DriveSession) -> None:
        await session.open(make_setup(tmp_path / "drive", suite, substitutes=("single", "stationary")))
        process = session.process
        await session.drive_to(50)
        branches = await process.what_if(1, 20, ["sharing", "single", "stationary"], 1.5)
        assert [(one.agent, one.take, one.tick) for one in branches] == [
            ("sharing", 1, 20),
            ("single", 1, 20),
            ("stationary", 1, 20),
        ]
        frame = next(frame for frame in session.frames if frame.tick == 20)
        x, y = process.facts.origin
        for one in branches:
            assert set(one.tracks) == {"0", "1"}
            assert len(one.tracks["0"]) == 31
            assert one.tracks["0"][0][:2] == pytest.approx((frame.own["0"][0] - x, frame.own["0"][1] - y), abs=2e-3)
        assert len({one.tracks["0"][-1] for one in branches}) == 3
        again = await process.what_if(1, 20, ["single"], 1.5)
        assert again[0] == branches[1]
        assert list(process.tree.takes) == [1]

    run_drive(drive)


@pytest.mark.full  # in `make test`: test_lost_drives goes back without checkpoints, test_watchdog drives on from there
def test_takes_branch_without_checkpoints_too(suite: Path, tmp_path: Path) -> None:
    folder = tmp_path / "drive"

    async def drive(session: DriveSession) -> None:
        await session.open(make_setup(folder, suite, checkpoint_s=0.0))
        await session.drive_to(40)
        await session.process.branch(1, 25)
        assert len(list_group(session.group)) == 3  # supervisor, the take that is left, the live one
        await session.drive_to(10_000)
        await session.wait_until_ended(1, 2)
        await session.close()

    run_drive(drive)
    first, second = (load_recorded(folder / "takes" / str(number)) for number in (1, 2))
    assert (first.digests[:25] == second.digests[:25]).all()


def test_the_person_takes_over_from_an_agent_and_back_and_changes_the_device(suite: Path, tmp_path: Path) -> None:
    folder = tmp_path / "drive"

    async def drive(session: DriveSession) -> None:
        process = session.process
        await session.open(make_setup(folder, suite, people=()))
        assert session.process.tree.takes[1].drivers == {"0": "sharing", "1": "sharing"}
        await session.drive_to(20)
        await process.hand_over("1", "human")
        await session.drive_to(25)
        await process.hand_over("1", "sharing")
        await session.drive_to(30)
        changes = [(event.cav, event.driver) for event in session.select(HandedOver) if event.tick > 0]
        assert changes == [("1", "human"), ("1", "sharing")]
        told = [DriverChange(one.tick, one.cav, one.driver) for one in session.select(HandedOver) if one.tick > 0]
        assert [*process.tree.takes[1].changes] == told
        assert load_tree(folder).takes[1].changes == process.tree.takes[1].changes
        for cav, driver, sentence in (
            ("9", "sharing", "CAV: expected one of 0, 1, found '9'"),
            ("1", "omniscient", "expected a driver among human, sharing"),
            ("1", "nothing", "expected a driver among human, sharing"),
        ):
            with pytest.raises(InputError, match=sentence):
                await process.hand_over(cav, driver)
        with pytest.raises(InputError, match="options that name no file"):
            await process.hand_over("1", "sharing", {"weights": "/etc/passwd"})
        with pytest.raises(InputError, match="text: expected at most 8192 bytes"):
            await process.say("1", "x" * 9000)
        for device in ("keyboard", "wheel", "wheel", "gamepad"):
            await process.hand_over("1", "human", {"device": device})
            await session.drive_to(session.tick + 3)
        await session.close()

    run_drive(drive)
    _, ticks = read_journal(folder / "takes" / "1.actions.jsonl")
    drivers = [one.cavs["1"].action.driver for one in ticks if "1" in one.cavs]
    assert [one.device for one in drivers if one is not None and one.name == "human"] == [
        "unknown",
        "keyboard",
        "wheel",
        "gamepad",
    ]
    verify(folder / "takes" / "1")


def test_a_take_that_was_left_before_its_first_tick_is_none(suite: Path, tmp_path: Path) -> None:
    """People go back several times before they drive on: that leaves no takes in which nothing was done."""
    folder = tmp_path / "drive"

    async def drive(session: DriveSession) -> None:
        process = session.process
        await session.open(make_setup(folder, suite))
        assert await process.branch(1, 0) == 2
        await session.wait_for(lambda: session.frames[-1].take == 2)
        await session.drive_to(20)
        assert await process.branch(2, 10) == 3
        assert await process.branch(3, 10) == 4
        assert await process.branch(4, 5) == 5
        await session.wait_for(lambda: session.frames[-1].take == 5)
        await session.drive_to(15)
        await session.close()

    run_drive(drive)
    tree = load_tree(folder)
    assert {number: (take.parent, take.tick) for number, take in tree.takes.items()} == {2: (None, 0), 5: (2, 5)}
    assert sorted(path.name for path in (folder / "takes").glob("*.jsonl")) == ["2.actions.jsonl", "5.actions.jsonl"]
    for number in tree.takes:
        verify(tree.find_folder(number))
