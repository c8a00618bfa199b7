"""Writes the replay page of a recorded episode; runs in a subprocess, because it takes seconds and much memory."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mdrive_sumo.core.output_files import write_text


@dataclass(frozen=True, slots=True)
class ReplayRequest:
    """One page to write."""

    suite: str
    scenario: str
    result: Mapping[str, Any]
    """A `mdrive_sumo.scoring.ScenarioResult` as plain values."""
    recording: Path
    page: Path
    """The file to write."""


def write_replay_page(request: ReplayRequest) -> None:
    """Write the page atomically unless it exists. Raises InputError and OSError."""
    if request.page.is_file():  # written by the call before this one
        return
    # Imported here: the process that answers requests must not load them.
    from mdrive_sumo.episode import load_episode
    from mdrive_sumo.report.replay_marks import find_marks
    from mdrive_sumo.report.replay_page import render_replay
    from mdrive_sumo.scenario.suite import load_suite
    from mdrive_sumo.scenario.variation import load_varied_scenario
    from mdrive_sumo.scoring import ScenarioResult

    suite = load_suite(request.suite)
    result = ScenarioResult.model_validate(request.result)
    written = next(scenario for scenario in suite.scenarios if scenario.id == request.scenario)
    scenario, roads = load_varied_scenario(suite, written, result.seed)
    episode = load_episode(request.recording)
    marks = find_marks(episode, result)
    write_text(request.page, render_replay(episode, scenario, roads, marks, result))
