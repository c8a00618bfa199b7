"""The browser of tests of pages. No tests in here."""

import os
import shutil

NAMES = ("chromium-headless-shell", "chromium", "chromium-browser", "google-chrome")
"""The shell needs a third of the processor time: it makes no windows, and no pages for their frames."""
CHROMIUM = next(filter(None, map(shutil.which, NAMES)), None)
FLAGS = (
    "--disable-gpu --disable-quic --no-first-run --disable-background-networking"
    " --disable-component-update --disable-sync"
)


def list_flags() -> list[str]:
    """Return the flags with which Chromium runs here, also as root."""
    return [*FLAGS.split(), *(["--no-sandbox"] if os.geteuid() == 0 else [])]
