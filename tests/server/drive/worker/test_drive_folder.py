"""The folder of a drive that is opened again: what was left is found from the tree and the journals."""

from pathlib import Path

import pytest

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.runs.takes import Action, DriverChoice
from server.drive.take_tree import DriverChange, Take, TakeStatus, TakeTree, load_tree
from server.drive.worker.drive_folder import check_tick, find_next_number, find_unfinished
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
            with pytest.raises(InputError, match=f"up to 2, in which its driver left it, found {tick}; it stood"):
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


NOTHING = TickActions()


@pytest.mark.parametrize(
    ("child", "header", "ticks", "sentence"),
    [
        (Take(2, 1, 9), (2, 1, 9), 5, "expected at least 9 ticks, as tree.json says, found 5"),
        (Take(2, 1, 2), (2, 1, 3), 5, "parent 1, tick 2 as in tree.json, found take 2, parent 1, tick 3"),
        (Take(2, 1, 2), (7, 1, 2), 5, "expected take 2, parent 1, tick 2 as in tree.json, found take 7"),
        (Take(2, 1, 2), (2, None, 2), 5, "found take 2, parent None, tick 2"),
        (Take(2, 1, 4), (2, 1, 4), 4, "expected a parent with its 4 ticks, found 3 in take 1"),
    ],
)
def test_a_tree_that_does_not_fit_a_journal_loses_nothing(
    tmp_path: Path, child: Take, header: tuple[int, int | None, int], ticks: int, sentence: str
) -> None:
    parent = Take(1, None, 0, {"a": "human"}, status=TakeStatus.FINISHED)
    tree = make_tree(tmp_path, parent, child)
    write_journal(tree, parent, drive("a", "human"), NOTHING, NOTHING)
    TakeJournal.create(tree.find_journal(2), JournalHeader(*header), [NOTHING] * ticks).close()
    before = tree.find_journal(2).read_bytes()
    found = find_unfinished(tree)
    (problem,) = found.problems
    assert sentence in problem and problem.startswith("take 2 cannot be finished: ")
    assert found.tree.find(2).status is TakeStatus.VOID
    assert tree.find_journal(2).read_bytes() == before
    found.tree.save()
    assert load_tree(tmp_path).find(2).status is TakeStatus.VOID


def test_a_take_without_ticks_from_which_others_branch_is_kept(tmp_path: Path) -> None:
    """Else the tree would have a take without its parent, and could not be read any more."""
    takes = Take(1, None, 0, {"a": "human"}, status=TakeStatus.FINISHED), Take(2, 1, 1), Take(3, 2, 1)
    tree = make_tree(tmp_path, *takes)
    for take, ticks in zip(takes, ([NOTHING] * 3, [NOTHING], [NOTHING] * 3), strict=True):
        write_journal(tree, take, *ticks)
    found = find_unfinished(tree)
    assert (found.tree.find(2).status, found.tree.find(3).status) == (TakeStatus.VOID, TakeStatus.LEFT)
    found.tree.save()
    assert load_tree(tmp_path).find(3).parent == 2


def test_a_take_that_was_not_driven_is_dropped(tmp_path: Path) -> None:
    takes = Take(1, None, 0, {"a": "human"}, status=TakeStatus.FINISHED), Take(2, 1, 2)
    tree = make_tree(tmp_path, *takes)
    for take, ticks in zip(takes, ([NOTHING] * 3, [NOTHING] * 2), strict=True):
        write_journal(tree, take, *ticks)
    found = find_unfinished(tree)
    assert ([*found.tree.takes], found.problems, found.go_on) == ([1], [], (1, 2))
    assert not tree.find_journal(2).exists()


def test_a_new_take_writes_over_no_file(tmp_path: Path) -> None:
    tree = make_tree(tmp_path, Take(1))
    assert find_next_number(tree) == 2
    tree.find_journal(4).write_text("not a journal")
    (tmp_path / "takes" / "6").mkdir()
    (tmp_path / "takes" / f"{2**40}.actions.jsonl").write_text("")
    assert find_next_number(tree) == 7
