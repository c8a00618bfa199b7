"""Bytes of the header, CAM and CPM; `mcm_encoding` has those of MCM. docs/v2x.md has the tables; little-endian.

Decoding has two steps: `parse_*` splits a body and raises MessageError unless every byte is valid, without arrays, so
that the channel can check every message cheaply; `build_*` converts the parts to contents and cannot fail.
"""

import math
import struct
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from mdrive_sumo.contract import Objects
from mdrive_sumo.core import portable
from mdrive_sumo.core.compiled import twin
from mdrive_sumo.core.geometry import TAU, Float
from mdrive_sumo.core.state import Kind
from mdrive_sumo.v2x.content import (
    MAX_OBJECTS,
    MAX_PATH_POINTS,
    MAX_PLACE_M,
    MAX_SECTORS,
    MESSAGE_REACH_M,
    Cam,
    Cpm,
    MessageError,
    ReferencePose,
    format_track_name,
    parse_track_name,
)

_HEADER = struct.Struct("<BiiHIHB")  # kind, x, y [cm], yaw [0.01 deg], tick, sigmas of position [cm], yaw [0.1 deg]
_CAM = struct.Struct("<hhhHHB")  # speed [cm/s], acceleration [cm/s2], yaw rate [mrad/s], length, width [cm], sigma
_CPM = struct.Struct("<HBBB")  # range [dm], objects, sectors, 1 for a road-side unit
_OBJECT = np.dtype(
    [("track", "<u4"), ("kind", "u1"), ("xy", "<i2", 2), ("yaw", "<u2"), ("speed", "<i2"), ("size", "<u2", 2),
     ("age", "u1"), ("sigmas", "u1", 3)]
)  # fmt: skip
_POINT_BYTES = 4
_KIND_AT = 4
"""Offset of the kind in `_OBJECT`."""
_LAST_KIND = max(Kind)
_CENTI = 100.0
"""Messages carry centimetres, hundredths of degrees and cm/s."""
_SIGMA_STEPS = np.array((100.0, math.degrees(10.0), 100.0))
"""Steps in 1 m, 1 rad and 1 m/s of the standard deviations of an object."""
HEADER_BYTES = _HEADER.size
CPM_BYTES = _CPM.size
"""Of a CPM without objects and free sight, after the header."""
OBJECT_BYTES = _OBJECT.itemsize
"""Of an object in a CPM."""
LAST_TICK = 2**32 - 1
"""Of a tick in a message: 4 bytes."""


@twin
def encode_header(kind: int, pose: ReferencePose, /) -> bytes:
    """Return the header of every message but text. Positions are clamped to 21 475 km from the origin.

    Raises MessageError for numbers that are not finite, and ticks that do not fit.
    """
    if not 0 <= pose.tick <= LAST_TICK:
        raise MessageError(f"expected a tick from 0 to {LAST_TICK}, found {pose.tick}")
    yaw = round(math.degrees(pose.yaw % TAU) * _CENTI) % 36000
    return _HEADER.pack(
        kind,
        round_and_clamp(pose.x * _CENTI, 31),
        round_and_clamp(pose.y * _CENTI, 31),
        yaw,
        pose.tick,
        max(round_and_clamp(pose.position_sigma * _CENTI, 16), 0),
        max(round_and_clamp(math.degrees(pose.yaw_sigma) * 10, 8), 0),
    )


@twin
def decode_pose(payload: bytes, /) -> ReferencePose:
    """Return the reference pose in a payload of at least `HEADER_BYTES`."""
    _, x, y, yaw, tick, position_sigma, yaw_sigma = _HEADER.unpack_from(payload)
    sigmas = position_sigma / _CENTI, math.radians(yaw_sigma / 10)
    return ReferencePose(x / _CENTI, y / _CENTI, math.radians(yaw / _CENTI), tick, *sigmas)


def check_place(payload: bytes) -> None:
    """Raise MessageError if the reference pose in a payload of at least `HEADER_BYTES` is beyond `MAX_PLACE_M`."""
    _, x, y, *_ = _HEADER.unpack_from(payload)
    if max(abs(x), abs(y)) > MAX_PLACE_M * _CENTI:
        raise MessageError(f"expected a position within {MAX_PLACE_M / 1000:g} km of the origin")


def round_and_clamp(value: float, bits: int) -> int:
    """Return the value rounded and clamped to +-(2**bits - 1). Raises MessageError if it is not finite."""
    if not math.isfinite(value):
        raise MessageError(f"expected finite numbers, found {value}")
    most = 2**bits - 1
    return min(max(round(value), -most), most)


