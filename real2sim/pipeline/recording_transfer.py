"""Recordings and maps as bytes between processes: msgpack with the fields of dataclasses, never a pickle.

Bytes are read against the annotations of the class that is expected, so a process that reads files of strangers cannot
answer with anything else.
"""

import re
import types
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from enum import StrEnum
from functools import lru_cache
from typing import Any, TypeVar, Union, cast, get_args, get_origin, get_type_hints

import msgpack
import numpy as np

from mdrive_sumo.core.clean_text import clean_line

T = TypeVar("T")
KINDS_BY_DTYPE: Mapping[type, str] = {np.bool_: "b", np.float64: "fiu"}
"""Kinds of numbers that a source may have where an array is annotated so."""


class TransferError(ValueError):
    """Bytes that are not a value of the expected class."""

    def __init__(self, text: str) -> None:
        """text: may quote the answer; line breaks and characters of control in it are shown as escapes."""
        super().__init__(clean_line(text))


def encode_value(value: object) -> bytes:
    """Return a dataclass of numbers, text, arrays and such dataclasses as bytes. Raises TypeError for others."""
    return cast(bytes, msgpack.packb(_to_plain(value), use_bin_type=True))


def decode_value(data: bytes, expected: type[T]) -> T:
    """Return the value that `encode_value` has written. Raises TransferError for another class or damaged bytes."""
    try:
        return _from_plain(expected, msgpack.unpackb(data, raw=False))
    except (ValueError, TypeError, KeyError, OverflowError, msgpack.UnpackException) as error:
        raise TransferError(f"expected a {expected.__name__}, found: {error}") from None


def _to_plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        plain = np.ascontiguousarray(value)
        return {
            "dtype": plain.dtype.newbyteorder("<").str,
            "shape": value.shape,
            "data": plain.astype(plain.dtype.newbyteorder("<"), copy=False).tobytes(),
        }
    if is_dataclass(value) and not isinstance(value, type):
        return {field.name: _to_plain(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, Mapping):
        return {str(key): _to_plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_to_plain(item) for item in value]
    if isinstance(value, np.generic):
        return value.item()
    if value is None or isinstance(value, bool | int | float | str):
        return value
    raise TypeError(f"expected numbers, text, arrays or dataclasses, found {type(value).__name__}")


def _from_plain(expected: Any, plain: Any) -> Any:
    """Return the value of a plain one for an annotation."""
    origin = get_origin(expected)
    if origin in (Union, types.UnionType):
        return (
            None
            if plain is None
            else _from_plain(_get_only([a for a in get_args(expected) if a is not type(None)]), plain)
        )
    if origin is not None and issubclass(origin, np.ndarray):
        return _to_array(get_args(get_args(expected)[1])[0], _check(plain, dict))
    if origin is tuple:
        item, *rest = get_args(expected)
        items = _check(plain, list)
        if rest == [...]:
            return tuple(_from_plain(item, part) for part in items)
        return tuple(_from_plain(hint, part) for hint, part in zip((item, *rest), items, strict=True))
    if origin is not None and issubclass(origin, Mapping):
        item = get_args(expected)[1]
        return {_check(key, str): _from_plain(item, value) for key, value in _check(plain, dict).items()}
    return _to_object(expected, plain)


def _to_object(expected: Any, plain: Any) -> Any:
    """Return a dataclass, an enumeration or a scalar."""
    if is_dataclass(expected):
        hints = _get_hints(expected)
        given = _check(plain, dict)
        if given.keys() != hints.keys():
            raise TransferError(f"expected the fields of {expected}, found {', '.join(map(str, given))[:200]}")
        build = cast(Callable[..., Any], expected)
        return build(**{name: _from_plain(hint, given[name]) for name, hint in hints.items()})
    if issubclass(expected, StrEnum):
        return expected(_check(plain, str))
    if expected is float:
        return float(_check(plain, int if type(plain) is int else float))
    return _check(plain, expected)


@lru_cache(maxsize=32)
def _get_hints(cls: Any) -> Mapping[str, Any]:
    hints = get_type_hints(cls)
    return {field.name: hints[field.name] for field in fields(cls)}


def _to_array(dtype: Any, plain: dict[str, Any]) -> "np.ndarray[Any, Any]":
    word, shape = _check(plain["dtype"], str), _check(plain["shape"], list)
    # NumPy evaluates other words, such as lists with commas.
    stored = np.dtype(word) if re.fullmatch(r"[<|][bfiu][1248]", word) else None
    if stored is None or stored.kind not in KINDS_BY_DTYPE[dtype] or not all(type(n) is int and n >= 0 for n in shape):
        raise TransferError(f"expected an array of {dtype.__name__}, found {word!r} of the shape {shape}")
    return np.frombuffer(_check(plain["data"], bytes), stored).reshape(shape).copy()


def _get_only(candidates: list[Any]) -> Any:
    (hint,) = candidates
    return hint


def _check(plain: Any, expected: type[T]) -> T:
    if type(plain) is not expected:
        raise TransferError(f"expected {expected.__name__}, found {type(plain).__name__}")
    return plain
