"""Which functions are compiled: `twin` takes those of the layer, or the Python text where there is no layer.

A Python file with twins has a C file beside it, with the same names in the same order. The Python text is the
reference: it says what is computed, tests compare both, and it is used where the layer is missing.
docs/compiled-layer.md says how to write a twin; `hatch_build.py` compiles all of them into one extension module.
"""

import os
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar

from mdrive_sumo.core.compiled.sources import digest_sources
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
    if _is_outdated(layer):
        return None, "expected one built from the C files of this clone, found an older one; python hatch_build.py"
    return layer, ""


def _is_outdated(layer: ModuleType) -> bool:
    """Whether C files were changed after the layer was built: in a clone, where they can be."""
    root = Path(__file__).parents[3]
    if not (root / "hatch_build.py").is_file():
        return False
    try:
        return digest_sources(root, layer.FILES.split()) != layer.SOURCES
    except OSError:
        return True


USED_LAYER, PROBLEM = _load_layer()
"""The extension module if it is used, and what is wrong if it should be and is not."""


def twin(reference: Function) -> Function:
    """Return the compiled function of that module and name, or the reference where the layer is not used.

    A twin takes its arguments by position only.
    """
    module = reference.__module__.removeprefix("mdrive_sumo.")
    name = f"{module}.{reference.__qualname__}".replace(".", "_")
    REFERENCES[name] = reference
    return reference if USED_LAYER is None else getattr(USED_LAYER, name)


def format_notice() -> str:
    """Return the line for a user whose installation lacks the layer, "" if it has it."""
    if not PROBLEM:
        return ""
    return f"mdrive-sumo runs without its compiled layer: same results, several times slower ({PROBLEM})"
