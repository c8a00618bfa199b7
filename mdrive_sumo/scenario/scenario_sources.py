"""Suites of other packages: entry points of the group `mdrive_sumo.scenario_sources`."""

from collections.abc import Iterable
from functools import lru_cache
from os import PathLike
from pathlib import Path

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.plug_ins import PlugInKind, check_plug_in_names, list_plug_ins


def list_source_folders(suite_file: str, known: Iterable[str]) -> dict[str, Path]:
    """Return the folders of the suites of other packages by name.

    suite_file: name of the file that each of them has. known: names of the packaged suites. Raises InputError for a
    source without a suite, or with the name of a packaged one.
    """
    check_plug_in_names(PlugInKind.SCENARIO_SOURCES, known)
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
