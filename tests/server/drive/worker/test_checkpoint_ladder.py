"""The ladder of checkpoints: the nearest one of a take's line, and which one goes when there are too many."""

import socket

from server.drive.message_socket import MessageSocket
from server.drive.worker.checkpoint_ladder import CheckpointLadder


class Waiting:
    """The other ends of the checkpoints' sockets."""

    def __init__(self, ladder: CheckpointLadder) -> None:
        self._ladder = ladder
        self._theirs: dict[tuple[int, int], socket.socket] = {}

    def add(self, take: int, *ticks: int, line: list[tuple[int, int | None]] | None = None) -> None:
        for tick in ticks:
            ours, theirs = socket.socketpair()
            self._theirs[take, tick] = theirs
            self._ladder.add(take, tick, MessageSocket(ours), line or [])

    def list(self) -> list[tuple[int, int]]:
        """The checkpoints whose connection is open."""
        alive: list[tuple[int, int]] = []
        for key, theirs in self._theirs.items():
            theirs.setblocking(False)
            try:
                theirs.recv(1)
            except BlockingIOError:
                alive.append(key)
        return sorted(alive)

    def close(self) -> None:
        self._ladder.clear()
        for theirs in self._theirs.values():
            theirs.close()


def test_the_nearest_checkpoint_is_that_of_the_take_or_of_its_ancestors_up_to_the_branch() -> None:
    ladder = CheckpointLadder()
    waiting = Waiting(ladder)
    waiting.add(1, 0, 40, 80, 120)
    waiting.add(2, 80)
    waiting.add(9, 60)
    line: list[tuple[int, int | None]] = [(2, None), (1, 50)]
    assert ladder.find(line, 200) == (2, 80)
    assert ladder.find(line, 79) == (1, 40)
    assert ladder.find(line, 40) == (1, 40)
    assert ladder.find(line, 39) == (1, 0)
    assert ladder.find([(1, None)], 500) == (1, 120)
    assert ladder.find([], 500) == (1, 0), "all takes are the same in tick 0"
    waiting.close()
    assert ladder.find(line, 200) is None


def test_an_order_to_a_checkpoint_that_has_ended_drops_it() -> None:
    ladder = CheckpointLadder()
    waiting = Waiting(ladder)
    waiting.add(1, 0)
    assert ladder.send((1, 0), "order", 0)
    waiting.close()
    assert len(ladder) == 0


def test_checkpoints_of_other_takes_go_first_then_the_smallest_gap_and_tick_0_stays() -> None:
    ladder = CheckpointLadder(limit=5)
    waiting = Waiting(ladder)
    line: list[tuple[int, int | None]] = [(2, None), (1, 60)]
    waiting.add(1, 0, 40, 80, 120, line=line)
    waiting.add(2, 80, line=line)
    waiting.add(2, 120, line=line)
    assert waiting.list() == [(1, 0), (1, 40), (1, 120), (2, 80), (2, 120)]
    waiting.add(2, 160, line=line)
    assert waiting.list() == [(1, 0), (1, 40), (2, 80), (2, 120), (2, 160)]
    waiting.add(2, 200, line=line)
    assert (1, 0) in waiting.list()
    assert (2, 200) in waiting.list()
    assert len(ladder) == 5
    waiting.close()


def test_a_take_that_has_not_come_about_leaves_nothing() -> None:
    ladder = CheckpointLadder()
    waiting = Waiting(ladder)
    waiting.add(1, 0, 40)
    waiting.add(2, 0, 80)
    ladder.drop_take(2)
    assert waiting.list() == [(1, 0), (1, 40)]
    waiting.close()


def test_the_checkpoints_of_a_dropped_take_are_those_of_its_parent() -> None:
    ladder = CheckpointLadder()
    waiting = Waiting(ladder)
    waiting.add(1, 0, 40)
    waiting.add(2, 40, 80)
    ladder.move_take(2, 1)
    assert waiting.list() == [(1, 0), (1, 40), (2, 80)]
    assert ladder.find([(1, None)], 99) == (1, 80)
    ladder.move_take(1, None)
    assert ladder.find([], 99) == (1, 0)
    waiting.close()
