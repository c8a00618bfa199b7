"""Find the agent classes of a Python file without running it."""

import ast
from pathlib import Path

from mdrive_sumo.core.input_files import read_bytes

MAX_SOURCE_BYTES = 2**24
MAX_NAMED = 6
"""Classes that a sentence names."""


def list_agent_classes(path: Path) -> tuple[str, ...]:
    """Return the names of the top-level classes of a file, those with a method `act` if any has one.

    () for a file that cannot be read or is no Python.
    """
    try:
        module = ast.parse(read_bytes(path, MAX_SOURCE_BYTES))
    except (OSError, SyntaxError, ValueError, RecursionError, MemoryError):
        return ()
    classes = [node for node in module.body if isinstance(node, ast.ClassDef)]
    agents = [node for node in classes if any(getattr(part, "name", "") == "act" for part in node.body)]
    return tuple(node.name for node in agents or classes)


def describe_missing_class(path: Path) -> str:
    """Return what to type for a file that was named without its class: "found the file ... without a class; ..."."""
    if not path.is_file():
        return f"found no file {str(path)!r}"
    names = list_agent_classes(path)
    if not names:
        return "found a Python file without a class"
    choices = " or ".join(f"{path}:{name}" for name in names[:MAX_NAMED])
    return f"found a file without the name of its class; use {choices}"
