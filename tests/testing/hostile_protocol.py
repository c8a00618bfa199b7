"""Agents that abuse the protocol, and what becomes of each: one table, for tests with and without boxes and servers.

`ANSWERS` are bytes sent instead of an answer; `DEEDS` do something else with the line. `write_agent` makes a working
agent file of either: it drives well until its tick, then misbehaves.
"""

import pickle
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgpack

from mdrive_sumo.core.state import FailureReason

GOOD: Mapping[str, Any] = {
    "": "Reply",
    "control": {"": "Control", "throttle": 0.25, "brake": 0.0, "steer": 0.1},
    "plan": None,
    "messages": [],
    "notes": [],
    "detections": None,
}
LATE = 3
"""The tick in which a hostile agent misbehaves."""


@dataclass(frozen=True, slots=True)
class Case:
    """Expected: how the CAV fails and how the text begins; no failure is None."""

    failure: FailureReason | None
    text: str
    data: Callable[[int], bytes] | None = None
    """The bytes of the answer in that tick."""
    deed: str = ""
    """Python, with line (the socket), tick, GOOD and `frame(bytes)`, `answer(tick, value)`."""
    tick_s: float = 30.0


def packed(value: object) -> bytes:
    """msgpack."""
    data = msgpack.packb(value)
    assert isinstance(data, bytes)
    return data


def answer(tick: int, value: object) -> bytes:
    """An answer as it should be."""
    return packed({"tick": tick, "value": value})


def _with(**fields: object) -> Callable[[int], bytes]:
    """A good reply but for these fields."""
    return lambda tick: answer(tick, {**GOOD, **fields})


def _control(value: object) -> Callable[[int], bytes]:
    return _with(control={"": "Control", "throttle": value, "brake": 0.0, "steer": 0.0})


def _points(value: object) -> Callable[[int], bytes]:
    plan = {"": "Plan", "points": value, "interval_s": 0.2, "controller": "tracker"}
    return _with(control=None, plan=plan)


def _array(dtype: str, shape: list[int], data: object) -> Callable[[int], bytes]:
    return _points({"": "array", "dtype": dtype, "shape": shape, "data": data})


def _message(**fields: object) -> Callable[[int], bytes]:
    return _with(messages=[{"": "Message", "type": "cam", "payload": b"hello", "sender": "", "tick": 0, **fields}])


def _raw(data: bytes) -> Callable[[int], bytes]:
    return lambda _: data


def _invalid(text: str, data: Callable[[int], bytes]) -> Case:
    return Case(FailureReason.INVALID, text, data)


NAN, INFINITY = float("nan"), float("inf")
RANGE = "throttle: expected a number in [0, 1], found"

