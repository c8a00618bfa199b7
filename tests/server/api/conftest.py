"""The server that the tests of the API send requests to."""

from pathlib import Path

import pytest
from testing.api_app import Server


@pytest.fixture
def server(tmp_path: Path) -> Server:
    return Server(tmp_path)
