"""Load untrusted pickles: only listed classes are resolved, others are refused, and nothing is executed.

numpy's own constructors trust the pickle: `numpy.ndarray(shape, "O", buffer)` takes the bytes of the file for addresses
of objects, and the state of a dtype replaces its kind and its size. Here a dtype is a name, and an array is made of
bytes of the right number and of numbers or text only.

MetaDrive's writer leaves a `defaultdict(int)` in `metadata.number_summary` of every description; pickles of protocol 3
and older name the class of every set, and those of protocol 2 and older carry bytes as text: containers of Python's
library are built as plain dicts and sets.

A pickle can still ask for much memory or time: `mdrive-sumo convert` therefore reads logs in a process with limits
(`real2sim.pipeline.limited_reader`).
"""

import math
import pickle
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.input_files import open_regular

MAX_EMPTY_ROWS = 10_000
"""Rows of an array without elements: each costs memory when it is read, but none in the file."""
MAX_DIMENSIONS = 8
"""Chosen: more than the arrays of any description have."""
_DTYPE_NAME = re.compile(r"b1|[iu][1248]|f[248]|U[1-9][0-9]{0,4}")
"""Bool, integers, floats and text: never objects, records, dates or raw memory."""
_BYTE_ORDERS = ("<", ">", "=", "|")


class Constructor:
    """A function that a pickle may call, but not change: without `__setstate__`, BUILD would set its attributes."""

    __slots__ = ("_function",)

    def __init__(self, function: Callable[..., Any]) -> None:
        """Wrap a function."""
        self._function = function

    def __call__(self, *arguments: Any) -> Any:
        """Call the function."""
        return self._function(*arguments)

    def __setstate__(self, state: object) -> None:
        """Raise ValueError: a function has no state."""
        raise ValueError("a state for a function")


class PickledDtype:
    """The name and the byte order of a dtype. The rest of its pickled state is ignored or refused."""

    __slots__ = ("_name", "_order")

    def __init__(self, name: object, *_: object) -> None:
        """Check the name, such as "f8" or "U12"; raise ValueError for other kinds."""
        if not isinstance(name, str) or not _DTYPE_NAME.fullmatch(name):
            raise ValueError(f"expected an array of numbers or text, found the dtype {str(name)[:20]!r}")
        self._name, self._order = name, "="

    def __setstate__(self, state: object) -> None:
        """Take the byte order; raise ValueError for the state of a record, a subarray or with metadata."""
        if not isinstance(state, tuple) or len(state) != 8 or state[1] not in _BYTE_ORDERS:
            raise ValueError("expected the state of a plain dtype")
        if any(part is not None for part in state[2:5]):
            raise ValueError("expected a plain dtype, found a record")
        self._order = state[1]

    @property
    def dtype(self) -> "np.dtype[Any]":
        """The numpy dtype."""
        return np.dtype(self._order + self._name)


class _PickledArray(np.ndarray[Any, np.dtype[Any]]):
    """An array whose state is checked before numpy sees it; no pickle can name this class."""

    def __setstate__(self, state: Any) -> None:
        """Take shape, dtype, order and bytes of an array; raise ValueError if they do not fit."""
        if not isinstance(state, tuple) or len(state) != 5:
            raise ValueError("expected the state of an array")
        _, shape, dtype, fortran, data = state
        array = _build_array(shape, dtype, "F" if fortran is True else "C", data)
        set_state: Callable[[Any], None] = super().__setstate__
        set_state((1, array.shape, array.dtype, fortran is True, array.tobytes("A")))


def _build_array(shape: Any, dtype: Any, order: Any, data: Any) -> npt.NDArray[Any]:
    """Return a new array; raise ValueError unless all parts are of the right type and agree."""
    if not isinstance(dtype, PickledDtype) or not isinstance(data, bytes | bytearray) or order not in ("C", "F"):
        raise ValueError("expected the parts of an array of numbers or text")
    if not isinstance(shape, tuple) or not all(type(n) is int and n >= 0 for n in shape):
        raise ValueError("expected a shape of whole numbers")
    count = math.prod(shape)
    if count * dtype.dtype.itemsize != len(data) or len(shape) > MAX_DIMENSIONS:
        raise ValueError(f"expected an array of {len(data)} bytes, found the shape {str(shape)[:60]}")
    if not count and max(shape) > MAX_EMPTY_ROWS:
        raise ValueError(f"expected at most {MAX_EMPTY_ROWS} rows without elements, found {max(shape)}")
    values = np.frombuffer(bytes(data), dtype.dtype) if count else np.empty(0, dtype.dtype)
    _check_contents(values)
    return values.reshape(shape, order=order).copy(order)


