"""Agent locators as in `--agent`: a built-in name, module:Class, path.py:Class, or carla:path.py."""

import importlib
import importlib.util
import sys
from collections.abc import Callable, Mapping, Sequence
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from typing import Any, cast

from mdrive_sumo.contract import Agent
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.suggestion import suggest_name

Config = Mapping[str, Any]
CARLA_PREFIX = "carla:"
"""Prefix of the file of a CARLA leaderboard agent. Once resolved: one that drives all CAVs of a scenario together."""
CARLA_SINGLE_PREFIX = "carla-single:"
"""Prefix of the file of a CARLA leaderboard agent for one vehicle, of which every CAV gets an instance."""


def find_carla_file(locator: str) -> Path | None:
    """Return the file of a CARLA leaderboard agent of either kind; None for other locators."""
    prefix, colon, file = locator.partition(":")
    if f"{prefix}{colon}" not in (CARLA_PREFIX, CARLA_SINGLE_PREFIX) or not file.endswith(".py"):
        return None
    return Path(file)


def is_joint_locator(locator: object) -> bool:
    """Return whether a resolved locator names one program for all CAVs."""
    return isinstance(locator, str) and locator.startswith(CARLA_PREFIX) and find_carla_file(locator) is not None


def split_locator(locator: str) -> tuple[str, str]:
    """Return (module or path, class name) of a locator. Raises InputError for anything else."""
    place, colon, name = locator.rpartition(":")
    if not colon or not place or not name.isidentifier():
        raise InputError(
            f"agent {locator!r}: expected a built-in name, module:Class, path.py:Class or carla:path.py, "
            "found none of them"
        )
    return place, name


def find_module_file(name: str) -> Path | None:
    """Return the file of a module without importing it or the packages around it; None if there is no such module.

    Raises InputError for one without a file of its own, such as those that are built into Python.
    """
    path: Sequence[str] | None = None
    spec: ModuleSpec | None = None
    parts = name.split(".")
    for i in range(len(parts)):
        spec = _find_spec(parts[i], path)
        if spec is None or (spec.submodule_search_locations is None and i + 1 < len(parts)):
            return None
        path = None if spec.submodule_search_locations is None else [*spec.submodule_search_locations]
    if spec is None or not spec.has_location or spec.origin is None or not Path(spec.origin).is_file():
        raise InputError(f"agent module {name!r:.80}: expected a Python file, found a module without one")
    return Path(spec.origin)


def _find_spec(name: str, path: Sequence[str] | None) -> ModuleSpec | None:
    """Return where a module is, as `import` would look for it. `importlib.util.find_spec` imports the packages.

    name: without its packages, whose folders are `path`: the full name has a namespace package ask for imported ones.
    """
    if path is not None:
        return PathFinder.find_spec(name, path)
    specs = (finder.find_spec(name, None, None) for finder in sys.meta_path)
    return next((spec for spec in specs if spec is not None), None)


def load_agent_class(locator: str) -> Callable[[Config], Agent]:
    """Import the class that `module:Class` or `path.py:Class` names; runs the user's code. Raises InputError."""
    place, name = split_locator(locator)
    module = load_module_from_file(Path(place)) if place.endswith(".py") else _import_module(place)
    agent_class: Any = getattr(module, name, None)
    if not callable(agent_class):
        raise InputError(f"expected a class {name} in {Path(place).name}, found none{_suggest_class(name, module)}")
    return cast("Callable[[Config], Agent]", agent_class)


def _suggest_class(name: str, module: Any) -> str:
    """Return which class of a module may have been meant, or which ones it has."""
    classes = [key for key, value in vars(module).items() if isinstance(value, type) and hasattr(value, "act")]
    return suggest_name(name, classes) or (f"; it has {', '.join(classes[:6])}" if classes else "")


def _import_module(name: str) -> Any:
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        raise InputError(f"agent module {name!r}: expected an importable module, found none ({error})") from None


def load_module_from_file(path: Path) -> Any:
    """Execute a Python file as the module of its name, with its folder on the path. Raises InputError."""
    if not path.is_file():
        raise InputError(f"agent file {path}: expected a Python file, found none")
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = module  # dataclasses and pickles look their own module up
    sys.path.insert(0, str(path.parent.resolve()))
    spec.loader.exec_module(module)
    return module
