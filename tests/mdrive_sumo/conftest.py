"""Shared by the tests of the library."""

from collections.abc import Iterator

import pytest
from testing.local_executor import run_in_process


@pytest.fixture(scope="module")
def in_process() -> Iterator[None]:
    """Make the module drive runs, studies and validations in its own process: a worker takes seconds to start."""
    with pytest.MonkeyPatch.context() as patch:
        run_in_process(patch)
        yield


@pytest.fixture(scope="session", autouse=True)
def short_pauses() -> Iterator[None]:
    """Ask a language model that fails again after a hundredth of a second: tests wait for nothing."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("mdrive_sumo.negotiation.language_model.FIRST_PAUSE_S", 0.01)
        yield
