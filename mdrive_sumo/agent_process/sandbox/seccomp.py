"""The filters of system calls that a box is under.

libseccomp makes one of the table in `refused_calls`; what it cannot express is written as instructions of classic BPF.
Programs of the other word size (32-bit entry, x32) are refused every call, because the table names calls by the native
numbers only. Sources: `linux/bpf_common.h`, `linux/seccomp.h`, and `seccomp(2)` for `struct seccomp_data`.
"""

import errno
import socket
import struct
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from mdrive_sumo.agent_process.sandbox.refused_calls import (
    ALLOWED_IOCTLS,
    CLONE_PIDFD,
    FCNTL_LAST,
    HUGE_PAGES,
    LAST_KNOWN,
    LAST_OLD,
    NAMESPACE_FLAGS,
    NUMBERS,
    REFUSALS,
    REFUSED_ARGUMENTS,
    SHORTEST_NAME,
    SOCKET_OPTION_LAST,
)
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.installation_command import format_installation

LOW_32 = 0xFFFFFFFF
"""The kernel looks at 32 bits of most arguments; so must the filter."""
UNKNOWN = -1
"""What libseccomp answers for a name that it does not know; for one that this architecture lacks, another one."""


@cache
def compile_filter() -> bytes:
    """The filter as the kernel wants it. Compiled once in a process.

    Raises InputError if pyseccomp or the library under it is missing, or cannot refuse a call of the table.
    """
    seccomp = _load_library()
    rules = seccomp.SyscallFilter(seccomp.ALLOW)
    rules.set_attr(seccomp.Attr.ACT_BADARCH, seccomp.ERRNO(errno.EPERM))
    for refusal in REFUSALS:
        for call in refusal.calls:
            rules.add_rule(seccomp.ERRNO(refusal.answer), find_number(seccomp, call))
    _refuse_arguments(seccomp, rules)
    with tempfile.TemporaryDirectory() as folder, (Path(folder) / "filter").open("w+b") as file:
        rules.export_bpf(file)
        file.seek(0)
        return _refuse_unknown(seccomp) + file.read()


def _refuse_unknown(seccomp: Any) -> bytes:
    """The first instructions: calls that no table here knows, and requests of `ioctl`."""
    machine, ioctl = seccomp.system_arch(), find_number(seccomp, "ioctl")
    last_old = max(seccomp.resolve_syscall(seccomp.Arch.NATIVE, call) for call in LAST_OLD)
    return refuse_unknown(machine, last_old, LAST_KNOWN, ioctl, ALLOWED_IOCTLS)


@dataclass(frozen=True, slots=True)
class StatFilter:
    """The filter under which a supervisor answers `fstat`, and the numbers of calls that belong to it."""

    program: bytes
    fstat: int
    seccomp: int


@cache
def compile_stat_filter() -> StatFilter:
    """Raises InputError as `compile_filter` does."""
    seccomp = _load_library()
    fstat, newfstatat = (find_number(seccomp, call) for call in ("fstat", "newfstatat"))
    program = watch_stat(seccomp.system_arch(), fstat, newfstatat)
    return StatFilter(program, fstat, find_number(seccomp, "seccomp"))


def _load_library() -> Any:
    try:
        import pyseccomp
    except (ImportError, RuntimeError, OSError) as error:
        cure = f"{format_installation('server')}, on Debian and Ubuntu: apt-get install libseccomp2"
        raise InputError(f"sandbox: expected the package pyseccomp and libseccomp, found: {error}; {cure}") from error
    return pyseccomp


def find_number(seccomp: Any, call: str) -> int:
    """Return the number of a call on this machine. Raises InputError if neither libseccomp nor we know it."""
    number: int = seccomp.resolve_syscall(seccomp.Arch.NATIVE, call)
    if number != UNKNOWN:
        return number
    if call not in NUMBERS:
        raise InputError(
            f"sandbox: expected libseccomp to know the system call {call}, which boxes refuse, found that it does not;"
            " install a newer libseccomp"
        )
    return NUMBERS[call]


