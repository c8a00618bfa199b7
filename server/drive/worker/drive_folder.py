"""The folder of a drive when it is opened: a new one, or that of an earlier drive, also of one that was killed."""

import fcntl
import os
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from mdrive_sumo.core.atomic_folder import check_new_folder
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.input_files import check_tree
from mdrive_sumo.core.output_files import make_folder, remove_parts
from mdrive_sumo.core.private_paths import relate_path, restore_path
from server.drive.simulation_values import DriveSetup
from server.drive.take_tree import MAX_TAKE, TAKES_FOLDER, TREE_FILE, Take, TakeStatus, TakeTree, has_tree, load_tree
from server.drive.worker.take_journal import (
    JournalHeader,
    find_drivers,
    find_left_tick,
    list_driver_changes,
    read_journal,
    summarize_journal,
)

FROM_RUN = "from_run"
"""Name in `tree.json` of the run that the drive enters, relative to the folder."""
LOCK_WAIT_S = 10.0
"""How long the processes of a killed drive may take to end [s]: they notice it between two ticks."""
LOCK_PAUSE_S = 0.1
"""Between two tries to lock the folder [s]; chosen: a person does not notice it."""


def restore_setup(setup: DriveSetup) -> DriveSetup:
    """Return the setup of a continued drive with the run that it entered, unless it names one. Raises InputError."""
    if setup.from_run is not None or not has_tree(setup.folder):
        return setup
    about = load_tree(setup.folder).about
    if not isinstance(about.get(FROM_RUN), str):
        return setup
    tick = about.get("from_tick")
    if type(tick) is not int:
        raise InputError(f"{setup.folder}: expected the tick of the run that the drive entered, found {tick!r:.40}")
    return replace(setup, from_run=restore_path(about[FROM_RUN], setup.folder), from_tick=tick)


def open_tree(setup: DriveSetup, about: Mapping[str, Any]) -> TakeTree:
    """Return the tree of a drive's folder; a new folder gets an empty one.

    about: what is driven. Raises InputError for a folder of another drive, one in which another process drives, one
    with links, or one that cannot be written.
    """
    if setup.from_run is not None:
        about = {**about, FROM_RUN: relate_path(setup.from_run, setup.folder)}
    if not has_tree(setup.folder):
        check_new_folder(setup.folder)
        _make_folder(setup.folder)
    lock_folder(setup.folder)
    if has_tree(setup.folder):
        check_tree(setup.folder, "a drive")  # what is written below it stays there
        tree = load_tree(setup.folder)
        _check_about(tree, about)
        return _adopt_takes(tree)
    tree = TakeTree(setup.folder, about)
    try:
        tree.save()
    except OSError as error:
        raise InputError(f"{setup.folder}: cannot be written: {error.strerror}") from None
    return tree


def _make_folder(folder: Path) -> None:
    try:
        make_folder(folder, may_be_link=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be written: {error.strerror}") from None


def lock_folder(folder: Path, wait_s: float = LOCK_WAIT_S) -> None:
    """Keep other drives out of a folder until this process and all that it forks have ended. Raises InputError.

    Two drives in one folder would give different takes the same number, and overwrite one by the other.
    """
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)  # never closed: it holds the lock
    end_s = time.monotonic() + wait_s
    while True:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            if time.monotonic() > end_s:
                os.close(descriptor)
                raise InputError(
                    f"{folder}: expected a drive that goes on nowhere else, found another server at work in it; stop"
                    " that one first"
                ) from None
            time.sleep(LOCK_PAUSE_S)
        except OSError:  # a network file system that cannot lock folders
            os.close(descriptor)
            return
        else:
            return


def _check_about(tree: TakeTree, about: Mapping[str, Any]) -> None:
    for name, value in about.items():
        if tree.about.get(name) != value and name != FROM_RUN:
            raise InputError(
                f"{tree.folder}: expected a drive with {name} {value!r:.60}, found one with"
                f" {tree.about.get(name)!r:.60}; choose another folder, or continue with the same settings"
            )


def find_next_number(tree: TakeTree) -> int:
    """Return a number that neither a take nor a file of the folder has: what cannot be read is not written over."""
    names = [path.name.split(".")[0] for path in (tree.folder / TAKES_FOLDER).glob("*")]
    numbers = [int(name) for name in names if name.isdecimal() and int(name) <= MAX_TAKE]
    return max([tree.next_number - 1, *numbers]) + 1


