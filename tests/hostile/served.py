"""What hostile agents get from a real server: one table, checked over HTTP and shown in docs/sandbox-hostile.md."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

CRASHED, TIMEOUT, INVALID = "agent-failed (crashed)", "agent-failed (timeout)", "agent-failed (invalid)"
OK, REJECTED = "ok", "rejected"
GONE = "act: the agent's process ended"
LATE_ANSWER = "act: no answer within the time limit"


@dataclass(frozen=True, slots=True)
class Served:
    """One agent, and what a server says of it."""

    does: str
    """For the page."""
    verdict: str
    says: str = ""
    """How the CAV's reason or the submission's sentence begins."""
    told: Mapping[str, Any] = field(default_factory=dict[str, Any])
    """What a program of `agents` found: exactly this, from the log of its CAV."""
    oom: bool = False
    """The kernel ended something in its box for its memory."""
    answers: int | None = None
    """How many ticks were answered, where that tells something."""


def _probe(does: str, **told: object) -> Served:
    return Served(does, OK, told=told)


def _late(does: str, answers: int = 3) -> Served:
    return Served(does, TIMEOUT, LATE_ANSWER, answers=answers)


def _invalid(does: str, says: str = "act: expected") -> Served:
    return Served(does, INVALID, says)


PROGRAMS: Mapping[str, Served] = {
    "net": _probe("asks for every kind of socket, a service and an abstract socket of the host", open=[]),
    "files": _probe("reads secrets, devices, the hidden suite and the database; writes everywhere", open=[]),
    "kernel": _probe("83 attempts at system calls that a driver never needs", open=[]),
    "setuid": Served("brings a set-uid program and runs it", CRASHED, "PermissionError: [Errno 13]"),
    "procs": _probe("lists processes, then kills its parent, process 1 and all others", seen=[1, 2], survived=True),
    "forkbomb": _late("forks without end"),
    "threadbomb": _late("starts 5000 threads"),
    "membomb": Served("takes 4 GB", CRASHED, "start: the agent's process ended (out of memory)", oom=True),
    "membomb_fork": Served("takes 4.8 GB with eight processes", OK, told={"all_killed": True}, oom=True),
    "scapegoat": Served("the same, and offers the kernel process 1 instead", CRASHED, "start: the agent's", oom=True),
    "diskfill": _probe("fills its temporary folder", one_ended="EFBIG", ended="ENOSPC"),
    "inodes": _late("makes empty files without end"),
    "shmbomb": _probe("fills shared memory", file=[2097152, "EFBIG"], unnamed=[2097152, "EFBIG"]),
    "stdoutflood": _probe("prints 40 MB", written=True),
    "daemon": _probe("leaves a child that has left its session", left=True),
    "selfexit": Served("ends at once, without a word", CRASHED, "start: the agent's process ended (exit code 0)"),
    "segv": Served("reads address 0", CRASHED, "start: the agent's process ended (exit code -11)"),
    "diary": _probe("looks for traces of earlier runs to know the scenario again, and leaves some", found=[]),
    "impostor": _probe("writes results where an evaluator might look", pretended=True),
}
"""Programs of `agents`; those that end drive on afterwards."""

ABUSES: Mapping[str, Served] = {
    "spin": _late("computes for ever"),
    "never": _late("sleeps"),
    "noread": _late("answers once more and reads no more", answers=4),
    "slowloris": _late("sends a byte every 0.2 s"),
    "huge": _invalid("announces 4 GiB", "act: expected an answer of at most 65536 bytes, found 4294967295"),
    "empty": _invalid("announces nothing"),
    "flood": _invalid("answers 200 ticks at once"),
    "early": _invalid("answers the next tick before it is asked"),
    "stale": _invalid("answers the tick before", "act: expected the answer of tick"),
    "future": _invalid("answers the next tick instead", "act: expected the answer of tick"),
    "malformed": _invalid("sends a pickle"),
    "deep": _invalid("60 000 brackets"),
    "big-integer": _invalid("an integer of 64 bits as throttle", "throttle: expected a number in [0, 1]"),
    "nan": _invalid("NaN as throttle", "throttle: expected a number in [0, 1]"),
    "infinity": _invalid("infinity as throttle", "throttle: expected a number in [0, 1]"),
    "boolean": _invalid("true as throttle", "act: throttle: expected a number, found bool"),
    "double-key": _invalid("a key twice", "act: expected different strings as keys"),
    "extension": _invalid("a type of its own", "act: expected no extension types"),
    "object-array": _invalid("an array of Python objects", "act: points"),
    "result": _invalid("a driving score beside its answer", "act: expected a tick and a value"),
    "result-inside": _invalid("a driving score in its answer", "act: Reply: expected control, plan"),
    "result-instead": _invalid("a result instead of an answer", "act: expected a Reply"),
    "descriptors": _late("passes 50 file descriptors along with an answer, then sleeps", answers=4),
    "chatter": _late("prints 10 MB before an answer, then sleeps", answers=4),
    "hang-up": Served("closes its socket", CRASHED, GONE),
    "exit": Served("ends in mid-drive", CRASHED, f"{GONE} (exit code 0)"),
    "segfault": Served("reads address 0 in mid-drive", CRASHED, f"{GONE} (exit code -11)"),
    "half": Served("ends in the middle of an answer", CRASHED, f"{GONE} (exit code 3)"),
    "terminal": Served("raises an error that would take over a terminal", CRASHED, "RuntimeError: ?[2J?]0;"),
}
"""Abuses of the protocol, of `hostile_protocol`."""

DRIVERS: Mapping[str, Served] = {
    "leaves-at-import": Served("ends its process while it is imported", CRASHED, "create: "),
    "breaks-at-import": Served("does not compile", CRASHED, "SyntaxError"),
    "privileged": Served(
        "asks for the privileged sensor", REJECTED, "sensor 'privileged': expected sensors that a car"
    ),
    "camera": Served("asks for images of nine million pixels", REJECTED, "sensors: expected a price of at most 40 ms"),
    "gossip": _invalid(
        "sends 54 kB of noise in messages every tick", "act: expected answers of at most 16777216 bytes"
    ),
    "printer": _late("prints without end and answers nothing", answers=0),
    "archivist": Served("fills its recording with notes: those beyond the limits are dropped", OK),
    "labeller": Served("gives its notes 1500 kinds a tick: 32 are counted, the others dropped", OK),
    "glutton": Served("asks for 64 rasters of 1024 pixels", REJECTED, "sensors: expected at most 8 of lidar and bev"),
    "painter": Served(
        "asks for 8 rasters of 1024 pixels, which cost the evaluator 240 ms a tick",
        REJECTED,
        "sensors: expected a price of at most 40 ms a tick for each car",
    ),
    "joint-sleeper": Served("one program for all CAVs, in its track; sleeps", TIMEOUT, LATE_ANSWER),
    "until-a-date": Served("behaves until a date: then a spot re-run differs and is flagged", OK),
}
"""Whole agents, of `hostile_server`."""

SERVED: Mapping[str, Served] = {**PROGRAMS, **ABUSES, **DRIVERS}


def page() -> str:
    """The table of docs/sandbox-hostile.md."""
    rows = [f"| `{name}` | {each.does} | {each.verdict} |" for name, each in SERVED.items()]
    return "\n".join(("| agent | does | verdict |", "|---|---|---|", *rows))
