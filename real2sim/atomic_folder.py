"""Folders that are written whole or not at all."""

import signal
import tempfile
import threading
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

from mdrive_sumo.core.errors import InputError


@contextmanager
def atomic_folder(out: Path) -> Generator[Path]:
    """A draft folder beside `out`, which it becomes when the block ends well; nothing is left of it otherwise.

    SIGTERM ends the block as Ctrl-C does, by KeyboardInterrupt. Raises InputError unless `out` is new or an empty
    folder, or if the disk does not take it.
    """
    if out.is_symlink() or (out.exists() and (not out.is_dir() or any(out.iterdir()))):
        raise InputError(f"{out}: expected a new or empty folder to write to, found something there")
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        with _sigterm_as_interrupt(), tempfile.TemporaryDirectory(dir=out.parent, prefix=f".{out.name}.") as scratch:
            draft = Path(scratch) / "draft"
            draft.mkdir()
            yield draft
            draft.rename(out)  # takes the place of an empty folder
    except OSError as error:
        raise InputError(f"{out}: cannot be written: {error.strerror}") from error


@contextmanager
def _sigterm_as_interrupt() -> Generator[None]:
    """SIGTERM raises KeyboardInterrupt, so that nothing is left behind. Only a main thread can hear signals."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, _raise_interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _raise_interrupt(_signal: int, _frame: FrameType | None) -> None:
    raise KeyboardInterrupt