def _rotate(xy: Float, yaw: float) -> Float:
    cos, sin = portable.cos_sin(yaw)
    return np.column_stack((xy[:, 0] * cos - xy[:, 1] * sin, xy[:, 0] * sin + xy[:, 1] * cos))


@twin
def encode_points(pose: ReferencePose, xy: Float, /) -> bytes:
    """Return places (N, 2) ahead and to the left of the pose [cm]. Raises MessageError if one is too far away."""
    local = _rotate(np.asarray(xy, dtype=np.float64).reshape(-1, 2) - (pose.x, pose.y), -pose.yaw)
    if not (np.abs(local) <= MESSAGE_REACH_M).all():  # NaN fails too
        raise MessageError(f"expected positions within {MESSAGE_REACH_M} m of the sender, along and across")
    return np.rint(local * _CENTI).astype("<i2").tobytes()


@twin
def decode_points(pose: ReferencePose, data: bytes, /) -> Float:
    """Return the places (N, 2) [m] in the world frame: the inverse of `encode_points`."""
    local = np.frombuffer(data, dtype="<i2").reshape(-1, 2)
    return _rotate(local / _CENTI, pose.yaw) + np.array((pose.x, pose.y))


def encode_cam(cam: Cam, pose: ReferencePose) -> bytes:
    """Return the body of a CAM, without header; `pose` is the rounded pose that the receiver reads."""
    path = cam.path_history
    if path is None:
        return encode_high_frequency(cam, pose)
    if len(path) > MAX_PATH_POINTS:
        raise MessageError(f"expected at most {MAX_PATH_POINTS} points of the path history, found {len(path)}")
    return encode_high_frequency(cam, pose) + bytes((len(path),)) + encode_points(pose, path)


@twin
def encode_high_frequency(cam: Cam, _: ReferencePose, /) -> bytes:
    """Return the high-frequency container of a CAM, which every CAM has."""
    signed = (cam.speed * _CENTI, cam.acceleration * _CENTI, cam.yaw_rate * 1000)
    size = (cam.length * _CENTI, cam.width * _CENTI)
    return _CAM.pack(
        *(round_and_clamp(value, 15) for value in signed),
        *(max(round_and_clamp(value, 16), 0) for value in size),
        max(round_and_clamp(cam.speed_sigma * _CENTI, 8), 0),
    )


class CamParts(NamedTuple):
    """The fields of a CAM body."""

    numbers: tuple[int, ...]
    path: bytes | None
    """None: it has no low-frequency container."""


def parse_cam(body: bytes) -> CamParts:
    """Return the fields of a CAM body. Raises MessageError."""
    size = _CAM.size
    if len(body) == size:
        return CamParts(_CAM.unpack(body), None)
    count = body[size] if len(body) > size else 0
    if count > MAX_PATH_POINTS or len(body) != size + 1 + _POINT_BYTES * count:
        raise MessageError(
            f"expected {size} bytes after the header, or {size + 1} and {_POINT_BYTES} for each point of the path"
            f" history, found {len(body)}"
        )
    return CamParts(_CAM.unpack_from(body), body[size + 1 :])


def build_cam(pose: ReferencePose, parts: CamParts) -> Cam:
    """Return the CAM of these fields."""
    speed, acceleration, yaw_rate, length, width, sigma = parts.numbers
    path = None if parts.path is None else decode_points(pose, parts.path)
    return Cam(
        pose, speed / _CENTI, acceleration / _CENTI, yaw_rate / 1000, length / _CENTI, width / _CENTI, sigma / _CENTI,
        path,
    )  # fmt: skip


class CpmParts(NamedTuple):
    """The fields of a CPM body."""

    range_dm: int
    roadside: bool
    rows: bytes
    free: bytes


@twin
def encode_cpm(cpm: Cpm, pose: ReferencePose, /) -> bytes:
    """Return the body of a CPM, without header; `pose` is the rounded pose that the receiver reads."""
    objects, count, sectors = cpm.objects, len(cpm.objects.ids), len(cpm.objects.free_m)
    if count > MAX_OBJECTS or sectors > MAX_SECTORS:
        raise MessageError(
            f"expected at most {MAX_OBJECTS} objects and {MAX_SECTORS} sectors, found {count} and {sectors}"
        )
    range_dm = max(round_and_clamp(cpm.range_m * 10, 16), 0)
    head = _CPM.pack(range_dm, count, sectors, bool(cpm.roadside))
    return head + _encode_objects(cpm, pose).tobytes() + _encode_free_sight(objects.free_m, range_dm)


