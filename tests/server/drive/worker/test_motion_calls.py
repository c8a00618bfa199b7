"""Motions of finished takes: built once, and those of the newest takes before a page asks for them."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

import pytest

from mdrive_sumo.core.errors import InputError
from server.drive.message_socket import MessageSocket
from server.drive.take_tree import Take, TakeStatus, TakeTree
from server.drive.worker import motion_calls
from server.drive.worker.child import Child, ChildProcesses, ChildRole
from server.drive.worker.motion_calls import AHEAD_TAKES, MotionCalls
from server.drive.worker.open_drive import OpenDrive
from server.drive.worker.orders import MotionLoaded


class Helpers:
    """Processes that are none."""

    def __init__(self) -> None:
        self.children: list[Child] = []

    def __iter__(self) -> Iterator[Child]:
        return iter(self.children)

    def start_helper(self, run: Callable[[MessageSocket], None], take: int) -> Child:
        self.children.append(Child(cast(MessageSocket, None), ChildRole.HELPING, motion_of=take))
        return self.children[-1]


@dataclass
class Calls:
    helpers: Helpers = field(default_factory=Helpers)
    answers: list[tuple[int, bytes]] = field(default_factory=list[tuple[int, bytes]])

    def __post_init__(self) -> None:
        children = cast(ChildProcesses, self.helpers)
        self.calls = MotionCalls(children, lambda number, motion: self.answers.append((number, motion)))

    def end(self, motion: bytes) -> None:
        """Let the oldest helper send its motion and end."""
        child = self.helpers.children.pop(0)
        self.calls.hear(child, MotionLoaded(child.motion_of, motion))


@dataclass
class Drive:
    tree: TakeTree
    context: Any = None


@pytest.fixture
def drive(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> OpenDrive:
    """Six takes, of which the last one goes on, and the second has lost its recording."""

    def make_sender(context: object, folder: Path, take: int) -> Callable[[MessageSocket], None]:
        if take == 2:
            raise InputError("take 2: expected the recording of a finished take, found none")
        return lambda connection: None

    monkeypatch.setattr(motion_calls, "make_motion_sender", make_sender)
    takes = {number: Take(number, status=TakeStatus.FINISHED) for number in range(1, 9)} | {9: Take(9)}
    return cast(OpenDrive, Drive(TakeTree(tmp_path, {}, takes)))


def test_a_motion_is_built_once_for_all_who_ask(drive: OpenDrive) -> None:
    bench = Calls()
    bench.calls.ask(1, 3, drive)
    bench.calls.ask(2, 3, drive)
    bench.calls.ask(3, 4, drive)
    assert [child.motion_of for child in bench.helpers] == [3, 4]
    assert bench.answers == []
    bench.end(b"three")
    bench.calls.ask(4, 3, drive)
    assert bench.answers == [(1, b"three"), (2, b"three"), (4, b"three")]
    with pytest.raises(InputError, match="expected the recording"):
        bench.calls.ask(5, 2, drive)


def test_the_newest_takes_are_loaded_ahead(drive: OpenDrive) -> None:
    bench, built = Calls(), list[int]()
    bench.calls.keep(7, b"seven")  # finished just now
    while True:
        bench.calls.load_ahead(drive)
        if not bench.helpers.children:
            break
        built.append(bench.helpers.children[0].motion_of)
        bench.end(b"motion")
    assert built == [8, 6, 5]
    assert len(built) == AHEAD_TAKES - 1
    bench.calls.ask(1, 6, drive)
    assert bench.answers == [(1, b"motion")]


def test_who_asks_for_what_is_loaded_ahead_waits_for_that(drive: OpenDrive) -> None:
    bench = Calls()
    bench.calls.load_ahead(drive)
    bench.calls.ask(1, 8, drive)
    assert len(bench.helpers.children) == 1
    bench.end(b"eight")
    assert bench.answers == [(1, b"eight")]
