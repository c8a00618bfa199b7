"""WaitingTakes: takes that were left, and wait for their turn to be finished in the background."""

from collections import Counter
from collections.abc import Callable, Iterable

from mdrive_sumo.core.errors import InputError
from server.drive.message_socket import MessageSocket
from server.drive.simulation_values import DriveProblem
from server.drive.take_tree import TakeStatus
from server.drive.worker.child import Child, ChildProcesses, ChildRole
from server.drive.worker.drive_folder import check_driven
from server.drive.worker.orders import FinishOrder, Provenance, TakeOrder
from server.drive.worker.stored_tree import StoredTree
from server.drive.worker.take_journal import summarize_journal

MAX_LEFT = 32
"""Processes of takes that wait for their turn to be finished: 8 MB each. Of more, the oldest end, and their takes are
finished from their journals, which takes longer."""
MAX_LOST = 3
"""Processes of a take that may end before their time: what ends them again and again will not stop doing so."""


class WaitingTakes:
    """Those whose process waits, and those without one, which are finished from their journals."""

    def __init__(
        self,
        children: ChildProcesses,
        slots: int,
        make_order: Callable[[int, int], TakeOrder],
        start: Callable[[TakeOrder], Child],
    ) -> None:
        """slots: processes that work in the background at a time.

        make_order: returns the order to finish a take whose journal has so many ticks; raises InputError if that cannot
        be read. start: starts the process that follows it.
        """
        self._children, self._slots, self._make_order, self._start = children, slots, make_order, start
        self._earlier: list[tuple[int, Provenance | None]] = []
        """Takes without a process, and with what people drove them; None: in an earlier session."""
        self._lost = Counter[int]()
        """How often the process of a take has ended before its time; another one finishes it."""

    def add(self, takes: Iterable[int], provenance: Provenance | None = None) -> None:
        """Let takes without a process wait. provenance: with what people drove them; None: in an earlier session."""
        self._earlier += [(take, provenance) for take in takes]

    def add_lost(self, take: int, provenance: Provenance) -> None:
        """Let a take wait whose process has ended before its time, unless that happens again and again."""
        self._lost[take] += 1
        if self._lost[take] <= MAX_LOST:
            self.add((take,), provenance)

    def give_turns(self, stored: StoredTree, server: MessageSocket, *, is_starting: bool) -> bool:
        """Let takes be finished, as many at a time as there are slots; return whether none is left.

        What people wait for goes first: what-if branches. is_starting: whether a take begins.
        """
        busy = self._children.count(ChildRole.FINISHING, ChildRole.HELPING)
        for child in [one for one in self._children if one.role is ChildRole.LEFT][: max(0, self._slots - busy)]:
            child.role = ChildRole.FINISHING
            busy += 1
            child.tell(FinishOrder())
        while self._earlier and busy < self._slots and not is_starting:
            busy += self._finish_earlier(stored, server, *self._earlier.pop(0))
        left = [one for one in self._children if one.role is ChildRole.LEFT]
        for child in left[: max(0, len(left) - MAX_LEFT)]:
            child.role = ChildRole.ASIDE
            child.connection.end()
        waiting = (ChildRole.LEFT, ChildRole.ASIDE, ChildRole.FINISHING)
        return not self._earlier and not self._children.count(*waiting)

    def _finish_earlier(
        self, stored: StoredTree, server: MessageSocket, take: int, provenance: Provenance | None
    ) -> bool:
        """Start the process that finishes a take from its journal; return whether that can be read."""
        try:
            header, count = summarize_journal(stored.tree.find_journal(take))
            known = stored.tree.find(take)
            is_driven = check_driven(stored.tree, known, header, count)
            if known.parent is not None and not is_driven:
                self._children.ladder.move_take(take, known.parent)
                stored.drop(take)
                return False
            order = self._make_order(take, count)
        except InputError as error:
            stored.change(take, status=TakeStatus.VOID)
            server.send(DriveProblem(f"take {take} cannot be finished: {error}"))
            return False
        child = self._start(order)
        if provenance is not None:
            child.tell(provenance)
        return True
