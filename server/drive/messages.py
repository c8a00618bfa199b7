"""Text messages between browser and server while people drive: JSON objects.

`{"do": ...}` goes to the server (REQUESTS), `{"is": ...}` to the browser (`DriveAnswer`).
docs/driving-protocol.md lists them for authors of other clients.
"""

import json
from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, StringConstraints, TypeAdapter, ValidationError

from mdrive_sumo.core.suggestion import describe_unknown, shorten_name
from server.drive.protocol import MAX_AGENTS, MAX_CHAT, MAX_TEXT, MAX_WHAT_IF_S, ProtocolError, dump_json


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


class PauseRequest(_Model):
    """Stop the clock for all."""

    do: Literal["pause"]


class ResumeRequest(_Model):
    """Start, or go on. The clock starts when every driver is there and has sent this."""

    do: Literal["resume"]


class FinishRequest(_Model):
    """End the take here: agents' rules for a CAV that is left apply, and the take is scored."""

    do: Literal["finish"]


class LeaveRequest(_Model):
    """Leave the session for good: as a disconnect whose minute is over."""

    do: Literal["leave"]


class RewindRequest(_Model):
    """Begin a branch of a take at a tick; the clock waits for `resume` of every driver."""

    do: Literal["rewind"]
    take: TakeNumber
    tick: Tick


class HandOverRequest(_Model):
    """Let an agent, or the person ("human"), drive a CAV from the next tick on. Drivers hand over their own CAV."""

    do: Literal["hand-over"]
    cav: Name
    to: Name


class SayRequest(_Model):
    """Send a text over the V2X channel to the other CAVs."""

    do: Literal["say"]
    text: Annotated[
        str,
        StringConstraints(strip_whitespace=True, min_length=1, max_length=MAX_CHAT),
        AfterValidator(_check_printable),
    ]


class WhatIfRequest(_Model):
    """Drive up to 32 branches from a tick by agents, shown as ghosts."""

    do: Literal["what-if"]
    take: TakeNumber
    tick: Tick
    agents: Annotated[list[Name], Field(min_length=1, max_length=MAX_AGENTS)]
    seconds: Annotated[float, Field(gt=0.0, le=MAX_WHAT_IF_S, strict=False)] = 5.0


class PingRequest(_Model):
    """Answered by `pong` with the same time at once; `latency_ms`: what the browser measured last."""

    do: Literal["ping"]
    time: Annotated[float, Field(strict=False)]
    latency_ms: Annotated[float, Field(ge=0.0, le=60_000.0, strict=False)] | None = None


DriversRequest = (
    PauseRequest
    | ResumeRequest
    | FinishRequest
    | LeaveRequest
    | RewindRequest
    | HandOverRequest
    | SayRequest
    | WhatIfRequest
)
"""What drivers may ask for, and spectators may not."""
DriveRequest = DriversRequest | PingRequest
REQUESTS: Mapping[str, type[BaseModel]] = {
    "pause": PauseRequest,
    "resume": ResumeRequest,
    "finish": FinishRequest,
    "leave": LeaveRequest,
    "rewind": RewindRequest,
    "hand-over": HandOverRequest,
    "say": SayRequest,
    "what-if": WhatIfRequest,
    "ping": PingRequest,
}
"""What a browser may ask for, by its word after `do`."""
_ADAPTERS = {word: TypeAdapter[DriveRequest](model) for word, model in REQUESTS.items()}


def decode_request(text: str) -> DriveRequest:
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


class WelcomeOut(_Model):
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
    time_limit_ticks: dict[str, int]
    """Tick at which each CAV runs out of time."""
    agents: list[str]
    """To which a person may hand over, and which `what-if` may ask."""
    cavs: list[CavOut]
    weather: str
    v2x_view: bool
    chat: bool
    may_rewind: bool
    """Also for what-if."""
    may_hand_over: bool
    """Whether an agent may take over from the receiver, and the receiver take back."""
    return_path: str = ""
    """Where the page leads once the drive has ended: the study that it is part of; "": nowhere."""
    takes: list["TakeOut"]


class DriverChangeOut(_Model):
    """A CAV has another driver from a tick on."""

    tick: int
    cav: str
    driver: str


class TakeOut(_Model):
    """A take of the tree."""

    number: int
    parent: int | None
    tick: int
    """Of the branch point; 0 for a take from the start."""
    drivers: dict[str, str]
    """CAV -> "human" or the agent that drives in that tick."""
    changes: list[DriverChangeOut] = Field(default_factory=list["DriverChangeOut"])
    """Who drove after them, in the order of ticks."""
    status: str
    """running, left, finished or void."""
    end_tick: int
    """Last tick that has been simulated."""
    left_tick: int | None = None
    """The tick in which its people left it; None: they drove it to its end, or still do."""
    score: float | None
    """Driving score, mean of the CAVs, in percent; None before it is scored."""
    ds: dict[str, float] = Field(default_factory=dict)
    """Driving score by CAV."""
    losses: dict[str, str] = Field(default_factory=dict)
    """What cost score, in words, by CAV."""
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


class GhostsOut(_Model):
    """Answer to `what-if`."""

    is_: Literal["ghosts"] = Field(default="ghosts", serialization_alias="is")
    take: int
    tick: int
    ghosts: list[GhostOut]


class ProblemOut(_Model):
    """One sentence on what was refused or went wrong; the connection goes on."""

    is_: Literal["problem"] = Field(default="problem", serialization_alias="is")
    text: str


class NoticeOut(_Model):
    """One sentence on what others did: "ego_1: its driver went back to 12.3 s"."""

    is_: Literal["notice"] = Field(default="notice", serialization_alias="is")
    text: str


class PongOut(_Model):
    """Answer to `ping`."""

    is_: Literal["pong"] = Field(default="pong", serialization_alias="is")
    time: float


class WaitingOut(_Model):
    """The clock waits for these CAVs' drivers: they are not there, or have not sent `resume`. Empty: it runs."""

    is_: Literal["waiting"] = Field(default="waiting", serialization_alias="is")
    waits_for: list[str] = Field(serialization_alias="for")
    absent: list[str]
    """Those of them that are not connected."""
    seconds: float | None = None
    """Time that is left to an absent driver to come back [s]; None: no limit."""


DriveAnswer = WelcomeOut | TreeOut | GhostsOut | ProblemOut | NoticeOut | PongOut | WaitingOut


def encode_answer(answer: DriveAnswer) -> str:
    """Return a text message for the browser."""
    return dump_json(answer.model_dump(by_alias=True, mode="json"))


def format_problem(text: str) -> str:
    """Return a text message with one sentence."""
    return encode_answer(ProblemOut(text=text))
