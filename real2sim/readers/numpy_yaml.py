"""YAML as PyYAML dumps NumPy's numbers and arrays: read them as numbers and lists, without running anything.

Such files name Python functions in their tags (`python/object/apply:numpy.core.multiarray._reconstruct`). None is
called: a closed list of tags is decoded from its bytes; every other tag is an error of the file.
"""

import math
from typing import Any

import numpy as np
import yaml
from yaml.constructor import ConstructorError

NUMBERS = frozenset(("f4", "f8", "i4", "i8"))
"""Kinds of numbers that arrays may hold."""
MAX_DIMENSIONS = 2
"""Poses are matrices; nothing in these files has more dimensions."""
_PYTHON = "tag:yaml.org,2002:python/"


class NumpyLoader(yaml.CSafeLoader):
    """Safe loader that also reads NumPy's numbers (as numbers) and arrays (as nested lists)."""


def _read_dtype(loader: NumpyLoader, node: yaml.Node) -> np.dtype[Any]:
    """Read `args: [f8, false, true]`, `state: (3, "<", ...)`."""
    match _read_parts(loader, node):
        case {"args": [str(kind), *_], "state": [int(), "<" | ">" as order, *_]} if kind in NUMBERS:
            return np.dtype(order + kind)
        case _:
            raise _refuse(node, f"a kind of numbers among {', '.join(sorted(NUMBERS))}")


def _read_scalar(loader: NumpyLoader, node: yaml.Node) -> Any:
    """Read `[dtype, bytes]`."""
    if not isinstance(node, yaml.SequenceNode):
        raise _refuse(node, "a kind of numbers and bytes")
    match loader.construct_sequence(node, deep=True):
        case [np.dtype() as kind, bytes(data)] if len(data) == kind.itemsize:
            return np.frombuffer(data, kind)[0].item()
        case _:
            raise _refuse(node, "a kind of numbers and its bytes")


def _read_array(loader: NumpyLoader, node: yaml.Node) -> Any:
    """Read `state: (1, shape, dtype, is_fortran, bytes)`."""
    match _read_parts(loader, node):
        case {"state": [int(), [*shape], np.dtype() as kind, bool(fortran), bytes(data)]} if (
            0 < len(shape) <= MAX_DIMENSIONS
            and all(type(n) is int and n >= 0 for n in shape)
            and math.prod(shape) * kind.itemsize == len(data)
        ):
            return np.frombuffer(data, kind).reshape(shape, order="F" if fortran else "C").tolist()
        case _:
            raise _refuse(node, f"an array of up to {MAX_DIMENSIONS} dimensions with the bytes of its shape")


def _read_parts(loader: NumpyLoader, node: yaml.Node) -> dict[Any, Any]:
    return loader.construct_mapping(node, deep=True) if isinstance(node, yaml.MappingNode) else {}


def _read_tuple(loader: NumpyLoader, node: yaml.Node) -> list[Any]:
    if not isinstance(node, yaml.SequenceNode):
        raise _refuse(node, "a sequence")
    return loader.construct_sequence(node, deep=True)


def _skip_name(_loader: NumpyLoader, _node: yaml.Node) -> None:
    """Leave the name of the array's class unused."""


def _refuse(node: yaml.Node, expected: str) -> ConstructorError:
    return ConstructorError(None, None, f"expected {expected}, found other content", node.start_mark)


NumpyLoader.add_constructor(f"{_PYTHON}tuple", _read_tuple)
NumpyLoader.add_constructor(f"{_PYTHON}name:numpy.ndarray", _skip_name)
NumpyLoader.add_constructor(f"{_PYTHON}object/apply:numpy.dtype", _read_dtype)
for _module in ("numpy.core.multiarray", "numpy._core.multiarray"):  # NumPy 1 and 2
    NumpyLoader.add_constructor(f"{_PYTHON}object/apply:{_module}.scalar", _read_scalar)
    NumpyLoader.add_constructor(f"{_PYTHON}object/apply:{_module}._reconstruct", _read_array)
