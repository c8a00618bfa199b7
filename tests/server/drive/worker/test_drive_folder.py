"""The folder of a drive that is opened again: what was left is found from the tree and the journals."""

from pathlib import Path

from mdrive_sumo.runs.takes import Action, DriverChoice
from server.drive.take_tree import DriverChange, Take, TakeStatus, TakeTree
from server.drive.worker.drive_folder import find_unfinished
from server.drive.worker.take_journal import CavAction, JournalHeader, TakeJournal, TickActions


def drive(cav: str, driver: str) -> TickActions:
    """A tick in which a CAV gets a driver."""
    return TickActions({cav: CavAction(Action(DriverChoice(driver)))})


def make_tree(folder: Path, *takes: Take) -> TakeTree:
    tree = TakeTree(folder, {}, {take.number: take for take in takes})
    tree.save()
    return tree


def write_journal(tree: TakeTree, take: Take, *ticks: TickActions) -> None:
    header = JournalHeader(take.number, take.parent, take.tick)
    TakeJournal.create(tree.find_journal(take.number), header, ticks).close()


def test_who_drove_in_a_take_of_a_killed_drive_is_read_from_its_journal(tmp_path: Path) -> None:
    nothing = TickActions()
    parent, child = Take(1, None, 0, {"a": "human"}, status=TakeStatus.FINISHED), Take(2, 1, 2)
    tree = make_tree(tmp_path, parent, child)
    write_journal(tree, child, drive("a", "human"), nothing, nothing, drive("a", "sharing"), drive("a", "human"))
    found = find_unfinished(tree)
    take = found.tree.find(2)
    assert (take.drivers, take.status) == ({"a": "human"}, TakeStatus.LEFT)
    assert take.changes == (DriverChange(3, "a", "sharing"), DriverChange(4, "a", "human"))
