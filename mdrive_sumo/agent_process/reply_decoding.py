"""Decode the answers of an agent's process as hostile input: every value is checked before it is used.

Every answer is one msgpack map: the tick of the request, and either the value or the reason for its absence. Types are
exact (a bool is no number), all keys are known, present and unique, and the bytes of an array match its dtype and
shape.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar, cast

import msgpack
import numpy as np

from mdrive_sumo.agent_process.wire_protocol import DTYPES
from mdrive_sumo.contract import (
    MAX_MESSAGES,
    MAX_PLAN_POINTS,
    Control,
    Detections,
    Message,
    Note,
    Plan,
    Reply,
    SensorSpec,
)
from mdrive_sumo.core.private_paths import hide_paths_in_text
from mdrive_sumo.loop.agent_driver import shorten, validate_reply

T = TypeVar("T")

MAX_ITEMS = 4096
"""Items of one array: msgpack allocates as many as are declared, at every level."""
MAX_KEYS = 256
"""Keys of one map: a reply of a joint agent has one for each CAV."""
MAX_SENSORS, MAX_OPTIONS = 64, 64
"""Of a declaration, and of a sensor in it. Chosen: several times what the largest rig and a camera have."""
MAX_DIMENSIONS = 2
"""Of an array: points of a plan and boxes of detections are tables."""


class InvalidReplyError(ValueError):
    """An invalid answer; the text says what was expected and what was found."""


class AgentCrashError(Exception):
    """The answer is that the agent raised an exception; the text is the agent's."""


@dataclass(frozen=True, slots=True)
class AgentDeclaration:
    """Label and sensors that an agent declares."""

    label: str
    sensors: tuple[SensorSpec, ...]


def decode_answer(data: bytes, tick: int) -> Any:
    """Return the plain value of the answer to the request of a tick. Raises InvalidReplyError and AgentCrashError."""
    answer = _unpack(data)
    if type(answer) is not dict or len(answer) != 2 or "tick" not in answer:
        raise InvalidReplyError(f"expected a tick and a value, found {_describe_value(answer)}")
    if type(answer["tick"]) is not int or answer["tick"] != tick:
        raise InvalidReplyError(f"expected the answer of tick {tick}, found that of {answer['tick']!r:.20}")
    for kind, error in (("crashed", AgentCrashError), ("invalid", InvalidReplyError)):
        if kind in answer:
            raise error(shorten(hide_paths_in_text(_check_type(answer[kind], str, kind))))
    if "value" not in answer:
        raise InvalidReplyError(f"expected a value, found {_describe_value(answer)}")
    return answer["value"]


def read_none(value: object) -> None:
    """Check the answer to a briefing."""
    if value is not None:
        raise InvalidReplyError(f"expected no value, found {_describe_value(value)}")


def read_declaration(value: object) -> AgentDeclaration:
    """Return the answer to a creation."""
    names = ("label", "sensors")
    fields = _check_names(_read_mapping(value, "what an agent declares", len(names)), names, "what an agent declares")
    sensors = _check_list(fields["sensors"], "sensors()", MAX_SENSORS)
    return AgentDeclaration(_check_type(fields["label"], str, "label"), tuple(_read_sensor(spec) for spec in sensors))


def read_reply(value: object) -> Reply:
    """Return one CAV's checked reply; raises AgentFailure, too."""
    if value is None:
        return validate_reply(None)
    if type(value) is dict and cast("dict[str, object]", value).get("") == "map":
        return validate_reply({})  # the agent has returned a dict
    fields = _check_fields(value, "Reply", ("control", "plan", "messages", "notes", "detections"))
    return validate_reply(
        Reply(
            control=None if fields["control"] is None else _read_control(fields["control"]),
            plan=None if fields["plan"] is None else _read_plan(fields["plan"]),
            messages=tuple(_read_message(item) for item in _check_list(fields["messages"], "messages", MAX_MESSAGES)),
            notes=tuple(_read_note(item) for item in _check_list(fields["notes"], "notes", MAX_ITEMS)),
            detections=None if fields["detections"] is None else _read_detections(fields["detections"]),
        )
    )


