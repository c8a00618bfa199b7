"""Bytes of MCM; decoding has two steps as in `encoding`."""

import struct
from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from mdrive_sumo.core.compiled import twin
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.v2x.content import (
    MAX_NAME_BYTES,
    MAX_NAMES,
    MAX_POINTS,
    Direction,
    Intention,
    Mcm,
    MessageError,
    ReferencePose,
)
from mdrive_sumo.v2x.encoding import LAST_TICK, decode_points, encode_points, round_and_clamp

_MCM = struct.Struct("<hBBBI")  # speed [cm/s], intention, direction, interval [0.01 s], until [tick]
_LAST_INTENTION, _LAST_DIRECTION = max(Intention), max(Direction)
_CENTI = 100.0
"""Messages carry centimetres, hundredths of seconds and cm/s."""


class McmParts(NamedTuple):
    """The fields of an MCM body."""

    fixed: tuple[int, ...]
    planned: bytes
    desired: bytes
    requests: dict[str, int]
    answers: dict[str, int]
    group: dict[str, int]


@twin
def encode_mcm(mcm: Mcm, pose: ReferencePose, /) -> bytes:
    """Return the body of an MCM, without header; `pose` is the rounded pose that the receiver reads."""
    interval = round_and_clamp(mcm.interval_s * _CENTI, 15)
    if not 1 <= interval <= 255:
        raise MessageError(f"expected interval_s in [0.01, 2.55] s, found {mcm.interval_s}")
    if mcm.until_tick > LAST_TICK:
        raise MessageError(f"expected an until_tick up to {LAST_TICK}, found {mcm.until_tick}")
    speed = round_and_clamp(mcm.speed * _CENTI, 15)
    fixed = _MCM.pack(speed, Intention(mcm.intention), Direction(mcm.direction), interval, max(mcm.until_tick, 0))
    parts = (
        _encode_points(pose, mcm.planned),
        _encode_points(pose, mcm.desired),
        _encode_names({name: Intention(what) for name, what in mcm.requests.items()}),
        _encode_names({name: bool(yes) for name, yes in mcm.answers.items()}),
        _encode_names(dict.fromkeys(mcm.group, 0)),
    )
    return fixed + b"".join(parts)


def _encode_points(pose: ReferencePose, xy: Float) -> bytes:
    if len(xy) > MAX_POINTS:
        raise MessageError(f"expected at most {MAX_POINTS} points, found {len(xy)}")
    if (size := np.asarray(xy).size) != 2 * len(xy):
        raise MessageError(f"expected points (K, 2), found {size} numbers")
    return bytes((len(xy),)) + encode_points(pose, xy)


def _encode_names(values: Mapping[str, int]) -> bytes:
    entries = [(name.encode(), value) for name, value in values.items()]
    if len(entries) > MAX_NAMES or not all(1 <= len(name) <= MAX_NAME_BYTES for name, _ in entries):
        raise MessageError(f"expected at most {MAX_NAMES} names of 1 to {MAX_NAME_BYTES} bytes, found {len(entries)}")
    return bytes((len(entries),)) + b"".join(bytes((len(name), value)) + name for name, value in entries)


@twin
def parse_mcm(body: bytes, /) -> McmParts:
    """Return the fields of an MCM body. Raises MessageError."""
    if len(body) < _MCM.size:
        raise MessageError(f"expected at least {_MCM.size} bytes after the header, found {len(body)}")
    fixed = _MCM.unpack_from(body)
    if fixed[1] > _LAST_INTENTION or fixed[2] > _LAST_DIRECTION or not fixed[3]:
        raise MessageError(f"expected an intention, a direction and an interval above 0, found {fixed[1:4]}")
    planned, offset = _take_points(body, _MCM.size)
    desired, offset = _take_points(body, offset)
    requests, offset = _take_names(body, offset, _LAST_INTENTION)
    answers, offset = _take_names(body, offset, 1)
    group, offset = _take_names(body, offset, 0)
    if offset != len(body):
        raise MessageError(f"{len(body) - offset} bytes too many")
    return McmParts(fixed, planned, desired, requests, answers, group)


def _take_bytes(data: bytes, offset: int, size: int) -> bytes:
    if offset + size > len(data):
        raise MessageError("bytes are missing")
    return data[offset : offset + size]


def _take_points(data: bytes, offset: int) -> tuple[bytes, int]:
    """Return the bytes of the points at an offset, and the offset after them."""
    count = _take_bytes(data, offset, 1)[0]
    if count > MAX_POINTS:
        raise MessageError(f"expected at most {MAX_POINTS} points, found {count}")
    return _take_bytes(data, offset + 1, 4 * count), offset + 1 + 4 * count


def _take_names(data: bytes, offset: int, most: int) -> tuple[dict[str, int], int]:
    """Return the names with values from 0 to `most` at an offset, and the offset after them."""
    count, offset = _take_bytes(data, offset, 1)[0], offset + 1
    value_by_name: dict[str, int] = {}
    for _ in range(count):
        size, value = _take_bytes(data, offset, 2)
        if not 1 <= size <= MAX_NAME_BYTES or value > most:
            raise MessageError(f"expected names of 1 to {MAX_NAME_BYTES} bytes with values from 0 to {most}")
        value_by_name[_take_bytes(data, offset + 2, size).decode()] = value  # UnicodeDecodeError is a ValueError
        offset += 2 + size
    if len(value_by_name) < count or count > MAX_NAMES:
        raise MessageError(f"expected at most {MAX_NAMES} different names, found {count}")
    return value_by_name, offset


def build_mcm(pose: ReferencePose, parts: McmParts) -> Mcm:
    """Return the MCM of these fields."""
    speed, intention, direction, interval, until = parts.fixed
    return Mcm(
        pose=pose,
        speed=speed / _CENTI,
        intention=Intention(intention),
        direction=Direction(direction),
        interval_s=interval / _CENTI,
        planned=decode_points(pose, parts.planned),
        desired=decode_points(pose, parts.desired),
        requests=MappingProxyType({name: Intention(value) for name, value in parts.requests.items()}),
        answers=MappingProxyType({name: bool(value) for name, value in parts.answers.items()}),
        group=tuple(parts.group),
        until_tick=until,
    )
