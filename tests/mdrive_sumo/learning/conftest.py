"""One small data set for all tests of this folder."""

from pathlib import Path

import pytest
from testing.training_data import collect_here, make_settings, make_suite


@pytest.fixture(scope="session")
def short_suite(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a suite of two short scenarios."""
    return make_suite(tmp_path_factory.mktemp("suite") / "short")


@pytest.fixture(scope="session")
def dataset(short_suite: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a data set of these scenarios, without cameras; never changed."""
    folder = tmp_path_factory.mktemp("data") / "set"
    found, _ = collect_here(make_settings(short_suite), folder)
    assert [one.status for shard in found.shards for one in shard.scenarios] == ["done", "done"]
    return folder
