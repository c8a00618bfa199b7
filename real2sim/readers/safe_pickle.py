"""Load untrusted pickles: only listed classes are resolved, others are refused, and nothing is executed.

Arrays are built by `pickled_arrays`. A pickle can still ask for much memory or time: `mdrive-sumo convert` therefore
reads logs in a process with limits (`real2sim.pipeline.limited_reader`).
"""

import pickle
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.input_files import open_regular
from real2sim.readers.pickled_arrays import DTYPE, FROM_BUFFER, NDARRAY, RECONSTRUCT, SCALAR
from real2sim.readers.pickled_containers import CONTAINERS

AllowedGlobals = Mapping[tuple[str, str], object]
"""(module, name) in a pickle -> object used for it. None of them may have attributes that a pickle can set."""

_HELPERS: AllowedGlobals = {
    ("multiarray", "_reconstruct"): RECONSTRUCT,
    ("multiarray", "scalar"): SCALAR,
    ("numeric", "_frombuffer"): FROM_BUFFER,
}

NUMPY_GLOBALS: AllowedGlobals = {
    **{(f"numpy.core.{module}", name): helper for (module, name), helper in _HELPERS.items()},  # numpy 1
    **{(f"numpy._core.{module}", name): helper for (module, name), helper in _HELPERS.items()},  # numpy 2
    ("numpy", "ndarray"): NDARRAY,
    ("numpy", "dtype"): DTYPE,
}
"""Arrays and scalars of numpy."""

PLAIN_GLOBALS: AllowedGlobals = {**NUMPY_GLOBALS, **CONTAINERS}
"""Arrays, and the containers of Python's library."""

UNPICKLING_ERRORS = (
    pickle.UnpicklingError, EOFError, ValueError, TypeError, AttributeError, LookupError, MemoryError, OverflowError,
    RecursionError, NotImplementedError, AssertionError, SystemError, BufferError,
)  # fmt: skip
"""Exceptions of the unpickler for invalid or incomplete data."""


class _RestrictedUnpickler(pickle.Unpickler):
    def __init__(self, path: Path, file: Any, allowed: AllowedGlobals) -> None:
        super().__init__(file)
        self._path, self._allowed = path, allowed

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) not in self._allowed:
            raise InputError(
                f"{self._path}: expected a pickle of plain data and numpy arrays, "
                f"found the class {module}.{name}; nothing was executed"
            )
        return self._allowed[module, name]


MAX_PICKLE_BYTES = 2**32
"""Of a file; the largest of ScenarioNet have 100 MB."""


def load_pickle(path: Path, allowed: AllowedGlobals = PLAIN_GLOBALS) -> Any:
    """Load a pickle; raise InputError if it is unreadable, broken or names a class not in `allowed`."""
    try:
        with open_regular(path, MAX_PICKLE_BYTES) as file:
            return _RestrictedUnpickler(path, file, allowed).load()
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    except UNPICKLING_ERRORS as error:
        raise InputError(f"{path}: expected a complete pickle, found: {_format_error(error)}") from None


def _format_error(error: Exception) -> str:
    """Return type and message: a `KeyError` contains only the missing key."""
    words = str(error).splitlines() or [""]
    return f"{type(error).__name__} {words[0]}".strip()
