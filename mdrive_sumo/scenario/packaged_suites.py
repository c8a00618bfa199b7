"""The suites that come with mdrive-sumo, season by season, and those of other packages: names and folders."""

import re
from collections.abc import Iterable
from functools import lru_cache
from importlib.resources import files
from os import PathLike
from pathlib import Path

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.plug_ins import PlugInKind, check_plug_in_names, list_plug_ins
from mdrive_sumo.scenario.season import FIRST_SEASON, SEASON_SUITES, join_suite_name, split_suite_name

SUITE_FILE = "suite.json"
SEASON_FOLDER = "season_{season}"
"""Where the suites of a season lie, in the folder in which those of season 0 do."""


def find_scenarios_root() -> Path:
    """Return the folder of the packaged suites."""
    return Path(str(files("mdrive_sumo") / "scenarios"))


def list_packaged_suites() -> dict[str, Path]:
    """Suites that come with mdrive-sumo, and those of other packages (`mdrive_sumo.scenario_sources`): name -> folder.

    Of a suite with seasons it is the newest public one. Raises InputError for a scenario source that is none.
    """
    own = _list_suites_in(find_scenarios_root())
    newest = {name: folders[max(folders)] for name in SEASON_SUITES if (folders := list_seasons(name))}
    own |= newest
    return own | list_source_folders(SUITE_FILE, own)


def list_suites() -> tuple[str, ...]:
    """Return the names of the suites that come with mdrive-sumo."""
    return tuple(list_packaged_suites())


def list_seasons(name: str) -> dict[int, Path]:
    """Return the folders of a suite by public season, the oldest first; none for a suite without seasons."""
    if name not in SEASON_SUITES:
        return {}
    root = find_scenarios_root()
    numbers = sorted(
        int(match[1]) for path in root.iterdir() if (match := re.fullmatch(r"season_([1-9][0-9]*)", path.name))
    )
    folders = {FIRST_SEASON: root / name} | {
        number: root / SEASON_FOLDER.format(season=number) / name for number in numbers
    }
    return {season: folder for season, folder in folders.items() if (folder / SUITE_FILE).is_file()}


def list_exact_suites() -> dict[str, Path]:
    """Return the folders of all packaged suites of all seasons, `mdrive@0` too, and of other packages by exact name.

    Newer seasons come before older ones.
    """
    newest = list_packaged_suites()
    seasons = {name: list_seasons(name) for name in SEASON_SUITES}
    numbers = sorted({number for folders in seasons.values() for number in folders}, reverse=True)
    exact = {
        join_suite_name(name, number): folders[number]
        for number in numbers
        for name, folders in seasons.items()
        if number in folders
    }
    return exact | {name: folder for name, folder in newest.items() if name not in SEASON_SUITES}


def find_packaged_suite(name: str) -> Path | None:
    """Return the folder of a packaged suite by its name, with or without a season; None: there is no such suite.

    Raises InputError for a season that is not packaged.
    """
    packaged = list_packaged_suites()
    suite, season = split_suite_name(name)
    if not season or suite not in packaged:
        return packaged.get(name)
    if folder := list_exact_suites().get(name):
        return folder
    if not (seasons := list_seasons(suite)):
        raise InputError(f"suite {name!r}: expected {suite!r}, which has no seasons, found one after @")
    known = ", ".join(join_suite_name(suite, number) for number in seasons)
    raise InputError(
        f"suite {name!r}: expected one of {known}, found another season; one of your own, such as a secret one,"
        " is named by its folder"
    )


def name_exactly(name_or_folder: str) -> str:
    """Return the exact name of a suite, which newer seasons do not change: `mdrive@0`; folders are as they are.

    Raises InputError for a season that is not packaged.
    """
    folder = find_packaged_suite(name_or_folder)
    return name_or_folder if folder is None else name_packaged_suite(folder) or name_or_folder


def find_suite_folder(name_or_folder: str) -> Path:
    """Return the folder of a packaged suite by name, else the given one, which may not exist. Raises InputError."""
    return find_packaged_suite(name_or_folder) or Path(name_or_folder)


def name_packaged_suite(folder: Path) -> str | None:
    """Return the exact name of the packaged suite in a folder, such as `mdrive@0`; None: no packaged suite is there."""
    place = folder.resolve()
    return next((name for name, home in list_exact_suites().items() if home.resolve() == place), None)


def is_own_suite(folder: Path) -> bool:
    """Return whether a suite of season 0, or without seasons, that comes with mdrive-sumo is in this folder."""
    return folder.parent.resolve() == find_scenarios_root().resolve()


def list_source_folders(suite_file: str, packaged: Iterable[str]) -> dict[str, Path]:
    """Return the folders of the suites of other packages by name.

    suite_file: name of the file that each of them has. packaged: names of the packaged suites. Raises InputError for a
    source without a suite, or with the name of a packaged one.
    """
    check_plug_in_names(PlugInKind.SCENARIO_SOURCES, packaged)
    return {name: find_source_folder(name, suite_file) for name in list_plug_ins(PlugInKind.SCENARIO_SOURCES)}


@lru_cache(maxsize=64)
def find_source_folder(name: str, suite_file: str) -> Path:
    """Return the folder of a source: the plug-in is the folder, or a function that returns it. Raises InputError."""
    plug_in = list_plug_ins(PlugInKind.SCENARIO_SOURCES)[name]
    source = plug_in.load()
    folder = source() if callable(source) else source
    if not isinstance(folder, str | PathLike) or not (Path(folder) / suite_file).is_file():
        raise InputError(
            f"{plug_in.describe()}: expected the folder of a suite with {suite_file}, or a function that returns it,"
            f" found {folder!r:.80}"
        )
    return Path(folder)


def _list_suites_in(root: Path) -> dict[str, Path]:
    return {folder.name: folder for folder in sorted(root.iterdir()) if (folder / SUITE_FILE).is_file()}
