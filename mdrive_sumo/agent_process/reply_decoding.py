"""What an agent's process answers, read as hostile input: nothing is constructed that has not been checked before.

Every answer is one msgpack map: the tick that was asked, and either what was asked for or why there is none. Types are
exact (a bool is no number), keys are known, all are there and none twice, and arrays hold what they say they hold.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar, cast

import msgpack
import numpy as np

from mdrive_sumo.agent_process.wire_protocol import DTYPES
from mdrive_sumo.contract import MAX_MESSAGES, MAX_PLAN_POINTS, Control, Message, Note, Plan, Reply, SensorSpec
from mdrive_sumo.loop.agent_driver import shorten, validate_reply

T = TypeVar("T")

MAX_ITEMS = 4096
"""Of one array; msgpack makes room for as many as are declared, at every level."""
MAX_KEYS = 256
MAX_SENSORS = 64
MAX_OPTIONS = 64
MAX_DIMENSIONS = 2


class InvalidReplyError(ValueError):
    """An answer that is none; the text says what was expected and what was found."""


class AgentCrashError(Exception):
    """The answer is that the agent raised an exception; the text is the agent's."""


@dataclass(frozen=True, slots=True)
class AgentDeclaration:
    """What an agent says of itself."""

    label: str
    sensors: tuple[SensorSpec, ...]


def decode_answer(data: bytes, tick: int) -> Any:
    """The plain value of the answer to the request of a tick. Raises InvalidReplyError and AgentCrashError."""
    answer = _unpacked(data)
    if type(answer) is not dict or len(answer) != 2 or "tick" not in answer:
        raise InvalidReplyError(f"expected a tick and a value, found {_named(answer)}")
    if type(answer["tick"]) is not int or answer["tick"] != tick:
        raise InvalidReplyError(f"expected the answer of tick {tick}, found that of {answer['tick']!r:.20}")
    for kind, error in (("crashed", AgentCrashError), ("invalid", InvalidReplyError)):
        if kind in answer:
            raise error(shorten(_typed(answer[kind], str, kind)))
    if "value" not in answer:
        raise InvalidReplyError(f"expected a value, found {_named(answer)}")
    return answer["value"]


def read_none(value: object) -> None:
    """The answer to a briefing."""
    if value is not None:
        raise InvalidReplyError(f"expected no value, found {_named(value)}")


def read_declaration(value: object) -> AgentDeclaration:
    """The answer to a creation."""
    names = ("label", "sensors")
    fields = _exactly(_pairs(value, "what an agent declares", len(names)), names, "what an agent declares")
    sensors = _listed(fields["sensors"], "sensors()", MAX_SENSORS)
    return AgentDeclaration(_typed(fields["label"], str, "label"), tuple(_sensor(spec) for spec in sensors))


def read_reply(value: object) -> Reply:
    """One CAV's reply, checked; raises AgentFailure too."""
    if value is None:
        return validate_reply(None)
    fields = _keys(value, "Reply", ("control", "plan", "messages", "notes"))
    return validate_reply(
        Reply(
            control=None if fields["control"] is None else _control(fields["control"]),
            plan=None if fields["plan"] is None else _plan(fields["plan"]),
            messages=tuple(_message(item) for item in _listed(fields["messages"], "messages", MAX_MESSAGES)),
            notes=tuple(_note(item) for item in _listed(fields["notes"], "notes", MAX_ITEMS)),
        )
    )


def read_replies_by_ego(value: object, egos: tuple[str, ...]) -> Mapping[str, object]:
    """A joint agent's answer: for every CAV that was asked one plain value, for `reply`."""
    items = _pairs(value, "a reply for every CAV", len(egos))
    if items.keys() != set(egos):
        raise InvalidReplyError(f"expected replies for {', '.join(egos)}, found {_named(dict(items))}")
    return items


def _unpacked(data: bytes) -> Any:
    try:
        return msgpack.unpackb(
            data,
            raw=False,
            strict_map_key=True,
            object_pairs_hook=_distinct,
            ext_hook=_no_extension,
            max_array_len=MAX_ITEMS,
            max_map_len=MAX_KEYS,
        )
    except InvalidReplyError:
        raise
    except (ValueError, TypeError, RecursionError, MemoryError, msgpack.UnpackException) as error:
        raise InvalidReplyError(
            f"expected msgpack, found none ({shorten(str(error)) or type(error).__name__})"
        ) from None


