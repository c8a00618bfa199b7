"""What the hostile programs share: how they tell what they found, through descriptor 3."""

import json
import os
from collections.abc import Callable


def tell(**facts: object) -> None:
    """One line of JSON to whoever opened the box."""
    os.write(3, json.dumps(facts).encode() + b"\n")


def opened(attempts: dict[str, Callable[[], object]]) -> list[str]:
    """Which of the attempts succeeded: ended without an error and with something true."""
    found: list[str] = []
    for name, attempt in attempts.items():
        try:
            if attempt():
                found.append(name)
        except (OSError, ValueError, OverflowError):
            continue
    return found


def syscall(number: int, *arguments: object) -> bool:
    """Whether the kernel granted a system call."""
    import ctypes

    libc = ctypes.CDLL(None, use_errno=True)
    words = [ctypes.c_long(word) if isinstance(word, int) else word for word in arguments]
    return libc.syscall(ctypes.c_long(number), *words) >= 0
