"""A real Dask cluster of processes on this machine. No tests in here."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from testing.paths import TESTS


class Cluster:
    """A scheduler and workers with one thread each, as their commands start them."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self.workers: list[subprocess.Popen[bytes]] = []
        self.scheduler: subprocess.Popen[bytes] | None = None
        self.address = ""

    def start(self, workers: int) -> None:
        """The scheduler takes a free port the first time, the same one later."""
        file = self._folder / "address"
        file.unlink(missing_ok=True)
        at = ["--host", self.address] if self.address else ["--host", "127.0.0.1", "--port", "0"]
        self.scheduler = self._dask(
            "scheduler", *at, "--scheduler-file", str(file), "--dashboard-address", "127.0.0.1:0"
        )
        end = time.monotonic() + 90
        while not (file.is_file() and file.stat().st_size):
            assert self.scheduler.poll() is None and time.monotonic() < end, self.said()
            time.sleep(0.1)
        text = file.read_text()
        self.address = text[text.index("tcp://") :].partition('"')[0]
        for _ in range(workers):
            self.add_worker()

    def add_worker(self, *options: str) -> subprocess.Popen[bytes]:
        """One more."""
        how = (
            "--nthreads",
            "1",
            "--no-dashboard",
            "--local-directory",
            str(self._folder),
            *(options or ("--no-nanny",)),
        )
        self.workers.append(self._dask("worker", self.address, *how))
        return self.workers[-1]

    def kill_scheduler(self) -> None:
        """As a power cut would."""
        assert self.scheduler is not None
        self.scheduler.kill()
        self.scheduler.wait()

    def said(self) -> str:
        """By all of them."""
        return "\n".join(path.read_text(errors="replace") for path in sorted(self._folder.glob("*.log")))

    def stop(self) -> None:
        """Everything that still runs."""
        for process in (*self.workers, self.scheduler):
            if process is not None and process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()

    def _dask(self, *arguments: str) -> subprocess.Popen[bytes]:
        number = len(list(self._folder.glob("*.log")))
        with (self._folder / f"{number}-{arguments[0]}.log").open("wb") as log:
            return subprocess.Popen(
                [sys.executable, "-m", "dask", *arguments],
                env=os.environ | {"PYTHONPATH": str(TESTS)},
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                start_new_session=True,
            )


@contextmanager
def cluster(folder: Path, workers: int = 2) -> Generator[Cluster]:
    """Started, and stopped at the end."""
    found = Cluster(folder)
    try:
        found.start(workers)
        yield found
    finally:
        found.stop()
