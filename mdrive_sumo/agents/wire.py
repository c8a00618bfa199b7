"""The contract as bytes: msgpack, dataclasses by name, arrays as (dtype, shape, bytes). Never a pickle."""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any, cast

import msgpack
import numpy as np

from mdrive_sumo import contract

MAX_BYTES = 64 * 2**20
"""Longest frame that is read [bytes]."""
_CLASSES = {
    cls.__name__: cls
    for cls in (
        contract.Briefing, contract.Control, contract.Gnss, contract.Imu, contract.Message, contract.Note,
        contract.Objects, contract.Observation, contract.OwnState, contract.Plan, contract.PointCloud,
        contract.Privileged, contract.Raster, contract.Reply, contract.SensorSpec, contract.StopSign,
        contract.TrafficLight, contract.VehicleFacts,
    )
}  # fmt: skip
_DTYPES = ("<f8", "<f4", "|u1", "<i8", "<i4")


class WireError(ValueError):
    """Bytes that are no message of ours."""


def packed(message: object) -> bytes:
    """Any value of the contract (dataclasses, mappings, tuples, arrays, scalars) as bytes; TypeError for others."""
    return cast(bytes, msgpack.packb(_plain(message), use_bin_type=True))


def unpacked(data: bytes) -> Any:
    """The inverse of `packed`; tuples come back as tuples. Raises WireError."""
    try:
        return _value(msgpack.unpackb(data, raw=False, use_list=False))
    except (ValueError, TypeError, KeyError, msgpack.UnpackException) as error:
        raise WireError(f"not a message of {contract.CONTRACT}: {error}") from None


def _plain(value: object) -> Any:
    if isinstance(value, np.ndarray):
        array = np.ascontiguousarray(value)
        return {"": "array", "dtype": array.dtype.str, "shape": array.shape, "data": array.tobytes()}
    if isinstance(value, np.generic):
        return value.item()
    if is_dataclass(value) and not isinstance(value, type):
        content = {f.name: _plain(getattr(value, f.name)) for f in fields(value)}
        return {"": type(value).__name__, **content}
    if isinstance(value, Mapping):
        return {"": "map", "items": [(key, _plain(item)) for key, item in value.items()]}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if value is None or isinstance(value, bool | int | float | str | bytes):
        return value
    raise TypeError(f"expected a value of the contract, found {type(value).__name__}")


def _value(plain: Any) -> Any:
    if isinstance(plain, tuple):
        return tuple(_value(item) for item in plain)
    if not isinstance(plain, dict):
        return plain
    kind = plain.pop("")
    if kind == "array":
        return _array(plain["dtype"], plain["shape"], plain["data"])
    if kind == "map":
        return {key: _value(item) for key, item in plain["items"]}
    return _CLASSES[kind](**{name: _value(item) for name, item in plain.items()})


def _array(dtype: str, shape: tuple[int, ...], data: bytes) -> Any:
    if dtype not in _DTYPES:
        raise WireError(f"expected an array of one of {_DTYPES}, found {dtype!r}")
    return np.frombuffer(data, dtype=np.dtype(dtype)).reshape(shape).copy()
