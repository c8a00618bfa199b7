"""Shared by the tests of drives: a scenario of a few seconds, and a finished drive with a branch."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from testing.drives import SCENARIO
from testing.local_executor import run_in_process
from testing.short_suite import make_short_suite


@pytest.fixture(scope="session")
def suite(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_short_suite(tmp_path_factory.mktemp("drive-suite"), SCENARIO, metres=25)


@pytest.fixture(scope="module")
def in_process() -> Iterator[None]:
    """Let the commands of a module run episodes in its own process: a worker takes seconds to start."""
    with pytest.MonkeyPatch.context() as patch:
        run_in_process(patch)
        yield
