"""Every published row names its commit, and a sample of its episodes drives as it did there."""

import json
import re

import pytest
from testing.camera_scenes import needs_opengl

from mdrive_sumo.agents.learned.system_spec import SYSTEMS
from mdrive_sumo.agents.registry import DETECTOR_AGENTS
from tools.sample_episodes import drive_episode, list_sample, load_episodes
from tools.write_results import BASELINES, DESCRIPTION_BY_AGENT, ROOT

ROWS = json.loads((ROOT / BASELINES).read_text("utf-8"))
COSTLY = {*SYSTEMS, *DETECTOR_AGENTS} - {"tcp", "perception-swap:attfuse", "codriving"}
"""Learned agents: five seconds an episode. One of each kind drives the code of the others."""


def test_every_row_names_a_commit_and_has_a_sample() -> None:
    assert [*ROWS] == [agent for agent in DESCRIPTION_BY_AGENT if agent in ROWS]
    kept = load_episodes()
    for agent, row in ROWS.items():
        assert re.fullmatch(r"[0-9a-f]{8}", row["commit"]), agent
        assert [(one["scenario"], one["seed"]) for one in kept[agent]] == [*list_sample(agent)], agent
    assert {*kept} == {*ROWS}


def _list_marks(agent: str) -> list[pytest.MarkDecorator]:
    return [*([needs_opengl] if agent in SYSTEMS else []), *([pytest.mark.full] if agent in COSTLY else [])]


@pytest.mark.slow
@pytest.mark.parametrize(
    "agent",
    # covered in `make test` by one agent of each kind, and by tests/mdrive_sumo/agents/learned
    [pytest.param(agent, marks=_list_marks(agent)) for agent in ROWS],
)
def test_a_row_is_what_its_agent_drives_now(agent: str) -> None:
    """If it fails, the agent drives otherwise than its row says: see `tools.sample_episodes`."""
    kept = load_episodes()[agent]
    assert [drive_episode(agent, one["scenario"], one["seed"]) for one in kept] == kept
