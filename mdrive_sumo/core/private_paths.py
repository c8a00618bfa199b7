"""Paths as files that leave a machine name them: relative to a folder, never absolute.

Runs are sent to double-blind reviews and published, so that no absolute path, no user name and no host name may be in
them.
"""

import os
import re
from collections.abc import Sequence
from pathlib import Path

from mdrive_sumo.core.errors import InputError

_PATH_IN_ARGUMENT = re.compile(r"(^|[=:,])(/[^:=,]+)")
_PATH_IN_TEXT = re.compile(r"(?<![\w.~:/-])(?:~|/)(?:[^/\s\"'<>]+/)*([^/\s\"'<>]+)")
_LOCATOR = re.compile(r"(?P<prefix>(?:carla(?:-single)?:)?)(?P<path>[^:]*\.py)(?P<name>(?::\w+)?)")


def relate_path(path: Path, folder: Path) -> str:
    """Return a path relative to a folder, beginning with a dot; "./NAME" where the relation would name a user's folder.

    That is so if the two share nothing below the folder of all users' homes.
    """
    target, start = path.resolve(), folder.resolve()
    common = Path(os.path.commonpath((target, start)))
    home = Path.home()
    relative = Path(os.path.relpath(target, start))
    if common == Path(common.anchor) or common in home.parents or home.name in relative.parts[:-1]:
        return f"./{target.name}"
    text = relative.as_posix()
    return text if text.startswith(".") else f"./{text}"


def hide_place(path: Path) -> str:
    """Return the path of a run as a report names it: as it was typed, or relative to the present folder."""
    return relate_path(path, Path.cwd()).removeprefix("./") if path.is_absolute() else str(path)


def hide_locator(name: str, folder: Path | None = None) -> str:
    """Return the locator of an agent with the path of its file relative to a folder; without one only the file's name.

    Other locators stay as they are, and so do relative paths beside a folder.
    """
    match = _LOCATOR.fullmatch(name)
    if match is None or (folder is not None and not Path(match["path"]).is_absolute()):
        return name
    path = Path(match["path"])
    shown = path.name if folder is None else relate_path(path, folder)
    return f"{match['prefix']}{shown}{match['name']}"


def restore_locator(name: str, folder: Path) -> str:
    """Return a locator that `hide_locator` has written with the absolute path of its file; see `restore_path`."""
    match = _LOCATOR.fullmatch(name)
    if match is None or not name.removeprefix(match["prefix"]).startswith("."):
        return name
    return f"{match['prefix']}{restore_path(match['path'], folder)}{match['name']}"


def restore_path(relative: str, folder: Path) -> Path:
    """Return the absolute path of one that is relative to a folder.

    If nothing is there, because only the name is known or the folder was moved, it is looked for by its name in the
    present folder; runs have checksums of agents and suites, so that another one of the name is refused. Raises
    InputError for what is no path, such as one with a zero byte in a stranger's file.
    """
    try:
        path = (folder / relative).resolve()
        here = Path.cwd() / path.name
        return here if here.exists() and not path.exists() else path
    except (OSError, ValueError, RuntimeError):  # too long, a zero byte or half a surrogate pair, a loop of links
        raise InputError(f"{folder}: expected the path of a file or a folder, found {relative!r:.80}") from None


def hide_command(command: Sequence[str], folder: Path) -> tuple[str, ...]:
    """Return a command line whose absolute paths are relative to a folder."""

    def hide(match: re.Match[str]) -> str:
        return f"{match[1]}{relate_path(Path(match[2]), folder)}"

    return tuple(_PATH_IN_ARGUMENT.sub(hide, argument) for argument in command)


def hide_paths_in_text(text: str) -> str:
    """Return a text, such as a traceback, of whose absolute paths only the names of the files are left."""
    return _PATH_IN_TEXT.sub(r"\1", text)
