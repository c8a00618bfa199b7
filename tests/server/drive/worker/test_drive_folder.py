"""The folder of a drive that is opened again: what was left is found from the tree and the journals."""

from pathlib import Path

import pytest

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.runs.takes import Action, DriverChoice
from server.drive.take_tree import DriverChange, Take, TakeStatus, TakeTree
from server.drive.worker.drive_folder import check_tick, find_unfinished
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


def test_a_take_goes_on_from_ticks_up_to_the_one_in_which_it_was_left(tmp_path: Path) -> None:
    takes = [Take(number, None, 0, {"a": "human"}, status=status) for number, status in enumerate(TakeStatus, 1)]
    tree = make_tree(tmp_path, *takes)
    say = TickActions({"a": CavAction(Action(None, None, ('"left":["a"]',)))})
    for take in takes:
        write_journal(tree, take, drive("a", "human"), say, TickActions(left=("a",)), TickActions(), TickActions())
        for tick in (0, 1, 2):
            check_tick(tree, take.number, tick)
        for tick in (3, 4):
            with pytest.raises(InputError, match=f"up to 2, in which its driver left it, found {tick}; nobody"):
                check_tick(tree, take.number, tick)
        for tick in (-1, 6, 1.0, None, True):
            with pytest.raises(InputError, match=f"tick: expected one of take {take.number}, 0 to [45], found"):
                check_tick(tree, take.number, tick)


def test_a_drive_that_is_opened_again_goes_on_where_the_person_left_it(tmp_path: Path) -> None:
    """Not where the background work stood when the server was killed: there the person's car stands."""
    take = Take(1, None, 0, {"a": "human"}, status=TakeStatus.LEFT)
    tree = make_tree(tmp_path, take)
    write_journal(tree, take, drive("a", "human"), TickActions(left=("a",)), TickActions(), TickActions())
    assert find_unfinished(tree).go_on == (1, 1)
