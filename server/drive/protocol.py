"""What browser and server say to each other while people drive: bytes of FRAME and INPUT, and JSON messages.

docs/driving-protocol.md describes the same for authors of other clients. All numbers are little-endian.

    FRAME, server -> browser, HEADER_BYTES + STATE_BYTES + rows * ROW_BYTES + extra_bytes
        u8 1, u8 state (FrameState), u16 rows, u32 tick, u32 take, u32 ack, u32 extra_bytes
        10 f64  the receiver's own vehicle state, in the world frame, NaN without a CAV (STATE_FIELDS)
        rows    road users (ROW)
        UTF-8   JSON with what is new (FrameExtra); nothing if extra_bytes is 0
    INPUT, browser -> server, INPUT_BYTES
        u8 2, u8 device (Device), u16 0, u32 number, f64 client time [ms], f32 throttle, f32 brake, f32 steer

Every text message is a JSON object: `{"do": ...}` to the server (REQUESTS), `{"is": ...}` to the browser.
"""

import json
import math
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum, IntFlag
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, StringConstraints, TypeAdapter, ValidationError

from mdrive_sumo.contract.exchange import Control
from mdrive_sumo.contract.reply_check import CONTROL_STEP
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.suggestion import describe_unknown, shorten_name

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
        *(("index", "<u2"), ("lamps", "u1"), ("flags", "u1")),
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


class Device(IntEnum):
    """With what a person drives."""

    KEYBOARD = 0
    GAMEPAD = 1
    WHEEL = 2
    TOUCH = 3
    SCRIPT = 4


class ProtocolError(InputError):
    """A message of a browser is not valid. The text is one sentence for its sender."""


@dataclass(frozen=True, slots=True)
class Input:
    """Pedals and wheel of a person at one moment."""

    device: Device
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


def encode_input(given: Input) -> bytes:
    """Return the bytes of an input, for clients in Python."""
    control = given.control
    return _INPUT.pack(
        INPUT, given.device, 0, given.number, given.client_ms, control.throttle, control.brake, control.steer
    )


def decode_input(data: bytes) -> Input:
    """Return the input in a binary message, checked as agents' replies are. Raises ProtocolError."""
    if len(data) != INPUT_BYTES:
        raise ProtocolError(f"input: expected {INPUT_BYTES} bytes, found {len(data)}")
    kind, device, zero, number, client_ms, throttle, brake, steer = _INPUT.unpack(data)
    if kind != INPUT or zero != 0:
        raise ProtocolError(f"input: expected bytes 2, device, 0, 0, found {', '.join(map(str, data[:4]))}")
    if device > max(Device):
        raise ProtocolError(f"input: device: expected 0 to {max(Device):d}, found {device}")
    if number < 1:
        raise ProtocolError("input: number: expected 1 or more, found 0")
    if not math.isfinite(client_ms):
        raise ProtocolError(f"input: time: expected milliseconds, found {client_ms}")
    control = Control(
        _check_axis("throttle", throttle, 0.0), _check_axis("brake", brake, 0.0), _check_axis("steer", steer, -1.0)
    )
    return Input(Device(device), number, client_ms, control)


def _check_axis(name: str, value: float, low: float) -> float:
    """Return the value in steps of `CONTROL_STEP`, as agents' controls."""
    if not low <= value <= 1.0:  # NaN fails too
        raise ProtocolError(f"input: {name}: expected a number in [{low:g}, 1], found {value:g}")
    return round(round(value / CONTROL_STEP) * CONTROL_STEP, 4)


def dump_json(content: object) -> str:
    """Return compact JSON without NaN and infinities."""
    return json.dumps(content, separators=(",", ":"), ensure_ascii=False, allow_nan=False)


