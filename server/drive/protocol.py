"""What browser and server say to each other while people drive: bytes of FRAME and INPUT.

docs/driving-protocol.md describes the same for authors of other clients. All numbers are little-endian.

    FRAME, server -> browser, HEADER_BYTES + STATE_BYTES + rows * ROW_BYTES + extra_bytes
        u8 1, u8 state (FrameState), u16 rows, u32 tick, u32 take, u32 ack, u32 extra_bytes
        10 f64  the receiver's own vehicle state, in the world frame, NaN without a CAV (STATE_FIELDS)
        rows    road users (ROW)
        UTF-8   JSON with what is new (FrameExtra); nothing if extra_bytes is 0
    INPUT, browser -> server, INPUT_BYTES
        u8 2, u8 device (InputDevice), u16 0, u32 number, f64 client time [ms], f32 throttle, f32 brake, f32 steer

Text messages are JSON objects: see `server.drive.messages`.
"""

import json
import math
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum, IntFlag
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mdrive_sumo.contract.exchange import Control
from mdrive_sumo.contract.reply_check import CONTROL_STEP
from mdrive_sumo.core.errors import InputError

FRAME, INPUT = 1, 2
"""First byte of a binary message."""
_HEADER = struct.Struct("<BBHIIII")
_STATE = struct.Struct("<10d")
_INPUT = struct.Struct("<BBHIdfff")
HEADER_BYTES = _HEADER.size
"""20"""
STATE_BYTES = _STATE.size
"""80"""
INPUT_BYTES = _INPUT.size
"""28"""
STATE_FIELDS = ("x", "y", "yaw", "vx", "vy", "yaw_rate", "steer_angle", "drive", "brake", "acceleration")
"""Fields of `mdrive_sumo.vehicle.dynamics.VehicleState` in the order of a frame."""
ROW = np.dtype(
    [
        *(("name", "<u2"), ("lamps", "u1"), ("flags", "u1")),
        *(("x", "<f4"), ("y", "<f4"), ("yaw", "<f4"), ("speed", "<f4")),
    ]
)
"""A road user: index in the name table, bits of `SignalLamp`, of `RowFlag`, pose relative to the scene's origin."""
ROW_BYTES = ROW.itemsize
"""20"""
NO_STATE = (math.nan,) * len(STATE_FIELDS)
"""The vehicle state in frames to spectators, and after the CAV's drive has ended."""
MAX_NAMES = 65_535
"""Road users of a session: indices have 16 bits."""
MAX_NUMBER = 2**32 - 1
"""Largest number of an input."""
MAX_TEXT = 4096
"""Characters of a text message to the server: the longest valid one has some 1 100."""
MAX_CHAT = 200
"""Characters of a chat message: two sentences. The channel counts its bytes (docs/v2x.md)."""
MAX_AGENTS = 32
"""Branches of one `what-if`."""
MAX_WHAT_IF_S = 30.0
"""Longest time that a `what-if` looks ahead [s]."""


class FrameState(IntEnum):
    """What the simulation does."""

    PAUSED = 0
    RUNNING = 1
    FINISHED = 2
    SLOW = 3
    """It runs, slower than real time: the machine cannot keep up."""


class RowFlag(IntFlag):
    """What is true of a road user."""

    BRAKING = 1
    ENDED = 2
    """A CAV whose drive has ended."""


class InputDevice(IntEnum):
    """With what a person drives."""

    KEYBOARD = 0
    GAMEPAD = 1
    WHEEL = 2
    TOUCH = 3
    SCRIPT = 4


class ProtocolError(InputError):
    """A message of a browser is not valid. The text is one sentence for its sender."""


@dataclass(frozen=True, slots=True)
class DriveInput:
    """Pedals and wheel of a person at one moment."""

    device: InputDevice
    number: int
    """1, 2, ... on each connection; frames acknowledge the one that the simulation used."""
    client_ms: float
    """Time on the browser's clock [ms]."""
    control: Control
    """In range; the simulation rounds it to `CONTROL_STEP`, as agents' replies."""


