"""The folder of a drive when it is opened: a new one, or that of an earlier drive, also of one that was killed."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from mdrive_sumo.core.atomic_folder import check_new_folder
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.output_files import make_folder, remove_parts
from mdrive_sumo.core.private_paths import relate_path, restore_path
from server.drive.simulation_values import DriveProblem, DriveSetup, TreeChanged
from server.drive.take_tree import TAKES_FOLDER, Take, TakeStatus, TakeTree, has_tree, load_tree
from server.drive.worker.take_journal import read_journal

FROM_RUN = "from_run"
"""Name in `tree.json` of the run that the drive enters, relative to the folder."""


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

    about: what is driven. Raises InputError for a folder of another drive, or one that cannot be written.
    """
    if setup.from_run is not None:
        about = {**about, FROM_RUN: relate_path(setup.from_run, setup.folder)}
    if has_tree(setup.folder):
        tree = load_tree(setup.folder)
        _check_about(tree, about)
        return _adopt_takes(tree)
    check_new_folder(setup.folder)
    tree = TakeTree(setup.folder, about)
    try:
        make_folder(setup.folder, may_be_link=True)
        tree.save()
    except OSError as error:
        raise InputError(f"{setup.folder}: cannot be written: {error.strerror}") from None
    return tree


def _check_about(tree: TakeTree, about: Mapping[str, Any]) -> None:
    for name, value in about.items():
        if tree.about.get(name) != value and name != FROM_RUN:
            raise InputError(
                f"{tree.folder}: expected a drive with {name} {value!r:.60}, found one with"
                f" {tree.about.get(name)!r:.60}; choose another folder, or continue with the same settings"
            )


def _adopt_takes(tree: TakeTree) -> TakeTree:
    """Return the tree with takes whose journal was written just before the server was killed."""
    folder = tree.folder / TAKES_FOLDER
    if folder.is_dir():
        remove_parts(folder)
    numbers = sorted(
        int(path.name.split(".")[0]) for path in folder.glob("*.actions.jsonl") if path.name.split(".")[0].isdecimal()
    )
    for number in [number for number in numbers if number not in tree.takes]:
        try:
            header, _ = read_journal(tree.find_journal(number))
        except InputError:
            continue  # not a journal: a later take gets another number
        if header.parent is None or header.parent in tree.takes:
            tree = tree.with_take(Take(number, header.parent, header.tick))
    return tree


def find_unfinished(tree: TakeTree) -> tuple[TakeTree, list[tuple[int, int]], list[str]]:
    """Return the tree, the takes that an earlier session has not finished with their numbers of ticks, and problems.

    A take whose journal cannot be read is marked as void, with a sentence.
    """
    unfinished: list[tuple[int, int]] = []
    problems: list[str] = []
    for number, take in sorted(tree.takes.items()):
        if take.status in (TakeStatus.RUNNING, TakeStatus.LEFT):
            try:
                _, ticks = read_journal(tree.find_journal(number))
            except InputError as error:
                problems.append(f"take {number} cannot be finished: {error}")
                tree = tree.with_take(replace(take, status=TakeStatus.VOID))
                continue
            unfinished.append((number, len(ticks)))
            tree = tree.with_take(replace(take, status=TakeStatus.LEFT))
    return tree, unfinished, problems


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
