"""Shared by the tests of the server."""

from collections.abc import Iterator

import pytest
from testing.shared_apps import count_taken, release_apps


@pytest.fixture(autouse=True)
def shared_apps() -> Iterator[None]:
    """Let the next test have the applications of this one; those of wider fixtures were taken before."""
    before = count_taken()
    yield
    release_apps(before)