def _check_contents(values: npt.NDArray[Any]) -> None:
    """Raise ValueError for bits that are no value of the dtype; numpy takes them unchecked."""
    if values.dtype.kind == "b" and values.view(np.uint8).max(initial=0) > 1:
        raise ValueError("expected 0 or 1 in an array of bool")
    if values.dtype.kind == "U":
        codes = values.view(values.dtype.byteorder.replace("|", "=") + "u4")
        if codes.max(initial=0) > 0x10FFFF:
            raise ValueError("expected text, found a number that is no character")


def _make_ndarray(*_: object) -> None:
    raise ValueError("expected arrays as numpy writes them, found a call of numpy.ndarray")


NDARRAY = Constructor(_make_ndarray)
"""Stands for the class numpy.ndarray, which pickles name but do not call."""


def _reconstruct(subtype: object, *_: object) -> _PickledArray:
    if subtype is not NDARRAY:
        raise ValueError("expected numpy.ndarray")
    return _PickledArray((0,), np.float64)


def _build_scalar(dtype: Any, data: Any = b"") -> Any:
    return _build_array((1,), dtype, "C", data)[0]


def _build_from_buffer(data: Any, dtype: Any, shape: Any, order: Any, axis_order: Any = None) -> npt.NDArray[Any]:
    if order == "K" and axis_order is not None:
        made = _build_array(shape, dtype, "C", data).transpose(axis_order)
    else:
        made = _build_array(shape, dtype, order, data)
    return made.view(_PickledArray)  # a later BUILD must not reach numpy's own `__setstate__`


RECONSTRUCT = Constructor(_reconstruct)
SCALAR = Constructor(_build_scalar)
FROM_BUFFER = Constructor(_build_from_buffer)
DTYPE = Constructor(PickledDtype)


class _Factory(Constructor):
    """Stands for a type that is the default of a `defaultdict`; a pickle cannot call it."""

    __slots__ = ()

    def __init__(self) -> None:
        super().__init__(_refuse_call)


def _refuse_call(*_: object) -> None:
    raise ValueError("expected a type as the default of a dict only, found a call of it")


def _build_default_dict(factory: object = None, items: Any = ()) -> dict[Any, Any]:
    if factory is not None and not isinstance(factory, _Factory):
        raise ValueError("expected a type of numbers, text or containers as the default of a dict")
    return _build_dict(items)


def _build_dict(items: Any = ()) -> dict[Any, Any]:
    if not isinstance(items, dict | list | tuple):
        raise ValueError("expected the items of a dict")
    return dict(items)


def _build_set(items: Any = ()) -> set[Any]:
    if not isinstance(items, list | tuple):
        raise ValueError("expected the items of a set")
    return set(items)


def _build_frozenset(items: Any = ()) -> frozenset[Any]:
    return frozenset(_build_set(items))


def _encode(text: Any, encoding: Any = "") -> bytes:
    if not isinstance(text, str) or encoding != "latin1":
        raise ValueError("expected bytes as text of latin1")
    return text.encode("latin-1")


def _build_bytes() -> bytes:
    return b""


FACTORY_NAMES = ("int", "float", "bool", "str", "list", "dict")
"""Types that count as the default of a dict; a set is named for itself as well."""
_BUILTINS = ("builtins", "__builtin__")
"""Python 3's name of the module, and that of protocol 2 and older."""

CONTAINERS: dict[tuple[str, str], object] = {
    ("collections", "defaultdict"): Constructor(_build_default_dict),
    ("collections", "OrderedDict"): Constructor(_build_dict),
    ("collections", "Counter"): Constructor(_build_dict),
    ("_codecs", "encode"): Constructor(_encode),
    **{(module, name): _Factory() for module in _BUILTINS for name in (*FACTORY_NAMES, "long")},
    **{(module, "set"): Constructor(_build_set) for module in _BUILTINS},
    **{(module, "frozenset"): Constructor(_build_frozenset) for module in _BUILTINS},
    **{(module, "bytes"): Constructor(_build_bytes) for module in _BUILTINS},
    ("metadrive.scenario.scenario_description", "ScenarioDescription"): dict,  # of to_dict=False: a dict with constants
}
"""(module, name) in a pickle -> its constructor."""


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