def read_replies_by_ego(value: object, egos: tuple[str, ...]) -> Mapping[str, object]:
    """Return a joint agent's answer: the plain reply, for `read_reply`, of every CAV that was asked."""
    items = _read_mapping(value, "a reply for every CAV", len(egos))
    if items.keys() != set(egos):
        raise InvalidReplyError(f"expected replies for {', '.join(egos)}, found {_describe_value(dict(items))}")
    return items


def _unpack(data: bytes) -> Any:
    try:
        return msgpack.unpackb(
            data,
            raw=False,
            strict_map_key=True,
            object_pairs_hook=_build_distinct_map,
            ext_hook=_refuse_extension,
            max_array_len=MAX_ITEMS,
            max_map_len=MAX_KEYS,
        )
    except InvalidReplyError:
        raise
    except (ValueError, TypeError, RecursionError, MemoryError, msgpack.UnpackException) as error:
        raise InvalidReplyError(
            f"expected msgpack, found none ({shorten(str(error)) or type(error).__name__})"
        ) from None


def _build_distinct_map(pairs: list[tuple[Any, Any]]) -> dict[str, Any]:
    fields: dict[str, Any] = {}
    for key, value in pairs:
        if type(key) is not str or key in fields:
            raise InvalidReplyError(f"expected different strings as keys, found {key!r:.40} again or of another type")
        fields[key] = value
    return fields


def _refuse_extension(code: int, _: bytes) -> None:
    raise InvalidReplyError(f"expected no extension types, found type {code}")


def _read_control(value: object) -> Control:
    fields = _check_fields(value, "Control", ("throttle", "brake", "steer"))
    return Control(**{name: _check_number(number, name) for name, number in fields.items()})


def _read_plan(value: object) -> Plan:
    fields = _check_fields(value, "Plan", ("points", "interval_s", "controller"))
    interval_s = _check_number(fields["interval_s"], "interval_s")
    return Plan(_read_points(fields["points"]), interval_s, _check_type(fields["controller"], str, "controller"))


def _read_detections(value: object) -> Detections:
    fields = _check_fields(value, "Detections", ("boxes", "scores"))
    arrays = {name: _check_type(array, dict, f"detections: {name}") for name, array in fields.items()}
    return Detections(**{name: _read_array(array, f"detections: {name}") for name, array in arrays.items()})


def _read_points(value: object) -> Any:
    if type(value) is dict:
        return _read_array(cast("dict[str, object]", value), "points")
    rows = [_check_list(row, "points", MAX_DIMENSIONS) for row in _check_list(value, "points", MAX_PLAN_POINTS)]
    if any(len(row) != MAX_DIMENSIONS for row in rows):
        raise InvalidReplyError("points: expected two numbers each, found others")
    return np.array([[_check_number(number, "points") for number in row] for row in rows], dtype=np.float64).reshape(
        -1, 2
    )


def _read_array(value: dict[str, object], where: str) -> Any:
    fields = _check_fields(value, "array", ("dtype", "shape", "data"))
    dtype, data = (
        _check_type(fields["dtype"], str, f"{where}: dtype"),
        _check_type(fields["data"], bytes, f"{where}: data"),
    )
    if dtype not in DTYPES:
        raise InvalidReplyError(f"{where}: expected an array of one of {', '.join(DTYPES)}, found {dtype!r:.20}")
    shape = [
        _check_type(size, int, f"{where}: shape")
        for size in _check_list(fields["shape"], f"{where}: shape", MAX_DIMENSIONS)
    ]
    if any(size < 0 for size in shape) or math.prod(shape) * np.dtype(dtype).itemsize != len(data):
        raise InvalidReplyError(f"{where}: expected a shape of {len(data)} bytes of {dtype}, found {shape!r:.60}")
    return np.frombuffer(data, dtype=dtype).reshape(shape)


