"""The contract as bytes: msgpack, dataclasses by name, arrays as (dtype, shape, bytes). Never a pickle.

`decode` reads messages of the trusted side; `reply_decoding` reads those of an agent.
"""

import struct
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from functools import lru_cache
from typing import Any, cast

import msgpack
import numpy as np
import numpy.typing as npt

from mdrive_sumo import contract

MAX_BYTES = 64 * 2**20
"""Longest frame that the agent's side reads [bytes]."""
LARGE_BYTES = 4096
"""Longer arrays go into the frame file, if there is one."""
LENGTH = struct.Struct("<I")
"""Prefix of every frame: the number of bytes that follow."""
CREATE_TICK, START_TICK = -2, -1
"""Ticks of the requests before the first observation."""
DTYPES = ("<f8", "<f4", "|u1", "<i8", "<i4")
"""Element types of arrays."""

Array = npt.NDArray[Any]
_DTYPES = {name: np.dtype(name) for name in DTYPES}
_ATOMS = frozenset({type(None), bool, int, float, str, bytes})
"""Types that msgpack takes as they are: tested first, as most values of an observation are of these."""
_NESTED = (tuple, dict)
"""Types of what msgpack has read that hold others."""
_CLASSES = {name: cls for name, cls in vars(contract).items() if isinstance(cls, type) and is_dataclass(cls)}
"""All dataclasses that the contract exports, so a new sensor's output crosses the border without a row here."""


class WireError(ValueError):
    """Bytes that are not a valid message."""


def encode_frame(fields: Mapping[str, object], store: Callable[[Array], int] | None = None) -> bytes:
    """Return a request or an answer as bytes: length [4 bytes, little-endian], and a map of its fields."""
    data = cast(
        bytes, msgpack.packb({name: to_plain(field, store) for name, field in fields.items()}, use_bin_type=True)
    )
    return LENGTH.pack(len(data)) + data


def encode(message: object) -> bytes:
    """Return a value of the contract as bytes. Raises TypeError for others."""
    return cast(bytes, msgpack.packb(to_plain(message), use_bin_type=True))


def decode(data: bytes | bytearray | memoryview, load: Callable[[Array, int], None] | None = None) -> Any:
    """Return the value that `encode` has written; sequences become tuples. Raises WireError.

    load: fills an array with the values stored at an offset.
    """
    try:
        return _from_plain(msgpack.unpackb(data, raw=False, use_list=False), load)
    except (ValueError, TypeError, KeyError, OSError, msgpack.UnpackException) as error:
        raise WireError(f"not a message of {contract.CONTRACT}: {error}") from None


def to_plain(value: object, store: Callable[[Array], int] | None = None) -> Any:
    """Return a value of the contract (dataclass, mapping, tuple, array, scalar) in the types of msgpack.

    store: stores a large array elsewhere and returns its offset; None keeps all arrays in the message.
    Raises TypeError for any other value.
    """
    if type(value) in _ATOMS:
        return value
    if isinstance(value, list | tuple):
        return [item if type(item) in _ATOMS else to_plain(item, store) for item in value]
    if isinstance(value, np.ndarray):
        return _array_to_plain(value, store)
    if names := _field_names(type(value)):
        content: dict[str, Any] = {"": type(value).__name__}
        for name in names:
            item = getattr(value, name)
            content[name] = item if type(item) in _ATOMS else to_plain(item, store)
        return content
    if isinstance(value, Mapping):
        return {"": "map", "items": [(key, to_plain(item, store)) for key, item in value.items()]}
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, bool | int | float | str | bytes):  # of a class of its own, as enumerations
        return value
    raise TypeError(f"expected a value of the contract, found {type(value).__name__}")


@lru_cache(maxsize=64)
def _field_names(cls: Any) -> tuple[str, ...]:
    """Return the names of the fields of a dataclass; none for other classes."""
    return tuple(field.name for field in fields(cls)) if is_dataclass(cls) else ()


def _array_to_plain(value: Array, store: Callable[[Array], int] | None) -> Any:
    if value.ndim == 0:
        return value.item()
    array = np.ascontiguousarray(value)
    about: dict[str, Any] = {"": "array", "dtype": array.dtype.str, "shape": array.shape}
    if store is not None and array.nbytes > LARGE_BYTES:
        about["offset"] = store(array)
    else:
        about["data"] = array.tobytes()
    return about


def _from_plain(plain: Any, load: Callable[[Array, int], None] | None) -> Any:
    if isinstance(plain, tuple):
        return tuple([_from_plain(item, load) if type(item) in _NESTED else item for item in plain])
    if not isinstance(plain, dict):
        return plain
    kind = plain.pop("", None)
    if kind is None:
        return {key: _from_plain(item, load) for key, item in plain.items()}
    if kind == "array":
        return _array_from_plain(plain, load)
    if kind == "map":
        return {key: _from_plain(item, load) for key, item in plain["items"]}
    for name, item in plain.items():
        if type(item) in _NESTED:
            plain[name] = _from_plain(item, load)
    return _CLASSES[kind](**plain)


def _array_from_plain(plain: dict[str, Any], load: Callable[[Array, int], None] | None) -> Array:
    if plain["dtype"] not in DTYPES:
        raise WireError(f"expected an array of one of {DTYPES}, found {plain['dtype']!r}")
    if "data" in plain:
        return np.frombuffer(plain["data"], dtype=_DTYPES[plain["dtype"]]).reshape(plain["shape"]).copy()
    if load is None:
        raise WireError("expected no array outside the message, found one")
    array = np.empty(plain["shape"], dtype=_DTYPES[plain["dtype"]])
    load(array, plain["offset"])
    return array
