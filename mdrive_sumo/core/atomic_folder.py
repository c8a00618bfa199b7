"""Folders that are written completely or not at all."""

import signal
import tempfile
import threading
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.output_files import make_parents


@contextmanager
def atomic_folder(out: Path) -> Generator[Path]:
    """Yield a draft folder next to `out` that is renamed to `out` when the block succeeds and removed otherwise.

    SIGTERM ends the block like Ctrl-C, with KeyboardInterrupt. Raises InputError unless `out` is new or an empty
    folder, or if it cannot be written.
    """
    check_new_folder(out)
    try:
        make_parents(out)
        with _sigterm_as_interrupt(), tempfile.TemporaryDirectory(dir=out.parent, prefix=f".{out.name}.") as scratch:
            draft = Path(scratch) / "draft"
            draft.mkdir()
            yield draft
            draft.rename(out)  # takes the place of an empty folder
    except OSError as error:
        raise InputError(f"{out}: cannot be written: {error.strerror}") from error


def check_new_folder(out: Path) -> None:
    """Raise InputError unless a folder to write to is new or empty."""
    if out.is_symlink() or (out.exists() and (not out.is_dir() or any(out.iterdir()))):
        raise InputError(f"{out}: expected a new or empty folder to write to, found something there")


@contextmanager
def _sigterm_as_interrupt() -> Generator[None]:
    """Raise KeyboardInterrupt on SIGTERM, so that the draft is removed. Only the main thread receives signals."""
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
