"""OpenDrive: a drive that is open: what is driven, its takes on disk, and with what people drive."""

from collections.abc import Callable
from dataclasses import replace

from server.drive.simulation_values import DriveSetup
from server.drive.take_tree import TakeTree
from server.drive.worker.drive_context import load_context
from server.drive.worker.drive_folder import (
    find_driven,
    find_next_number,
    find_unfinished,
    open_tree,
    restore_setup,
)
from server.drive.worker.orders import Provenance, TakeMode, TakeOrder, make_order
from server.drive.worker.stored_tree import StoredTree


class OpenDrive:
    """The folder of a drive, locked, and what all its takes have in common."""

    def __init__(self, setup: DriveSetup, tell: Callable[[object], None]) -> None:
        """tell: sends an event to the server. Raises InputError for whatever the user has to mend."""
        self.context = load_context(restore_setup(setup))
        self.provenance = Provenance(setup.device, 0.0)
        self.unfinished = find_unfinished(open_tree(self.context.setup, self.context.describe()))
        """What an earlier session has left."""
        self.stored = StoredTree(self.unfinished.tree, tell)
        self._last_take = 0

    @property
    def tree(self) -> TakeTree:
        """The takes."""
        return self.stored.tree

    @property
    def first_tick(self) -> int:
        """The tick in which people begin: 0, or that of the run that is entered."""
        return self.context.setup.from_tick if self.context.record is not None else 0

    def repeat_recording(self) -> bool:
        """Let the agents of the entered run be replaced by their recorded replies; return whether they were not yet."""
        had_agents = bool(self.context.agents)
        self.context = replace(self.context, agents={})
        return had_agents

    def make_order(self, take: int, parent: int | None, tick: int, mode: TakeMode) -> TakeOrder:
        """Return an order, see `orders.make_order`. Raises InputError for a journal that cannot be read."""
        return make_order(self.tree, (take, parent, tick), mode, self.provenance)

    def order_new_take(self, parent: int | None, tick: int) -> TakeOrder:
        """Return the order to begin a new take. parent: the take that it branches from. Raises InputError.

        A take without a tick of its own is no parent: its process may already be dropping it.
        """
        take = self._last_take = max(self._last_take + 1, find_next_number(self.tree))
        if parent is not None:
            parent = find_driven(self.tree, parent, tick)
        order = self.make_order(take, parent, tick, TakeMode.DRIVE)
        is_run_entered = self.context.record is not None
        if is_run_entered and parent is None:
            order = replace(order, header=replace(order.header, entered_tick=tick))
        return replace(order, people_take_over=is_run_entered and tick <= order.header.entered_tick)
