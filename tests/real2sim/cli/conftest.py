"""A small V2XPnP log with its map, and the suite converted from it; both are read only."""

from pathlib import Path

import pytest
from testing.convert_command import run
from testing.local_executor import LocalExecutor
from testing.small_log import write_small_log

from real2sim.pipeline import batch, conversion_worker, log_conversion, log_source


@pytest.fixture(scope="session")
def small(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    return write_small_log(tmp_path_factory.mktemp("small"))


@pytest.fixture(scope="session")
def suite(small: tuple[Path, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("suites") / "my suite"
    log, map_ = small
    done = run("v2xpnp", log, "--map", map_, "--out", out, "--report")
    assert done.exit_code == 0, done.output
    assert "1 of 1 scenarios meet every target" in done.stdout
    return out


@pytest.fixture
def without_workers(monkeypatch: pytest.MonkeyPatch) -> None:
    """Logs are converted in the process of the test, and read in a process of their own, which may crash."""
    monkeypatch.setattr(batch, "ProcessPool", LocalExecutor)
    monkeypatch.setattr(conversion_worker, "_redirect_stdout", lambda: None)


@pytest.fixture
def in_process(without_workers: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Logs are read and converted in the process of the test: a worker process takes two seconds of imports."""
    monkeypatch.setattr(log_conversion, "read_log_limited", log_source.read_log, raising=False)
