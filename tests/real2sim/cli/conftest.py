"""A small V2XPnP log with its map, and the suite converted from it; both are read only."""

from pathlib import Path

import pytest
from testing.convert_command import run
from testing.small_log import write_small_log


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