ANSWERS: Mapping[str, Case] = {
    "malformed": _invalid("act: expected", _raw(pickle.dumps(GOOD))),
    "not-a-map": _invalid("act: expected a tick and a value, found 2 values", _raw(packed([1, 2]))),
    "deep": _invalid("act: expected msgpack, found none", _raw(b"\x91" * 60_000)),
    "deep-maps": _invalid("act: expected msgpack, found none", _raw(b"\x81\xa0" * 30_000)),
    "deep-and-wide": _invalid("act: expected msgpack, found none", _raw(b"\xdc\x0f\xff" * 20_000)),
    "long-array": _invalid("act: expected msgpack, found none", _raw(b"\xdd\xff\xff\xff\xff")),
    "long-map": _invalid("act: expected msgpack, found none", _raw(b"\xdf\xff\xff\xff\xff")),
    "long-string": _invalid("act: expected msgpack, found none", _raw(b"\xdb\xff\xff\xff\xffabc")),
    "long-bytes": _invalid("act: expected msgpack, found none", _raw(b"\xc6\xff\xff\xff\xffabc")),
    "reserved": _invalid("act: expected msgpack, found none", _raw(b"\xc1")),
    "truncated": _invalid("act: expected msgpack, found none", lambda tick: answer(tick, GOOD)[:-3]),
    "trailing": _invalid("act: expected msgpack, found none", lambda tick: answer(tick, GOOD) + b"\x00"),
    "no-utf8": _invalid("act: expected msgpack, found none", _raw(b"\x81\xa2\xff\xfe\x01")),
    "integer-key": _invalid("act: expected msgpack, found none", _raw(b"\x81\x01\x02")),
    "bytes-key": _invalid("act: expected different strings as keys", _raw(b"\x81\xc4\x01a\x02")),
    "double-key": _invalid(
        "act: expected different strings as keys",
        lambda tick: b"\x83\xa4tick" + packed(tick) + b"\xa4tick" + packed(tick) + b"\xa5value" + packed(GOOD),
    ),
    "extension": _invalid("act: expected no extension types, found type 5", _raw(b"\x81\xa4tick\xd4\x05\x00")),
    "timestamp": _invalid("act: ", lambda tick: b"\x82\xa4tick" + packed(tick) + b"\xa5value\xd6\xff\x00\x00\x00\x00"),
    "stale": _invalid("act: expected the answer of tick", lambda tick: answer(tick - 1, GOOD)),
    "future": _invalid("act: expected the answer of tick", lambda tick: answer(tick + 1, GOOD)),
    "no-tick": _invalid("act: expected a tick and a value", _raw(packed({"value": GOOD}))),
    "float-tick": _invalid(
        "act: expected the answer of tick", lambda tick: packed({"tick": tick * 1.0, "value": GOOD})
    ),
    "text-tick": _invalid("act: expected the answer of tick", lambda tick: packed({"tick": str(tick), "value": GOOD})),
    "result": _invalid(
        "act: expected a tick and a value",
        lambda tick: packed({"tick": tick, "value": GOOD, "driving_score": 100.0, "status": "ok"}),
    ),
    "result-inside": _invalid("act: Reply: expected control, plan", _with(driving_score=100.0)),
    "result-instead": _invalid("act: expected a Reply", lambda tick: answer(tick, {"": "ScenarioResult", "ds": 100.0})),
    "another-class": _invalid("act: expected a Reply", lambda tick: answer(tick, {**GOOD, "": "Observation"})),
    "no-class": _invalid("act: expected a Reply", lambda tick: answer(tick, {"control": GOOD["control"]})),
    "missing": _invalid("act: Reply: expected control, plan", lambda tick: answer(tick, {"": "Reply", "plan": None})),
    "nothing": _invalid("expected a Reply, found NoneType", lambda tick: answer(tick, None)),
    "neither": _invalid("expected either a control or a plan, found neither", _with(control=None)),
    "nan": _invalid(RANGE, _control(NAN)),
    "infinity": _invalid(RANGE, _control(INFINITY)),
    "big-integer": _invalid(RANGE, _control(2**64 - 1)),
    "negative": _invalid(RANGE, _control(-(2**63))),
    "boolean": _invalid("act: throttle: expected a number, found bool", _control(True)),
    "string": _invalid("act: throttle: expected a number, found str", _control("0.5")),
    "list": _invalid("act: throttle: expected a number, found 1 values", _control([0.5])),
    "object-array": _invalid("act: points: expected an array of one of", _array("|O", [1, 2], b"\0" * 16)),
    "complex-array": _invalid("act: points: expected an array of one of", _array("<c16", [1, 2], b"\0" * 32)),
    "short-array": _invalid("act: points: expected a shape of 8 bytes", _array("<f8", [1, 2], b"\0" * 8)),
    "negative-shape": _invalid("act: points: expected a shape", _array("<f8", [-1, -2], b"\0" * 16)),
    "overflowing-shape": _invalid("act: points: expected a shape", _array("<f8", [2**62, 2**63], b"\0" * 16)),
    "boolean-shape": _invalid("act: points: shape: expected int", _array("<f8", [True, 2], b"\0" * 16)),
    "many-dimensions": _invalid(
        "act: points: shape: expected a tuple of at most 2", _array("<f8", [1] * 40, b"\0" * 8)
    ),
    "array-of-text": _invalid("act: points: data: expected bytes", _array("<f8", [1, 2], "\0" * 16)),
    "array-elsewhere": _invalid(
        "act: array: expected dtype, shape, data",
        _points({"": "array", "dtype": "<f8", "shape": [1, 2], "offset": 0}),
    ),
    "nan-points": _invalid("plan: expected finite points", _array("<f8", [1, 2], b"\xff" * 16)),
    "long-plan": _invalid("plan: expected points of shape", _array("|u1", [5000, 2], b"\0" * 10_000)),
    "ragged-points": _invalid("act: points: expected two numbers each", _points([[1.0], [1.0, 2.0]])),
    "many-messages": _invalid(
        "act: messages: expected a tuple of at most 64",
        _with(messages=[{"": "Message", "type": "cam", "payload": b"", "sender": "", "tick": 0}] * 65),
    ),
    "bad-type": _invalid("messages: type: expected 1 to 16 of", _message(type="../../etc")),
    "text-payload": _invalid("act: messages: payload: expected bytes, found str", _message(payload="hello")),
    "crash-of-bytes": _invalid("act: crashed: expected str", lambda tick: packed({"tick": tick, "crashed": b"\xff"})),
}
"""What `act` answers in some tick."""

