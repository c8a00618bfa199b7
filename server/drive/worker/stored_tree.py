"""StoredTree: the tree of takes of a drive that goes on: what happens to takes is written, and the server is told."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from mdrive_sumo.runs.takes import HUMAN
from server.drive.simulation_values import DriveProblem, HandedOver, TreeChanged
from server.drive.take_tree import DriverChange, Take, TakeStatus, TakeTree
from server.drive.worker.drive_folder import drop_journal
from server.drive.worker.orders import TakeFinished


class StoredTree:
    """The tree of takes in its folder. The server is told of every change."""

    def __init__(self, tree: TakeTree, tell: Callable[[object], None]) -> None:
        self.tree, self._tell = tree, tell
        self.is_unsaved = False
        """Whether the last change could not be written."""

    def add(self, take: Take) -> None:
        """Add a take, and write the tree."""
        self.tree = self.tree.with_take(take)
        self.save()

    def drop(self, take: int) -> None:
        """Forget a take that was not driven, and write the tree."""
        drop_journal(self.tree, take)
        self.tree = self.tree.without_take(take)
        self.save()

    def change(self, take: int, **values: Any) -> None:
        """Change values of a take, and write the tree."""
        self.add(replace(self.tree.find(take), **values))

    def save(self) -> None:
        """Write the tree. A full disk is told once; then call it again."""
        try:
            self.tree.save()
            self.is_unsaved = False
        except OSError as error:
            if not self.is_unsaved:
                text = f"{self.tree.folder}: cannot be written: {error.strerror}; make room, it is tried again"
                self._tell(DriveProblem(text))
            self.is_unsaved = True
        self._tell(TreeChanged(self.tree))

    def note_driver(self, message: HandedOver) -> None:
        """Note that a CAV of a take has another driver; nothing is written if it has the same one."""
        take = self.tree.find(message.take)
        changed = take.with_changes((*take.changes, DriverChange(message.tick, message.cav, message.driver)))
        if changed != take:
            self.add(changed)

    def note_left(self, number: int, tick: int) -> None:
        """Note that the people leave a take. tick: of its last frame; `note_finished` corrects it."""
        take = self.tree.find(number)
        self.change(number, status=TakeStatus.LEFT, left_tick=tick if HUMAN in take.last_drivers.values() else None)

    def note_finished(self, message: TakeFinished) -> None:
        """Note the end and the scores of a take."""
        take = self.tree.find(message.take).with_changes(message.changes)
        self.add(
            replace(
                take,
                status=TakeStatus.FINISHED,
                end_tick=message.end_tick,
                left_tick=message.left_tick,
                score=message.score,
                ds=dict(message.ds),
                losses=dict(message.losses),
            )
        )
