"""What can be read from the file of an agent without running it."""

import ast
from pathlib import Path

from mdrive_sumo.agent_process.agent_lookup import CARLA_PREFIX
from mdrive_sumo.core.input_files import read_bytes

MAX_SOURCE_BYTES = 2**24
"""Chosen: far above any file that a person writes; a larger one is data, and is not parsed."""
MAX_NAMED = 6
"""Classes that a sentence names."""
ENTRY_POINT = "get_entry_point"
"""The function of a CARLA leaderboard agent that returns the name of its class."""
MAX_BASES = 8
"""Base classes that are followed from file to file, so that a circle ends."""
VEHICLE_WORDS = ("ego", "vehicle", "num", "cav")
"""One of them is in the name of the argument that tells an agent of the original code base how many CAVs it drives;
other leaderboards have optional arguments in its place, such as a route's number."""


def parse_agent_file(path: Path) -> ast.Module | None:
    """Return the syntax tree of a file; None for a file that cannot be read or is no Python."""
    try:
        return ast.parse(read_bytes(path, MAX_SOURCE_BYTES))
    except (OSError, SyntaxError, ValueError, RecursionError, MemoryError):
        return None


def list_agent_classes(path: Path) -> tuple[str, ...]:
    """Return the names of the top-level classes of a file, those with a method `act` if any has one."""
    classes = _list_classes(parse_agent_file(path))
    agents = [node for node in classes if _find_own_method(node, "act") is not None]
    return tuple(node.name for node in agents or classes)


def has_entry_point(path: Path) -> bool:
    """Return whether a file has the function by which the CARLA leaderboard finds an agent."""
    module = parse_agent_file(path)
    return module is not None and _find_function(module, ENTRY_POINT) is not None


def describe_missing_class(path: Path) -> str:
    """Return what to type for a file that was named without its class: "found the file ... without a class; ..."."""
    if not path.is_file():
        return f"found no file {str(path)!r}"
    if has_entry_point(path):
        return f"found an agent of the CARLA leaderboard; use {CARLA_PREFIX}{path}"
    names = list_agent_classes(path)
    if not names:
        return "found a Python file without a class"
    choices = " or ".join(f"{path}:{name}" for name in names[:MAX_NAMED])
    return f"found a file without the name of its class; use {choices}"


def drives_one_vehicle(path: Path) -> bool:
    """Return whether a CARLA leaderboard agent is one of the original leaderboards, with one vehicle and one control.

    Their `setup` takes the configuration; in the original code base of MDrive it takes the number of vehicles, too.
    False if the file does not tell, for example because `setup` is in a package that is installed elsewhere.
    """
    module = parse_agent_file(path)
    entry = _find_function(module, ENTRY_POINT) if module is not None else None
    name = _find_returned_text(entry) if entry is not None else None
    if module is None or name is None:
        return False
    setup = _find_method(path, module, name, "setup", MAX_BASES)
    return setup is not None and not _takes_vehicles(setup.args)


def is_vehicle_count(name: str, is_required: bool) -> bool:
    """Return whether the second argument of `setup` is the number of vehicles."""
    return is_required or any(word in name.lower() for word in VEHICLE_WORDS)


def _takes_vehicles(arguments: ast.arguments) -> bool:
    positional = [*arguments.posonlyargs, *arguments.args]
    if arguments.vararg is not None:
        return True
    if len(positional) < 3:  # self, config
        return False
    is_required = len(positional) - len(arguments.defaults) >= 3
    return is_vehicle_count(positional[2].arg, is_required)


def _list_classes(module: ast.Module | None) -> list[ast.ClassDef]:
    return [] if module is None else [node for node in module.body if isinstance(node, ast.ClassDef)]


def _find_function(module: ast.Module, name: str) -> ast.FunctionDef | None:
    return next((node for node in module.body if isinstance(node, ast.FunctionDef) and node.name == name), None)


def _find_own_method(node: ast.ClassDef, name: str) -> ast.FunctionDef | None:
    return next((part for part in node.body if isinstance(part, ast.FunctionDef) and part.name == name), None)


def _find_returned_text(function: ast.FunctionDef) -> str | None:
    """Return the text that a function returns; None if it returns anything but a constant."""
    returned = [node.value for node in ast.walk(function) if isinstance(node, ast.Return)]
    if len(returned) == 1 and isinstance(returned[0], ast.Constant) and isinstance(returned[0].value, str):
        return returned[0].value
    return None


def _find_method(path: Path, module: ast.Module, cls: str, method: str, bases_left: int) -> ast.FunctionDef | None:
    """Return a method of a class or of its bases, in this file or in files beside it; None if it is not there."""
    node = next((node for node in _list_classes(module) if node.name == cls), None)
    if node is None:
        return _find_imported_method(path, module, cls, method, bases_left)
    if (own := _find_own_method(node, method)) is not None or not bases_left:
        return own
    bases = [base.id if isinstance(base, ast.Name) else getattr(base, "attr", "") for base in node.bases]
    inherited = (_find_method(path, module, base, method, bases_left - 1) for base in bases)
    return next((definition for definition in inherited if definition is not None), None)


def _find_imported_method(
    path: Path, module: ast.Module, cls: str, method: str, bases_left: int
) -> ast.FunctionDef | None:
    for node in module.body:
        if not isinstance(node, ast.ImportFrom) or not node.module or not bases_left:
            continue
        for alias in node.names:
            file = path.parent.joinpath(*node.module.split(".")).with_suffix(".py")
            other = parse_agent_file(file) if (alias.asname or alias.name) == cls and file.is_file() else None
            if other is not None:
                return _find_method(file, other, alias.name, method, bases_left - 1)
    return None