DEEDS: Mapping[str, Case] = {
    "spin": Case(FailureReason.TIMEOUT, "act: no answer within the time limit", deed="while True: pass", tick_s=3.0),
    "never": Case(FailureReason.TIMEOUT, "act: no answer within the time limit", deed="time.sleep(600)", tick_s=3.0),
    "slowloris": Case(
        FailureReason.TIMEOUT,
        "act: no answer within the time limit",
        deed="for byte in frame(answer(tick, GOOD)): line.send(bytes((byte,))); time.sleep(0.2)",
        tick_s=3.0,
    ),
    "noread": Case(
        FailureReason.TIMEOUT,
        "act: the agent does not read within the time limit",
        deed="line.sendall(frame(answer(tick, GOOD))); time.sleep(600)",
        tick_s=3.0,
    ),
    "huge": Case(
        FailureReason.INVALID,
        "act: expected an answer of at most 65536 bytes, found 4294967295",
        deed="line.sendall(b'\\xff' * 4 + bytes(2**20))",
    ),
    "empty": Case(
        FailureReason.INVALID, "act: expected an answer of at most 65536 bytes, found 0", deed="line.sendall(bytes(4))"
    ),
    "flood": Case(
        FailureReason.INVALID,
        "act: expected",
        deed="line.sendall(b''.join(frame(answer(tick + i, GOOD)) for i in range(200)))",
    ),
    "early": Case(
        FailureReason.INVALID,
        "act: expected",
        deed="line.sendall(frame(answer(tick, GOOD)) + frame(answer(tick + 1, GOOD)))",
    ),
    "descriptors": Case(
        None,
        "",
        deed="files = [os.open('/dev/null', os.O_RDONLY) for _ in range(50)]\n"
        "socket.send_fds(line, [frame(answer(tick, GOOD))], files)",
    ),
    "chatter": Case(None, "", deed="print('x' * 10**7, flush=True); line.sendall(frame(answer(tick, GOOD)))"),
    "hang-up": Case(FailureReason.CRASHED, "act: the agent's process ended (", deed="line.close(); time.sleep(600)"),
    "exit": Case(FailureReason.CRASHED, "act: the agent's process ended (exit code 0)", deed="os._exit(0)"),
    "segfault": Case(
        FailureReason.CRASHED, "act: the agent's process ended (exit code -11)", deed="ctypes.string_at(0)"
    ),
    "half": Case(
        FailureReason.CRASHED,
        "act: the agent's process ended (exit code 3)",
        deed="line.sendall(frame(answer(tick, GOOD))[:-9]); os._exit(3)",
    ),
    "terminal": Case(
        FailureReason.CRASHED, "RuntimeError: ?[2J?]0;", deed="raise RuntimeError('\\x1b[2J\\x1b]0;' + 'x' * 10**7)"
    ),
}
"""What an agent does instead of answering."""

CASES: Mapping[str, Case] = {**ANSWERS, **DEEDS}

SOURCE = """\
import ctypes, os, socket, stat, struct, time
import msgpack
from mdrive_sumo.contract import Control, Reply

GOOD = {good!r}

def frame(data): return struct.pack("<I", len(data)) + data
def answer(tick, value): return msgpack.packb({{"tick": tick, "value": value}})
def is_socket(fd):
    try:
        return stat.S_ISSOCK(os.fstat(fd).st_mode)
    except OSError:
        return False
def own_line(): return socket.socket(fileno=next(filter(is_socket, range(256))))

def misbehave(line, tick):
{body}

class Driver:
    label = "single"
    def __init__(self, config): self.line = None
    def sensors(self): return ()
    def start(self, briefing): pass
    def act(self, seen):
        if seen.tick < {late}: return Reply(control=Control(0.25, 0.0, 0.1))
        self.line = self.line or own_line()
        misbehave(self.line, seen.tick)
        time.sleep(600)
"""


def write_agent(folder: Path, name: str, late: int = LATE) -> Path:
    """A file with the class Driver: drives well, and from its tick on does what the table says."""
    case = CASES[name]
    deed = case.deed if case.data is None else f"line.sendall(frame({case.data(late)!r}))"
    body = "\n".join(f"    {row}" for row in deed.splitlines())
    path = folder / "agents.py"
    path.write_text(SOURCE.format(good=GOOD, body=body, late=late))
    return path
