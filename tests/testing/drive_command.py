"""The command `mdrive-sumo drive` as a process, and a driver who presses keys in its page. No tests in here."""

import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from testing.chromium import wait_until
from testing.paths import ROOT

START_S = 120.0
"""Time to start on a busy machine [s]."""


@dataclass
class DriveCommand:
    """A running `mdrive-sumo drive`."""

    process: subprocess.Popen[str]
    links: dict[str, str] = field(default_factory=dict[str, str])
    """Link by CAV; "spectators"."""

    def read_links(self) -> None:
        """Wait until the command has printed its links."""
        assert self.process.stdout is not None
        for line in self.process.stdout:
            if found := re.match(r"driver of (\S+): (\S+)", line):
                self.links[found[1]] = found[2]
            elif line.startswith("spectators: "):
                self.links["spectators"] = line.split()[1]
            elif line.startswith("all links: "):
                return
        raise AssertionError(f"no links: {self.process.stderr and self.process.stderr.read()}")

    def stop(self) -> str:
        """End it as Ctrl-C does; what it said on standard error."""
        self.process.send_signal(signal.SIGINT)
        _, said = self.process.communicate(timeout=START_S)
        assert self.process.returncode == 0, said
        return said

    def kill(self) -> None:
        """End it as a crash does."""
        self.process.kill()
        self.process.wait(START_S)


@contextmanager
def run_drive(*arguments: object) -> Generator[DriveCommand]:
    """Run `mdrive-sumo drive` with a free port and without a browser."""
    command = [sys.executable, "-m", "mdrive_sumo", "drive", *map(str, arguments), "--no-open", "--port", "0"]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True, cwd=ROOT) as process:
        try:
            running = DriveCommand(process)
            running.read_links()
            yield running
        finally:
            if process.poll() is None:
                process.terminate()
                try:
                    process.wait(30)
                except subprocess.TimeoutExpired:
                    process.kill()


def run_command(*arguments: object) -> str:
    """Run `mdrive-sumo`; its output, both streams. It must succeed."""
    command = [sys.executable, "-m", "mdrive_sumo", *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=ROOT, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout + done.stderr


class KeyDriver:
    """Presses keys as a person would: looks at the page, decides, holds or releases a key."""

    def __init__(self, page: Any) -> None:
        self.page = page
        self._held = ""

    @property
    def mode(self) -> str:
        return self.page.evaluate("document.body.dataset.mode")

    @property
    def take(self) -> int:
        return int(self.page.evaluate("document.body.dataset.take"))

    @property
    def tick(self) -> int:
        return int(self.page.evaluate("document.body.dataset.tick"))

    @property
    def speed(self) -> float:
        return float(self.page.evaluate("Drive.shownState?.vx ?? 0"))

    def hold(self, key: str) -> None:
        """Hold one key; "" holds none."""
        if key == self._held:
            return
        if self._held:
            self.page.keyboard.up(self._held)
        if key:
            self.page.keyboard.down(key)
        self._held = key

    def start(self) -> None:
        """Press the button of the card, with assisted steering."""
        wait_until(self.page, "!document.getElementById('card').hidden && Boolean(document.body.dataset.take)", START_S)
        if not self.page.evaluate("Drive.inputs.isAssisted"):
            self.page.keyboard.press("l")
        self.page.click("#card-actions .first")

    def drive_until(
        self,
        is_done: Callable[[], bool],
        speed: float = 5.0,
        limit_s: float = 180.0,
        look: Sequence[Callable[[], None]] = (),
    ) -> None:
        """Keep a speed [m/s] with the pedals until something is true."""
        end = time.monotonic() + limit_s
        while not is_done():
            assert time.monotonic() < end, self.page.evaluate("JSON.stringify({...document.body.dataset})")
            error = speed - self.speed
            self.hold("w" if error > 0.5 else "s" if error < -1.0 else "")
            for one in look:
                one()
            self.page.wait_for_timeout(50)
        self.hold("")


def list_takes(page: Any) -> list[dict[str, Any]]:
    """The takes as the page was told."""
    return page.evaluate("Drive.listed")


def drive_folder(folder: Path, take: int) -> Path:
    """The run folder of a take."""
    return folder / "takes" / str(take)
