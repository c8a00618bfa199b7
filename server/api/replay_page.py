"""Writes the replay page of a recorded episode; runs in a subprocess, because it takes seconds and much memory."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any


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
    from mdrive_sumo.roads import find_network_folder, load_road_map
    from mdrive_sumo.scenario.suite import load_suite
    from mdrive_sumo.scoring import ScenarioResult

    suite = load_suite(request.suite)
    scenario = next(scenario for scenario in suite.scenarios if scenario.id == request.scenario)
    episode = load_episode(request.recording)
    roads = load_road_map(find_network_folder(scenario.network, suite.find_folder(scenario.id)))
    marks = find_marks(episode, ScenarioResult.model_validate(request.result))
    part = request.page.with_suffix(".part")
    part.write_text(render_replay(episode, scenario, roads, marks), encoding="utf-8")
    part.replace(request.page)