def _read_message(value: object) -> Message:
    fields = _check_fields(value, "Message", ("type", "payload", "sender", "tick"))
    _check_type(fields["sender"], str, "messages: sender")
    _check_type(fields["tick"], int, "messages: tick")
    # The channel fills in sender and tick: the values of an agent are not read.
    return Message(
        _check_type(fields["type"], str, "messages: type"), _check_type(fields["payload"], bytes, "messages: payload")
    )


def _read_note(value: object) -> Note:
    fields = _check_fields(value, "Note", ("kind", "text"))
    return Note(_check_type(fields["kind"], str, "notes: kind"), _check_type(fields["text"], str, "notes: text"))


def _read_sensor(value: object) -> SensorSpec:
    fields = _check_fields(value, "SensorSpec", ("kind", "id", "range_m", "options"))
    options = _read_mapping(fields["options"], "sensors(): options", MAX_OPTIONS)
    return SensorSpec(
        kind=_check_type(fields["kind"], str, "sensors(): kind"),
        id=_check_type(fields["id"], str, "sensors(): id"),
        range_m=_check_number(fields["range_m"], "sensors(): range_m"),
        options={name: _read_option(option, name) for name, option in options.items()},
    )


def _read_option(value: object, name: str) -> float | str | bool:
    if type(value) is bool or type(value) is str:
        return value
    return _check_number(value, f"sensors(): option {name!r:.40}")


def _check_fields(value: object, cls: str, names: tuple[str, ...]) -> dict[str, object]:
    """Return the fields of an encoded dataclass without its class name, if class and fields are as expected."""
    if type(value) is not dict or cast("dict[str, object]", value).get("") != cls:
        raise InvalidReplyError(f"expected a {cls}, found {_describe_object(value)}")
    fields = cast("dict[str, object]", value)
    return _check_names({name: field for name, field in fields.items() if name}, names, cls)


def _describe_object(value: object) -> str:
    """Return what an encoded value was in the agent: mappings and dataclasses are maps on their way."""
    name = cast("dict[str, object]", value).get("") if type(value) is dict else None
    return "dict" if name == "map" else f"{name!r:.40}" if isinstance(name, str) else _describe_value(value)


def _check_names(fields: dict[str, object], names: tuple[str, ...], what: str) -> dict[str, object]:
    if fields.keys() != set(names):
        raise InvalidReplyError(f"{what}: expected {', '.join(names)}, found {_describe_value(fields)}")
    return fields


def _read_mapping(value: object, what: str, most: int) -> dict[str, object]:
    """Return an encoded mapping, which is a list of keys and values."""
    if type(value) is not dict or value.keys() != {"", "items"} or cast("dict[str, object]", value)[""] != "map":
        raise InvalidReplyError(f"{what}: expected a mapping, found {_describe_value(value)}")
    pairs = [_check_list(pair, what, 2) for pair in _check_list(cast("dict[str, object]", value)["items"], what, most)]
    if any(len(pair) != 2 for pair in pairs):
        raise InvalidReplyError(f"{what}: expected keys with values, found others")
    return _build_distinct_map([(pair[0], pair[1]) for pair in pairs])


def _check_list(value: object, what: str, most: int) -> list[object]:
    if type(value) is not list or len(cast("list[object]", value)) > most:
        raise InvalidReplyError(f"{what}: expected a tuple of at most {most}, found {_describe_value(value)}")
    return cast("list[object]", value)


def _check_number(value: object, what: str) -> float:
    if type(value) is not float and type(value) is not int:
        raise InvalidReplyError(f"{what}: expected a number, found {_describe_value(value)}")
    return float(value)


def _check_type(value: object, kind: Callable[..., T], what: str) -> T:
    if type(value) is not kind:
        raise InvalidReplyError(f"{what}: expected {getattr(kind, '__name__', kind)}, found {_describe_value(value)}")
    return cast(T, value)


def _describe_value(value: object) -> str:
    """Return a short description of an unexpected value."""
    if type(value) is dict:
        fields = cast("dict[str, object]", value)
        name = fields.get("")
        return repr(name)[:40] if type(name) is str else f"a mapping of {shorten(', '.join(fields), 60) or 'nothing'}"
    if type(value) is list:
        return f"{len(cast('list[object]', value))} values"
    return type(value).__name__
