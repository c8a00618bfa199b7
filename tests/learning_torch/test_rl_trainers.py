"""Trainers of others train in the environments: the code of docs/reinforcement-learning.md."""

from pathlib import Path
from textwrap import dedent
from typing import Any

import numpy as np
import pytest

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore::UserWarning")]
PAGE = Path(__file__).parents[2] / "docs" / "reinforcement-learning.md"


def _run_block(first_line: str) -> dict[str, Any]:
    """Run the block of the page that begins with a line, and return its variables."""
    text = PAGE.read_text("utf-8")
    begin = text.index(f"    {first_line}\n")
    lines = text[begin:].splitlines()
    end = next(row for row, line in enumerate(lines) if line and not line.startswith("    "))
    variables: dict[str, Any] = {"__name__": "example"}
    exec(compile(dedent("\n".join(lines[:end])), str(PAGE), "exec"), variables)
    return variables


def test_stable_baselines3_trains_one_cav() -> None:
    trained = _run_block("from stable_baselines3 import PPO")
    assert trained["model"].num_timesteps == 128
    assert trained["action"] in range(15)
    assert trained["observation"].shape == (120,)


def test_torchrl_collects_from_all_cavs() -> None:
    rollout = _run_block("from pettingzoo.utils import BaseParallelWrapper")["rollout"]
    assert rollout["cavs", "observation"].shape == (20, 4, 120)
    assert rollout["cavs", "mask"].all()
    rewards = rollout["next", "cavs", "reward"].numpy()
    assert np.isfinite(rewards).all()
    assert np.abs(rewards).max() > 0.0