class _Model(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


def _check_printable(text: str) -> str:
    """Return the text. Raises ValueError for line breaks, characters of control, and half of a surrogate pair."""
    if not text.isprintable():
        raise ValueError("printable characters on one line")
    return text


Tick = Annotated[int, Field(ge=0, le=2**31)]
TakeNumber = Annotated[int, Field(ge=1, le=2**31)]
Name = Annotated[str, StringConstraints(min_length=1, max_length=80)]
"""Of a CAV or an agent."""


class Pause(_Model):
    """Stop the clock for all."""

    do: Literal["pause"]


class Resume(_Model):
    """Start, or go on. The clock starts when every driver is there and has sent this."""

    do: Literal["resume"]


class Finish(_Model):
    """End the take here: agents' rules for a CAV that is left apply, and the take is scored."""

    do: Literal["finish"]


class Leave(_Model):
    """Leave the session for good: as a disconnect whose minute is over."""

    do: Literal["leave"]


class Rewind(_Model):
    """Begin a branch of a take at a tick; the clock waits for `resume` of every driver."""

    do: Literal["rewind"]
    take: TakeNumber
    tick: Tick


class HandOver(_Model):
    """Let an agent, or the person ("human"), drive a CAV from the next tick on. Drivers hand over their own CAV."""

    do: Literal["hand-over"]
    cav: Name
    to: Name


class Say(_Model):
    """Send a text over the V2X channel to the other CAVs."""

    do: Literal["say"]
    text: Annotated[
        str,
        StringConstraints(strip_whitespace=True, min_length=1, max_length=MAX_CHAT),
        AfterValidator(_check_printable),
    ]


class WhatIf(_Model):
    """Drive up to 32 branches from a tick by agents, shown as ghosts."""

    do: Literal["what-if"]
    take: TakeNumber
    tick: Tick
    agents: Annotated[list[Name], Field(min_length=1, max_length=MAX_AGENTS)]
    seconds: Annotated[float, Field(gt=0.0, le=MAX_WHAT_IF_S, strict=False)] = 5.0


class Ping(_Model):
    """Answered by `pong` with the same time at once; `latency_ms`: what the browser measured last."""

    do: Literal["ping"]
    time: Annotated[float, Field(strict=False)]
    latency_ms: Annotated[float, Field(ge=0.0, le=60_000.0, strict=False)] | None = None


Request = Pause | Resume | Finish | Leave | Rewind | HandOver | Say | WhatIf | Ping
REQUESTS: Mapping[str, type[BaseModel]] = {
    "pause": Pause,
    "resume": Resume,
    "finish": Finish,
    "leave": Leave,
    "rewind": Rewind,
    "hand-over": HandOver,
    "say": Say,
    "what-if": WhatIf,
    "ping": Ping,
}
"""What a browser may ask for, by its word after `do`."""
_ADAPTERS = {word: TypeAdapter[Request](model) for word, model in REQUESTS.items()}


def decode_request(text: str) -> Request:
    """Return what a text message asks for. Raises ProtocolError with one sentence for its sender."""
    if len(text) > MAX_TEXT:
        raise ProtocolError(f"message: expected at most {MAX_TEXT} characters, found {len(text)}")
    try:
        content = json.loads(text)
    except (ValueError, RecursionError):
        raise ProtocolError("message: expected JSON, found other text") from None
    word = content.get("do") if isinstance(content, dict) else None
    if not isinstance(word, str):
        raise ProtocolError('message: expected an object with "do", found none')
    if word not in REQUESTS:
        raise ProtocolError(f"message: do: {describe_unknown(word, REQUESTS)}")
    try:
        return _ADAPTERS[word].validate_python(content)
    except ValidationError as error:
        raise ProtocolError(_describe(word, error)) from None


_WORDS: Mapping[str, str] = {
    "missing": "a value",
    "extra_forbidden": "no such field",
    "finite_number": "a finite number",
    "string_unicode": "text",
    "too_short": "at least one",
    "string_too_short": "at least one character",
}
"""What is expected, by pydantic's type of an error."""


def _describe(word: str, error: ValidationError) -> str:
    first = error.errors(include_url=False)[0]
    place = ": ".join((word, *map(str, first["loc"])))
    kind, context = first["type"], first.get("ctx", {})
    if kind == "missing":
        return f"{place}: expected a value, found none"
    if kind == "string_too_long":
        return f"{place}: expected at most {context['max_length']} characters, found {len(first['input'])}"
    said = _WORDS.get(kind) or str(first["msg"]).removeprefix("Input should be ").removeprefix("Value error, ")
    return f"{place}: expected {said[:1].lower()}{said[1:]}, found {shorten_name(str(first['input']))}"


class CavOut(_Model):
    """A CAV of the scenario."""

    id: str
    driver: str
    """"human", or the name of an agent."""
    is_connected: bool
    """Whether its person is there; False for agents'."""


class Welcome(_Model):
    """The first message on a connection."""

    is_: Literal["welcome"] = Field(default="welcome", serialization_alias="is")
    role: Literal["driver", "spectator"]
    cav: str | None
    """The receiver's CAV; None for spectators."""
    scenario: str
    description: str
    origin: tuple[float, float]
    """World position [m] of the scene's origin; rows and all places below are relative to it, but not own states."""
    route: list[tuple[float, float]]
    """Dense points of the receiver's route (of the first CAV's for spectators) [m]."""
    routes: dict[str, list[tuple[float, float]]]
    """Of all CAVs, relative to the origin [m]."""
    speed_limits: list[float]
    """At the points of `route` [m/s]."""
    room: list[float]
    """Width of the lane at the points of `route` [m]."""
    vehicle: dict[str, float]
    """All `VehicleParameters` of CAVs, with the grip of this road."""
    pseudonyms: dict[str, str]
    """Id in V2X messages, by id of the scenario."""
    tick_s: float
    most_ticks: int
    """Tick at which the last CAV runs out of time."""
    agents: list[str]
    """To which a person may hand over, and which `what-if` may ask."""
    cavs: list[CavOut]
    weather: str
    v2x_view: bool
    chat: bool
    may_rewind: bool
    """Also for what-if."""
    takes: list["TakeOut"]


class TakeOut(_Model):
    """A take of the tree."""

    number: int
    parent: int | None
    tick: int
    """Of the branch point; 0 for a take from the start."""
    drivers: dict[str, str]
    """CAV -> "human" or the agent that drives last."""
    status: str
    """running, left, finished or void."""
    end_tick: int
    """Last tick that has been simulated."""
    score: float | None
    """Driving score, mean of the CAVs, in percent; None before it is scored."""
    ds: dict[str, float] = Field(default_factory=dict)
    """Driving score by CAV."""
    folder: str = ""
    """Run folder, relative to the drive's, for `view`, `verify` and the others."""


class TreeOut(_Model):
    """All takes, whenever one changes."""

    is_: Literal["tree"] = Field(default="tree", serialization_alias="is")
    takes: list[TakeOut]
    current: int
    """The take that goes on."""


class GhostOut(_Model):
    """What an agent would have done."""

    agent: str
    cav: str
    poses: list[tuple[float, float, float]]
    """x, y [m, relative to the origin], yaw [rad] of every tick after the branch point."""
    ending: str | None = None
    """How the CAV's drive ended within the time; None: it did not."""


class Ghosts(_Model):
    """Answer to `what-if`."""

    is_: Literal["ghosts"] = Field(default="ghosts", serialization_alias="is")
    take: int
    tick: int
    ghosts: list[GhostOut]


class ProblemOut(_Model):
    """One sentence on what was refused or went wrong; the connection goes on."""

    is_: Literal["problem"] = Field(default="problem", serialization_alias="is")
    text: str


class Notice(_Model):
    """One sentence on what others did: "ego_1: its driver went back to 12.3 s"."""

    is_: Literal["notice"] = Field(default="notice", serialization_alias="is")
    text: str


class Pong(_Model):
    """Answer to `ping`."""

    is_: Literal["pong"] = Field(default="pong", serialization_alias="is")
    time: float


class Waiting(_Model):
    """The clock waits for these CAVs' drivers: they are not there, or have not sent `resume`. Empty: it runs."""

    is_: Literal["waiting"] = Field(default="waiting", serialization_alias="is")
    waits_for: list[str] = Field(serialization_alias="for")
    absent: list[str]
    """Those of them that are not connected."""
    seconds: float | None = None
    """Time that is left to an absent driver to come back [s]; None: no limit."""


Answer = Welcome | TreeOut | Ghosts | ProblemOut | Notice | Pong | Waiting


def encode_answer(answer: Answer) -> str:
    """Return a text message for the browser."""
    return dump_json(answer.model_dump(by_alias=True, mode="json"))


def format_problem(text: str) -> str:
    """Return a text message with one sentence."""
    return encode_answer(ProblemOut(text=text))