@dataclass(frozen=True, slots=True)
class WireFrame:
    """One tick as a browser gets it."""

    state: FrameState
    tick: int
    take: int
    ack: int
    """Number of the receiver's input that this tick used; 0: none yet."""
    own: Sequence[float] = NO_STATE
    """The receiver's own vehicle state (STATE_FIELDS)."""
    rows: NDArray[np.void] | None = None
    """(N,) road users of type ROW; None: none."""
    extra: Mapping[str, Any] | None = None
    """What is new, as `FrameExtra`; empty or None: nothing."""


def encode_frame(frame: WireFrame) -> bytes:
    """Return the bytes of a frame."""
    rows = b"" if frame.rows is None else frame.rows.tobytes()
    extra = dump_json(frame.extra).encode() if frame.extra else b""
    header = _HEADER.pack(FRAME, frame.state, len(rows) // ROW_BYTES, frame.tick, frame.take, frame.ack, len(extra))
    return b"".join((header, _STATE.pack(*frame.own), rows, extra))


def decode_frame(data: bytes) -> WireFrame:
    """Return the frame that a client received, for clients in Python. Raises ProtocolError."""
    if len(data) < HEADER_BYTES + STATE_BYTES:
        raise ProtocolError(f"frame: expected at least {HEADER_BYTES + STATE_BYTES} bytes, found {len(data)}")
    kind, state, count, tick, take, ack, extra_bytes = _HEADER.unpack_from(data)
    start = HEADER_BYTES + STATE_BYTES
    end = start + count * ROW_BYTES
    if kind != FRAME or len(data) != end + extra_bytes:
        raise ProtocolError(f"frame: expected type {FRAME} and {end + extra_bytes} bytes, found {kind}, {len(data)}")
    rows = np.frombuffer(data, ROW, count, start)
    extra = json.loads(data[end:]) if extra_bytes else {}
    return WireFrame(FrameState(state), tick, take, ack, _STATE.unpack_from(data, HEADER_BYTES), rows, extra)


def encode_input(given: DriveInput) -> bytes:
    """Return the bytes of an input, for clients in Python."""
    control = given.control
    return _INPUT.pack(
        INPUT, given.device, 0, given.number, given.client_ms, control.throttle, control.brake, control.steer
    )


def decode_input(data: bytes) -> DriveInput:
    """Return the input in a binary message, checked as agents' replies are. Raises ProtocolError."""
    if len(data) != INPUT_BYTES:
        raise ProtocolError(f"input: expected {INPUT_BYTES} bytes, found {len(data)}")
    kind, device, zero, number, client_ms, throttle, brake, steer = _INPUT.unpack(data)
    if kind != INPUT or zero != 0:
        raise ProtocolError(f"input: expected bytes 2, device, 0, 0, found {', '.join(map(str, data[:4]))}")
    if device > max(InputDevice):
        raise ProtocolError(f"input: device: expected 0 to {max(InputDevice):d}, found {device}")
    if number < 1:
        raise ProtocolError("input: number: expected 1 or more, found 0")
    if not math.isfinite(client_ms):
        raise ProtocolError(f"input: time: expected milliseconds, found {client_ms}")
    control = Control(
        _check_axis("throttle", throttle, 0.0), _check_axis("brake", brake, 0.0), _check_axis("steer", steer, -1.0)
    )
    return DriveInput(InputDevice(device), number, client_ms, control)


def _check_axis(name: str, value: float, low: float) -> float:
    """Return the value in steps of `CONTROL_STEP`, as agents' controls."""
    if not low <= value <= 1.0:  # NaN fails too
        raise ProtocolError(f"input: {name}: expected a number in [{low:g}, 1], found {value:g}")
    return round(round(value / CONTROL_STEP) * CONTROL_STEP, 4)


def dump_json(content: object) -> str:
    """Return compact JSON without NaN and infinities."""
    return json.dumps(content, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
