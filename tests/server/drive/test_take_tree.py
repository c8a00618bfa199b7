"""The tree of takes: saved and loaded, its lines of ancestors, and files that are none."""

import json
from pathlib import Path
from typing import Any

import pytest

from mdrive_sumo.core.errors import InputError
from server.drive.take_tree import TREE_FILE, TREE_FORMAT, DriverChange, Take, TakeStatus, TakeTree, load_tree

TAKES = (
    Take(1, None, 0, {"a": "human"}, (), TakeStatus.FINISHED, 30, 40, 55.5, {"a": 55.5}),
    Take(2, 1, 20, {"a": "human"}, (DriverChange(22, "a", "sharing"),), TakeStatus.LEFT, 0),
    Take(3, 2, 25, {"a": "sharing"}),
)


def make_tree(folder: Path) -> TakeTree:
    return TakeTree(folder, {"scenario": "s", "seed": 0}, {take.number: take for take in TAKES})


def test_a_tree_is_read_back(tmp_path: Path) -> None:
    tree = make_tree(tmp_path / "drive")
    tree.save()
    assert load_tree(tmp_path / "drive") == tree
    assert tree.next_number == 4
    assert TakeTree(tmp_path, {}).next_number == 1


def test_the_line_of_a_take_says_how_much_of_each_ancestor_is_part_of_it(tmp_path: Path) -> None:
    tree = make_tree(tmp_path)
    assert list(tree.list_line(3)) == [(3, None), (2, 25), (1, 20)]
    early = tree.with_take(Take(4, 3, 10))  # before its parent's own begin
    assert list(early.list_line(4)) == [(4, None), (3, 10), (2, 10), (1, 10)]


def test_only_own_changes_of_drivers_that_change_something_are_kept() -> None:
    rows = [(0, "sharing"), (19, "human"), (20, "human"), (25, "sharing"), (26, "sharing"), (30, "human")]
    take = TAKES[1].with_changes(DriverChange(tick, "a", driver) for tick, driver in rows)
    assert take.changes == (DriverChange(25, "a", "sharing"), DriverChange(30, "a", "human"))


def test_an_unknown_take_costs_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"take: expected one of this drive \(1 to 3\), found 9"):
        make_tree(tmp_path).find(9)
    with pytest.raises(InputError, match="none yet"):
        TakeTree(tmp_path, {}).find(1)


def change(**values: Any) -> dict[str, Any]:
    """A tree with one take, of which values are changed."""
    take = {"number": 1, "parent": None, "tick": 0, "drivers": {}, "status": "running"}
    return {"format": TREE_FORMAT, "about": {}, "takes": [{**take, **values}]}


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        ("", "expected JSON"),
        ("[" * 100_000, "expected JSON"),
        ([], "expected the takes of a drive"),
        ({"format": "other"}, "expected the takes of a drive"),
        ({"format": TREE_FORMAT, "about": {}, "takes": {}}, "expected an object `about` and a list `takes`"),
        (change(number=0), "expected numbers from 1 on"),
        (change(number="1"), "number: expected a whole number"),
        (change(number=True), "number: expected a whole number"),
        (change(tick=-1), "tick: expected a whole number"),
        (change(tick=None), "tick: expected a whole number"),
        (change(parent=1), "parent: expected an earlier take, found 1"),
        (change(parent=7), "parent: expected an earlier take, found 7"),
        (change(status="asleep"), "status: expected running, left, finished, void"),
        (change(status=["running"]), "status: expected running"),
        (change(drivers=["a"]), "drivers: expected an object of CAVs"),
        (change(drivers={"a": 1}), "drivers: expected an object of CAVs"),
        (change(ds={"a": "x"}), "ds: expected an object of CAVs"),
        (change(number=2**30 + 1), "expected numbers from 1 on"),
        (change(drivers={"a": "\ud800"}), "drivers: expected an object of CAVs"),
        (change(drivers={"\udfff": "human"}), "drivers: expected an object of CAVs"),
        (change(losses={"a": 1}), "losses: expected an object of CAVs"),
        (change(losses={"a": "x" * 201}), "losses: expected an object of CAVs"),
        (change(ds={"a": float("nan")}), "ds: expected an object of CAVs"),
        (change(ds={"a": 1e300}), "ds: expected an object of CAVs"),
        (change(score=101), "score: expected a number from 0 to 100"),
        (change(score=float("nan")), "score: expected a number from 0 to 100"),
        (change(end_tick=1.5), "end_tick: expected a whole number"),
        (change(changes={"tick": 1}), "changes: expected a list of changes of drivers"),
        (change(changes=[{"tick": 1, "cav": "a"}]), "changes: expected objects with tick, cav and driver"),
        (change(changes=[{"tick": 1, "cav": "a", "driver": 7}]), "changes: expected objects with tick, cav and driver"),
        (change(changes=[{"tick": 1.5, "cav": "a", "driver": "x"}]), "changes: tick: expected a whole number"),
        (change(more=1), "takes: expected objects with"),
    ],
)
def test_a_file_that_is_no_tree_costs_one_sentence(tmp_path: Path, content: object, sentence: str) -> None:
    (tmp_path / TREE_FILE).write_text(content if isinstance(content, str) else json.dumps(content))
    with pytest.raises(InputError) as caught:
        load_tree(tmp_path)
    assert sentence in str(caught.value)
    assert "\n" not in str(caught.value)
