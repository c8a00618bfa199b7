"""What a user is told of an agent that cannot be created."""

from pathlib import Path

import pytest

from mdrive_sumo.loop.agent_driver import AgentFailure
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.open_agents import declare_agent

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(
    ("source", "text"),
    [
        ("class Mine:\n    def act(self, seen)\n", "SyntaxError: expected ':' (mine.py, line 2)"),
        ("class Mine:\n    def __init__(self, config):\n        1 / 0\n", "division by zero (mine.py, line 3)"),
    ],
)
def test_the_failing_line_is_named_once(tmp_path: Path, source: str, text: str) -> None:
    (tmp_path / "mine.py").write_text(source)
    with pytest.raises(AgentFailure) as caught:
        declare_agent(AgentSpec(f"{tmp_path}/mine.py:Mine"))
    assert str(caught.value).endswith(text)
    assert str(caught.value).count("mine.py") == 1
