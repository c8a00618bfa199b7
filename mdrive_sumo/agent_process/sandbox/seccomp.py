"""The filter of system calls that a box is under, made of the table in `refused_calls`.

Programs of the other word size (32-bit entry, x32) are refused every call, because the table names calls by the native
numbers only.
"""

import errno
import socket
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

from mdrive_sumo.agent_process.sandbox.refused_calls import (
    FCNTL_LAST,
    NAMESPACE_FLAGS,
    NUMBERS,
    REFUSALS,
    REFUSED_ARGUMENTS,
)
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.installation_command import format_installation

LOW_32 = 0xFFFFFFFF
"""The kernel looks at 32 bits of most arguments; so must the filter."""
UNKNOWN = -1
"""What libseccomp answers for a name that it does not know; for one that this architecture lacks, another one."""


@cache
def compiled() -> bytes:
    """The filter as the kernel wants it. Compiled once in a process.

    Raises InputError if pyseccomp or the library under it is missing, or cannot refuse a call of the table.
    """
    try:
        import pyseccomp as seccomp
    except (ImportError, RuntimeError, OSError) as error:
        cure = f"{format_installation('server')}, on Debian and Ubuntu: apt-get install libseccomp2"
        raise InputError(f"sandbox: expected the package pyseccomp and libseccomp, found: {error}; {cure}") from error
    rules = seccomp.SyscallFilter(seccomp.ALLOW)
    rules.set_attr(seccomp.Attr.ACT_BADARCH, seccomp.ERRNO(errno.EPERM))
    for refusal in REFUSALS:
        for call in refusal.calls:
            rules.add_rule(seccomp.ERRNO(refusal.answer), find_number(seccomp, call))
    _refuse_arguments(seccomp, rules)
    with tempfile.TemporaryDirectory() as folder, (Path(folder) / "filter").open("w+b") as file:
        rules.export_bpf(file)
        file.seek(0)
        return file.read()


def find_number(seccomp: Any, call: str) -> int:
    """Return the number of a call on this machine. Raises InputError if neither libseccomp nor we know it."""
    found: int = seccomp.resolve_syscall(seccomp.Arch.NATIVE, call)
    if found != UNKNOWN:
        return found
    if call not in NUMBERS:
        raise InputError(
            f"sandbox: expected libseccomp to know the system call {call}, which boxes refuse, found that it does not;"
            " install a newer libseccomp"
        )
    return NUMBERS[call]


def _refuse_arguments(seccomp: Any, rules: Any) -> None:
    """Add the rules that depend on arguments."""
    refused = seccomp.ERRNO(errno.EPERM)
    for flag in NAMESPACE_FLAGS:
        rules.add_rule(refused, "clone", seccomp.Arg(0, seccomp.MASKED_EQ, flag, flag))
    for rule in REFUSED_ARGUMENTS:
        values = (seccomp.Arg(place, seccomp.MASKED_EQ, LOW_32, value) for place, value in rule.arguments)
        rules.add_rule(refused, rule.call, *values)
    rules.add_rule(refused, "fcntl", seccomp.Arg(1, seccomp.GT, FCNTL_LAST))
    for call in ("preadv2", "pwritev2"):  # RWF_NOWAIT tells whether a page is in memory
        rules.add_rule(refused, call, seccomp.Arg(5, seccomp.NE, 0))
    for call in ("socket", "socketpair"):
        rules.add_rule(refused, call, seccomp.Arg(0, seccomp.NE, socket.AF_UNIX))
