"""CheckpointLadder: the checkpoints of a drive that wait, and which of them is nearest to a tick of a take."""

from collections.abc import Iterable, Iterator
from contextlib import suppress

from server.drive.message_socket import MessageSocket

MAX_CHECKPOINTS = 64
"""Processes that wait at most: two episodes of a minute with a checkpoint every 2 s. Each keeps what its take has
changed since, 9 MB with 88 road users (decision 078)."""

Line = Iterable[tuple[int, int | None]]
"""A take and its ancestors, each with the tick up to which it is part of the take (None: no limit)."""


class CheckpointLadder:
    """Sockets of checkpoints by take and tick."""

    def __init__(self, limit: int = MAX_CHECKPOINTS) -> None:
        self._limit = limit
        self._sockets: dict[tuple[int, int], MessageSocket] = {}

    def __len__(self) -> int:
        return len(self._sockets)

    def __iter__(self) -> Iterator[MessageSocket]:
        return iter(self._sockets.values())

    def add(self, take: int, tick: int, connection: MessageSocket, line: Line) -> None:
        """Add a checkpoint. line: of the live take, whose checkpoints are dropped last."""
        self._end((take, tick))
        self._sockets[take, tick] = connection
        if len(self._sockets) > self._limit:
            self._end(self._choose_dropped(dict(line)))

    def find(self, line: Line, tick: int) -> tuple[int, int] | None:
        """Return the latest checkpoint up to a tick of the last take of a line; None: there is none.

        In tick 0 all takes are the same.
        """
        limits = dict(line)
        found = [
            (at, take)
            for take, at in self._sockets
            if at <= tick and (at == 0 or (take in limits and _is_within(at, limits[take])))
        ]
        return (max(found)[1], max(found)[0]) if found else None

    def send(self, key: tuple[int, int], message: object, descriptor: int) -> bool:
        """Send an order with its socket to a checkpoint; return whether it is still there."""
        try:
            self._sockets[key].send(message, (descriptor,))
        except OSError:
            self._end(key)
            return False
        return True

    def drop(self, key: tuple[int, int]) -> None:
        """End a checkpoint, if it is still there."""
        self._end(key)

    def drop_take(self, take: int) -> None:
        """End the checkpoints of a take that has not come about."""
        for key in [key for key in self._sockets if key[0] == take]:
            self._end(key)

    def move_take(self, take: int, parent: int | None) -> None:
        """Let the parent of a take have its checkpoints, all of which lie before the end of what they share."""
        if parent is None:
            return  # that of tick 0 is found by every take
        for key in [key for key in self._sockets if key[0] == take]:
            connection, moved = self._sockets.pop(key), (parent, key[1])
            if moved in self._sockets:
                connection.close()
            else:
                self._sockets[moved] = connection

    def clear(self) -> None:
        """End all checkpoints."""
        for key in list(self._sockets):
            self._end(key)

    def _choose_dropped(self, limits: dict[int, int | None]) -> tuple[int, int]:
        """Return what to drop: of other takes the oldest, then what leaves the smallest gap. Tick 0 stays."""
        kept = [key for key in self._sockets if key[1] > 0]
        others = [(take, at) for take, at in kept if not (take in limits and _is_within(at, limits[take]))]
        if others:
            return min(others)
        ticks = sorted(at for _, at in kept)
        gaps = {at: after - before for before, at, after in zip([0, *ticks], ticks, ticks[1:], strict=False)}
        return min(kept[:-1] or kept, key=lambda key: (gaps.get(key[1], 0), key[1]))

    def _end(self, key: tuple[int, int]) -> None:
        connection = self._sockets.pop(key, None)
        if connection is not None:
            with suppress(OSError):
                connection.close()


def _is_within(tick: int, limit: int | None) -> bool:
    return limit is None or tick <= limit
