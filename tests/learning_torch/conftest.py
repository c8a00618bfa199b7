"""Tests that need PyTorch and onnx, which are not in the lock: .ci/run installs them apart and runs this folder."""

from importlib.util import find_spec
from pathlib import Path

import pytest

HAS_TORCH = all(find_spec(name) is not None for name in ("torch", "onnx"))


def pytest_ignore_collect(collection_path: Path) -> bool | None:
    """Collect nothing here where PyTorch is missing: pytest that is told to run this folder then fails."""
    return True if collection_path.suffix == ".py" and not HAS_TORCH else None


@pytest.fixture(autouse=True, scope="session")
def one_thread() -> None:
    """Two threads that wait for each other on a busy machine take eight times as long."""
    import torch

    torch.set_num_threads(1)


@pytest.fixture
def drawn_curves() -> None:
    """Trainings of a test that asks for this draw curves.png."""


@pytest.fixture(autouse=True)
def no_curves(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Draw nothing else: matplotlib takes as long as some steps of training."""
    if "drawn_curves" not in request.fixturenames:
        monkeypatch.setattr("mdrive_sumo.learning.training.training_curves.draw_curves", draw_nothing)


def draw_nothing(path: Path) -> None:
    """Stands for `draw_curves`."""
