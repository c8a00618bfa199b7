"""Waiting for what other processes do. No tests in here."""

import time
from collections.abc import Callable
from pathlib import Path


def wait_for(condition: Callable[[], bool], limit_s: float) -> None:
    """Returns as soon as it holds; fails where it does not hold in time."""
    end = time.monotonic() + limit_s
    while not condition():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.02)


def written(path: Path) -> bool:
    """Whether it has content: a file exists before its text is written."""
    return path.exists() and path.read_text() != ""


def alive(pid: int) -> bool:
    """Whether it runs: one that has ended and is not collected yet does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):  # the second where it is collected while we read
        return False


def find_parent(pid: int) -> int:
    return int(Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[1])