def _encode_objects(cpm: Cpm, pose: ReferencePose) -> npt.NDArray[np.void]:
    objects = cpm.objects
    numbers = np.column_stack((objects.yaw - pose.yaw, objects.speed, objects.length, objects.width))
    if not np.isfinite(numbers).all():
        raise MessageError("expected finite numbers")
    if (np.asarray(objects.kind) > _LAST_KIND).any():
        raise MessageError(f"expected kinds from 0 to {_LAST_KIND}")
    if len(cpm.age) != len(objects.ids):
        raise MessageError(f"expected an age for each of {len(objects.ids)} objects, found {len(cpm.age)}")
    rows = np.zeros(len(objects.ids), dtype=_OBJECT)
    rows["track"] = [parse_track_name(name) for name in objects.ids]
    rows["kind"], rows["age"] = objects.kind, np.clip(cpm.age, 0, 255)
    places = encode_points(pose, np.column_stack((objects.x, objects.y)))
    rows["xy"] = np.frombuffer(places, dtype="<i2").reshape(-1, 2)
    rows["yaw"] = np.rint(np.degrees(numbers[:, 0] % TAU) * _CENTI) % 36000
    rows["speed"] = np.clip(np.rint(objects.speed * _CENTI), -32767, 32767)
    rows["size"] = np.clip(np.rint(numbers[:, 2:] * _CENTI), 0, 65535)
    if len(cpm.sigmas):
        rows["sigmas"] = _encode_sigmas(cpm.sigmas, len(rows))
    return rows


def _encode_sigmas(sigmas: Float, count: int) -> npt.NDArray[np.uint8]:
    """Return standard deviations (N, 3) in steps of 1 cm, 0.1 degrees and 1 cm/s; 255 stands for larger ones too."""
    if sigmas.shape != (count, 3) or not np.isfinite(sigmas).all():
        raise MessageError(f"expected finite standard deviations of shape ({count}, 3), found {sigmas.size} numbers")
    return np.clip(np.rint(sigmas * _SIGMA_STEPS), 0, 255).astype(np.uint8)


def _encode_free_sight(free_m: Float, range_dm: int) -> bytes:
    """Return free sight in 255 steps, rounded down, so that a message never claims more than its sender saw."""
    if not np.isfinite(free_m).all():
        raise MessageError("expected finite numbers")
    steps = np.clip(free_m * 10 / max(range_dm, 1), 0, 1) * 255
    return np.floor(steps + 1e-6).astype(np.uint8).tobytes()  # the slack makes encoding of decoded values exact


@twin
def parse_cpm(body: bytes, /) -> CpmParts:
    """Return the fields of a CPM body. Raises MessageError."""
    if len(body) < _CPM.size:
        raise MessageError(f"expected at least {_CPM.size} bytes after the header, found {len(body)}")
    range_dm, count, sectors, roadside = _CPM.unpack_from(body)
    end = _CPM.size + count * _OBJECT.itemsize
    if len(body) != end + sectors:
        raise MessageError(f"expected {end + sectors} bytes after the header, found {len(body)}")
    if max(body[_CPM.size + _KIND_AT : end : _OBJECT.itemsize], default=0) > _LAST_KIND or roadside > 1:
        raise MessageError(f"expected kinds from 0 to {_LAST_KIND}, and 0 or 1 for a road-side unit")
    return CpmParts(range_dm, bool(roadside), body[_CPM.size : end], body[end:])


@twin
def build_cpm(pose: ReferencePose, parts: CpmParts, /) -> Cpm:
    """Return the CPM of these fields."""
    rows = np.frombuffer(parts.rows, dtype=_OBJECT)
    xy = decode_points(pose, rows["xy"].tobytes())
    objects = Objects(
        ids=tuple(format_track_name(number) for number in rows["track"].tolist()),
        kind=rows["kind"].copy(),
        x=xy[:, 0].copy(),
        y=xy[:, 1].copy(),
        yaw=np.radians(rows["yaw"] / _CENTI) + pose.yaw,
        speed=rows["speed"] / _CENTI,
        length=rows["size"][:, 0] / _CENTI,
        width=rows["size"][:, 1] / _CENTI,
        free_m=np.frombuffer(parts.free, dtype=np.uint8) / 255 * (parts.range_dm / 10),
    )
    return Cpm(pose, parts.range_dm / 10, objects, rows["age"].copy(), parts.roadside, rows["sigmas"] / _SIGMA_STEPS)
