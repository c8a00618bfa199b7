"""Filters of system calls that libseccomp cannot express, as instructions of classic BPF.

Source: `linux/bpf_common.h`, `linux/seccomp.h` and, for the fields of `struct seccomp_data`, `seccomp(2)`.
"""

import errno
import struct
from collections.abc import Iterable

LOAD, JUMP_EQUAL, JUMP_GREATER, JUMP_BITS, RETURN = 0x20, 0x15, 0x25, 0x45, 0x06
NUMBER, ARCHITECTURE = 0, 4
"""Offsets in `struct seccomp_data`."""
ALLOW, NOTIFY = 0x7FFF0000, 0x7FC00000
AT_EMPTY_PATH = 0x1000
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