def _adopt_takes(tree: TakeTree) -> TakeTree:
    """Return the tree with takes whose journal was written just before the server was killed."""
    folder = tree.folder / TAKES_FOLDER
    if folder.is_dir():
        remove_parts(folder)
    numbers = sorted(
        int(path.name.split(".")[0]) for path in folder.glob("*.actions.jsonl") if path.name.split(".")[0].isdecimal()
    )
    for number in [number for number in numbers if 1 <= number <= MAX_TAKE and number not in tree.takes]:
        try:
            header, _ = summarize_journal(tree.find_journal(number))
        except InputError:
            continue  # not a journal: `find_next_number` leaves it alone
        if header.parent is None or header.parent in tree.takes:
            tree = tree.with_take(Take(number, header.parent, header.tick))
    return tree


class Unfinished(NamedTuple):
    """What an earlier session has left."""

    tree: TakeTree
    takes: list[int]
    """The takes to finish."""
    go_on: tuple[int, int] | None
    """The take and the tick from which the drive goes on; None: from the start."""
    problems: list[str]


def find_unfinished(tree: TakeTree) -> Unfinished:
    """Return the takes that an earlier session has not finished, and the tree without those that were not driven.

    A take whose journal cannot be read is marked as void, with a sentence.
    """
    found = Unfinished(tree, [], None, [])
    for number, take in sorted(tree.takes.items()):
        if take.status not in (TakeStatus.RUNNING, TakeStatus.LEFT):
            continue
        try:
            header, ticks = read_journal(tree.find_journal(number))
            is_driven = check_driven(tree, take, header, len(ticks))
        except InputError as error:
            found.problems.append(f"take {number} cannot be finished: {error}")
            found = found._replace(tree=found.tree.with_take(replace(take, status=TakeStatus.VOID)))
            continue
        if is_driven:
            found.takes.append(number)
            left = replace(take, status=TakeStatus.LEFT, drivers=take.drivers or find_drivers(ticks, take.tick))
            left = left.with_changes(list_driver_changes(ticks))
            last = next((tick for tick, one in enumerate(ticks) if one.left), len(ticks))
            found = found._replace(tree=found.tree.with_take(left), go_on=(number, last))
        else:
            drop_journal(tree, number)
            before = None if take.parent is None else (take.parent, take.tick)
            found = found._replace(tree=found.tree.without_take(number), go_on=before)
    return found


def check_driven(tree: TakeTree, take: Take, header: JournalHeader, count: int) -> bool:
    """Return whether a take has a tick of its own; one without may be dropped, because its parent holds all of it.

    count: ticks of its journal. Raises InputError if the tree and the journals do not fit each other: then nothing may
    be removed.
    """
    path = tree.find_journal(take.number)
    if (header.take, header.parent, header.tick) != (take.number, take.parent, take.tick):
        expected = f"take {take.number}, parent {take.parent}, tick {take.tick}"
        found = f"take {header.take}, parent {header.parent}, tick {header.tick}"
        raise InputError(f"{path}: expected {expected} as in {TREE_FILE}, found {found}")
    if count < take.tick:
        raise InputError(f"{path}: expected at least {take.tick} ticks, as {TREE_FILE} says, found {count}")
    if count > take.tick:
        return True
    children = [other.number for other in tree.takes.values() if other.parent == take.number]
    if children:
        raise InputError(f"{path}: expected the ticks in which take {children[0]} begins, found none of its own")
    if take.parent is not None:
        _, held = summarize_journal(tree.find_journal(take.parent))
        if held < count:
            raise InputError(f"{path}: expected a parent with its {count} ticks, found {held} in take {take.parent}")
    return False


def drop_journal(tree: TakeTree, number: int) -> None:
    """Remove the journal of a take that was not driven, if that is possible: it holds what that of its parent does."""
    with suppress(OSError):
        tree.find_journal(number).unlink()


def check_tick(tree: TakeTree, take: int, tick: object) -> None:
    """Raise InputError unless a take can go on from a tick: one before its end.

    After the tick in which its people left, their CAVs stand until the end: there is no way to drive on.
    """
    is_finished, path = tree.find(take).status is TakeStatus.FINISHED, tree.find_journal(take)
    left, last = find_left_tick(path), summarize_journal(path)[1] - is_finished
    if type(tick) is int and left is not None and left < tick <= last:
        raise InputError(
            f"tick: expected one of take {take} up to {left}, in which its driver left it, found {tick}; it stood"
            " after that"
        )
    if type(tick) is not int or not 0 <= tick <= last:
        raise InputError(f"tick: expected one of take {take}, 0 to {last}, found {tick!r:.40}")


def find_driven(tree: TakeTree, number: int, tick: int) -> int | None:
    """Return a take, or its parent if it has no tick of its own yet: it is the same then, and is dropped."""
    take = tree.find(number)
    is_driven = tick > take.tick or summarize_journal(tree.find_journal(number))[1] > take.tick
    return number if is_driven else take.parent
