"""Loads the extension module, and puts its functions in the place of their Python text."""

import os
from collections.abc import Callable
from importlib import import_module
from types import ModuleType
from typing import Any, TypeVar

from mdrive_sumo.core.version import __version__

Function = TypeVar("Function", bound=Callable[..., Any])

SWITCH = "MDRIVE_COMPILED"
"""Environment variable: `off` uses the Python text. Results are the same; it is for comparing both."""
LAYER = "mdrive_sumo.core.compiled.layer"
REFERENCES: dict[str, Callable[..., Any]] = {}
"""The Python text of every twin that has been imported, by the name of its compiled function."""


def _load_layer() -> tuple[ModuleType | None, str]:
    """Return the extension module, or None and why it is not used, "" if on purpose."""
    if os.environ.get(SWITCH) == "off":
        return None, ""
    try:
        layer = import_module(LAYER)
    except ImportError as error:
        return None, str(error)
    if __version__ != layer.VERSION:
        return None, f"expected version {__version__}, found {layer.VERSION} in {layer.__file__}"
    return layer, ""


layer, problem = _load_layer()
"""The extension module if it is used, and what is wrong if it should be and is not."""


def twin(reference: Function) -> Function:
    """Return the compiled function of that module and name, or the reference where the layer is not used.

    A twin takes its arguments by position only.
    """
    module = reference.__module__.removeprefix("mdrive_sumo.")
    name = f"{module}.{reference.__qualname__}".replace(".", "_")
    REFERENCES[name] = reference
    return reference if layer is None else getattr(layer, name)


def format_notice() -> str:
    """Return the line for a user whose installation lacks the layer, "" if it has it."""
    if not problem:
        return ""
    return f"mdrive-sumo runs without its compiled layer: same results, several times slower ({problem})"
