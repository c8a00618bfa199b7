"""Shared by the tests of Real2Sim: conversions without worker processes, which take seconds to start."""

import pytest
from testing.local_executor import LocalExecutor

from real2sim.pipeline import batch, conversion_worker, log_conversion, log_source


@pytest.fixture
def without_workers(monkeypatch: pytest.MonkeyPatch) -> None:
    """Logs are converted in the process of the test, and read in a process of their own, which may crash."""
    monkeypatch.setattr(batch, "ProcessPool", LocalExecutor)
    monkeypatch.setattr(conversion_worker, "_redirect_stdout", lambda: None)


@pytest.fixture
def in_process(without_workers: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Logs are read and converted in the process of the test: a worker process takes two seconds of imports."""
    monkeypatch.setattr(log_conversion, "read_log_limited", log_source.read_log, raising=False)
