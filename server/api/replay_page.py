"""Makes the replay page of a recorded episode; in a process of its own, for it takes seconds and loads much."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True, slots=True)
class ReplayRequest:
    """Which page."""

    suite: str
    scenario: str
    result: Mapping[str, Any]
    """`mdrive_sumo.scoring.ScenarioResult`."""
    recording: Path
    page: Path
    """The file to write."""


def write_replay_page(order: ReplayRequest) -> None:
    """Writes the page, whole or not at all, unless it is there. Raises InputError and OSError."""
    if order.page.is_file():  # somebody else wanted it, too, and had the turn before
        return
    # Only where it runs: the process that answers requests needs none of this.
    from mdrive_sumo.episode import load_episode
    from mdrive_sumo.report.replay_marks import find_marks
    from mdrive_sumo.report.replay_page import render_replay
    from mdrive_sumo.roads import find_network_folder, load_road_map
    from mdrive_sumo.scenario.suite import load_suite
    from mdrive_sumo.scoring import ScenarioResult

    suite = load_suite(order.suite)
    scenario = next(scenario for scenario in suite.scenarios if scenario.id == order.scenario)
    episode = load_episode(order.recording)
    roads = load_road_map(find_network_folder(scenario.network, suite.find_folder(scenario.id)))
    marks = find_marks(episode, ScenarioResult.model_validate(order.result))
    part = order.page.with_suffix(".part")
    part.write_text(render_replay(episode, scenario, roads, marks), encoding="utf-8")
    part.replace(order.page)
