"""The browser of tests of pages. No tests in here."""

import os
import shutil

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
FLAGS = (
    "--disable-gpu --disable-quic --no-first-run --disable-background-networking"
    " --disable-component-update --disable-sync"
)


def list_flags() -> list[str]:
    """Return the flags with which Chromium runs here, also as root."""
    return [*FLAGS.split(), *(["--no-sandbox"] if os.geteuid() == 0 else [])]