def _distinct(pairs: list[tuple[Any, Any]]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for key, value in pairs:
        if type(key) is not str or key in found:
            raise InvalidReplyError(f"expected different strings as keys, found {key!r:.40} again or of another type")
        found[key] = value
    return found


def _no_extension(code: int, _: bytes) -> None:
    raise InvalidReplyError(f"expected no extension types, found type {code}")


def _control(value: object) -> Control:
    fields = _keys(value, "Control", ("throttle", "brake", "steer"))
    return Control(**{name: _number(number, name) for name, number in fields.items()})


def _plan(value: object) -> Plan:
    fields = _keys(value, "Plan", ("points", "interval_s", "controller"))
    interval_s = _number(fields["interval_s"], "interval_s")
    return Plan(_points(fields["points"]), interval_s, _typed(fields["controller"], str, "controller"))


def _points(value: object) -> Any:
    if type(value) is dict:
        return _array(cast("dict[str, object]", value), "points")
    rows = [_listed(row, "points", MAX_DIMENSIONS) for row in _listed(value, "points", MAX_PLAN_POINTS)]
    if any(len(row) != MAX_DIMENSIONS for row in rows):
        raise InvalidReplyError("points: expected two numbers each, found others")
    return np.array([[_number(number, "points") for number in row] for row in rows], dtype=np.float64).reshape(-1, 2)


def _array(value: dict[str, object], where: str) -> Any:
    fields = _keys(value, "array", ("dtype", "shape", "data"))
    dtype, data = _typed(fields["dtype"], str, f"{where}: dtype"), _typed(fields["data"], bytes, f"{where}: data")
    if dtype not in DTYPES:
        raise InvalidReplyError(f"{where}: expected an array of one of {', '.join(DTYPES)}, found {dtype!r:.20}")
    shape = [
        _typed(size, int, f"{where}: shape") for size in _listed(fields["shape"], f"{where}: shape", MAX_DIMENSIONS)
    ]
    if any(size < 0 for size in shape) or math.prod(shape) * np.dtype(dtype).itemsize != len(data):
        raise InvalidReplyError(f"{where}: expected a shape of {len(data)} bytes of {dtype}, found {shape!r:.60}")
    return np.frombuffer(data, dtype=dtype).reshape(shape)


def _message(value: object) -> Message:
    fields = _keys(value, "Message", ("type", "payload", "sender", "tick"))
    _typed(fields["sender"], str, "messages: sender")
    _typed(fields["tick"], int, "messages: tick")
    # Sender and tick are the channel's to fill in: what an agent puts there is not even read.
    return Message(_typed(fields["type"], str, "messages: type"), _typed(fields["payload"], bytes, "messages: payload"))


def _note(value: object) -> Note:
    fields = _keys(value, "Note", ("kind", "text"))
    return Note(_typed(fields["kind"], str, "notes: kind"), _typed(fields["text"], str, "notes: text"))


def _sensor(value: object) -> SensorSpec:
    fields = _keys(value, "SensorSpec", ("kind", "id", "range_m", "options"))
    options = _pairs(fields["options"], "sensors(): options", MAX_OPTIONS)
    return SensorSpec(
        kind=_typed(fields["kind"], str, "sensors(): kind"),
        id=_typed(fields["id"], str, "sensors(): id"),
        range_m=_number(fields["range_m"], "sensors(): range_m"),
        options={name: _option(option, name) for name, option in options.items()},
    )


def _option(value: object, name: str) -> float | str | bool:
    if type(value) is bool or type(value) is str:
        return value
    return _number(value, f"sensors(): option {name!r:.40}")


def _keys(value: object, cls: str, names: tuple[str, ...]) -> dict[str, object]:
    """The fields of what says to be of a class, if they are these; without the name of the class."""
    if type(value) is not dict or cast("dict[str, object]", value).get("") != cls:
        raise InvalidReplyError(f"expected a {cls}, found {_named(value)}")
    fields = cast("dict[str, object]", value)
    return _exactly({name: field for name, field in fields.items() if name}, names, cls)


def _exactly(fields: dict[str, object], names: tuple[str, ...], what: str) -> dict[str, object]:
    if fields.keys() != set(names):
        raise InvalidReplyError(f"{what}: expected {', '.join(names)}, found {_named(fields)}")
    return fields


def _pairs(value: object, what: str, most: int) -> dict[str, object]:
    """A mapping as it travels: a list of keys and values."""
    if type(value) is not dict or value.keys() != {"", "items"} or cast("dict[str, object]", value)[""] != "map":
        raise InvalidReplyError(f"{what}: expected a mapping, found {_named(value)}")
    pairs = [_listed(pair, what, 2) for pair in _listed(cast("dict[str, object]", value)["items"], what, most)]
    if any(len(pair) != 2 for pair in pairs):
        raise InvalidReplyError(f"{what}: expected keys with values, found others")
    return _distinct([(pair[0], pair[1]) for pair in pairs])


def _listed(value: object, what: str, most: int) -> list[object]:
    if type(value) is not list or len(cast("list[object]", value)) > most:
        raise InvalidReplyError(f"{what}: expected a tuple of at most {most}, found {_named(value)}")
    return cast("list[object]", value)


def _number(value: object, what: str) -> float:
    if type(value) is not float and type(value) is not int:
        raise InvalidReplyError(f"{what}: expected a number, found {_named(value)}")
    return float(value)


def _typed(value: object, kind: Callable[..., T], what: str) -> T:
    if type(value) is not kind:
        raise InvalidReplyError(f"{what}: expected {getattr(kind, '__name__', kind)}, found {_named(value)}")
    return cast(T, value)


def _named(value: object) -> str:
    """What to call something that was not expected: short, whatever it is."""
    if type(value) is dict:
        fields = cast("dict[str, object]", value)
        name = fields.get("")
        return repr(name)[:40] if type(name) is str else f"a mapping of {shorten(', '.join(fields), 60) or 'nothing'}"
    if type(value) is list:
        return f"{len(cast('list[object]', value))} values"
    return type(value).__name__