def _refuse_arguments(seccomp: Any, rules: Any) -> None:
    """Add the rules that depend on arguments."""
    refused = seccomp.ERRNO(errno.EPERM)
    for flag in (*NAMESPACE_FLAGS, CLONE_PIDFD):
        rules.add_rule(refused, "clone", seccomp.Arg(0, seccomp.MASKED_EQ, flag, flag))
    for rule in REFUSED_ARGUMENTS:
        values = (seccomp.Arg(place, seccomp.MASKED_EQ, LOW_32, value) for place, value in rule.arguments)
        rules.add_rule(refused, rule.call, *values)
    rules.add_rule(refused, "fcntl", seccomp.Arg(1, seccomp.GT, FCNTL_LAST))
    rules.add_rule(refused, "getsockopt", seccomp.Arg(1, seccomp.EQ, 1), seccomp.Arg(2, seccomp.GT, SOCKET_OPTION_LAST))
    for call, place, flag in HUGE_PAGES:
        rules.add_rule(refused, call, seccomp.Arg(place, seccomp.MASKED_EQ, flag, flag))
    rules.add_rule(refused, "bind", seccomp.Arg(2, seccomp.LT, SHORTEST_NAME))
    for call in ("preadv2", "pwritev2"):  # RWF_NOWAIT tells whether a page is in memory
        rules.add_rule(refused, call, seccomp.Arg(5, seccomp.NE, 0))
    for call in ("socket", "socketpair"):
        rules.add_rule(refused, call, seccomp.Arg(0, seccomp.NE, socket.AF_UNIX))


LOAD, JUMP_EQUAL, JUMP_GREATER, JUMP_BITS, RETURN = 0x20, 0x15, 0x25, 0x45, 0x06
NUMBER, ARCHITECTURE = 0, 4
"""Offsets in `struct seccomp_data`."""
ALLOW, NOTIFY = 0x7FFF0000, 0x7FC00000
AT_EMPTY_PATH = 0x1000
"""From linux/fcntl.h: the descriptor itself, not a path below it."""
NEW_NUMBERS = 424
"""From here on a call has the same number on all architectures (source: `scripts/syscall.tbl` of Linux)."""

Instruction = tuple[int, int, int, int]


def find_argument(position: int) -> int:
    """Return the offset of the lower half of an argument."""
    return 16 + 8 * position


def refuse(number: int) -> Instruction:
    """Return the instruction that answers with an error."""
    return RETURN, 0, 0, 0x00050000 | number


def assemble(instructions: Iterable[Instruction]) -> bytes:
    """Return the program as the kernel takes it."""
    return b"".join(struct.pack("=HBBI", *each) for each in instructions)


def watch_stat(architecture: int, fstat: int, newfstatat: int) -> bytes:
    """Return the filter that asks a supervisor about each `fstat`, by that name or by `AT_EMPTY_PATH`.

    Other word sizes are left to the filter that refuses them everything.
    """
    return assemble(
        (
            (LOAD, 0, 0, ARCHITECTURE),
            (JUMP_EQUAL, 0, 5, architecture),
            (LOAD, 0, 0, NUMBER),
            (JUMP_EQUAL, 4, 0, fstat),
            (JUMP_EQUAL, 0, 2, newfstatat),
            (LOAD, 0, 0, find_argument(3)),
            (JUMP_BITS, 1, 0, AT_EMPTY_PATH),
            (RETURN, 0, 0, ALLOW),
            (RETURN, 0, 0, NOTIFY),
        )
    )


def refuse_unknown(architecture: int, last_old: int, last: int, ioctl: int, requests: tuple[int, ...]) -> bytes:
    """Return the beginning of a filter that refuses calls of newer kernels, and all but some requests of `ioctl`.

    What it does not refuse goes on to the instructions after it. last_old: the largest number below `NEW_NUMBERS`.
    """
    tail: list[Instruction] = [
        *((JUMP_EQUAL, len(requests) - i, 0, request) for i, request in enumerate(requests)),
        refuse(errno.ENOTTY),
    ]
    body: list[Instruction] = [
        (LOAD, 0, 0, NUMBER),
        (JUMP_GREATER, 2, 0, last),
        (JUMP_GREATER, 0, 2, last_old),
        (JUMP_GREATER, 1, 0, NEW_NUMBERS - 1),
        refuse(errno.ENOSYS),
        (JUMP_EQUAL, 0, 1 + len(tail), ioctl),
        (LOAD, 0, 0, find_argument(1)),
        *tail,
    ]
    return assemble(((LOAD, 0, 0, ARCHITECTURE), (JUMP_EQUAL, 0, len(body), architecture), *body))
