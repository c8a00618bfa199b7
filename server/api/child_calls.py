"""Runs in the children of `subprocess_runner`: what they call is imported in the call, so that they start fast.

At their start they need neither FastAPI nor SQLAlchemy.
"""

import os
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.output_files import write_text
from server.errors import StoreUnavailable

if TYPE_CHECKING:
    from server.archive import Manifest
    from server.settings import ServerSettings


def answer_calls(pipe: Connection, nice: int) -> None:
    """Answer calls until the parent closes the pipe."""
    os.nice(nice)
    with suppress(EOFError, KeyboardInterrupt, BrokenPipeError):
        pipe.send("ready")
        while True:
            function, args, kwargs = pipe.recv()
            try:
                answer = True, function(*args, **kwargs)
            except (InputError, OSError, StoreUnavailable) as error:
                answer = False, error
            pipe.send(answer)


def check_uploaded_agent(
    archive: Path, manifest: "Manifest", settings: "ServerSettings", sensor_track_only: bool = False
) -> bool:
    """Call `declaration_check.check_declaration`. Raises ArchiveRefused."""
    from server.evaluation.declaration_check import check_declaration

    return check_declaration(archive, manifest, settings, sensor_track_only=sensor_track_only)


@dataclass(frozen=True, slots=True)
class ReplayRequest:
    """One page to write."""

    suite: str
    scenario: str
    result: Mapping[str, Any]
    """A `mdrive_sumo.scoring.ScenarioResult` as plain values."""
    recording: Path
    page: Path
    """The HTML file that is written."""


def write_replay_page(request: ReplayRequest) -> None:
    """Write the page atomically unless it exists. Raises InputError and OSError."""
    if request.page.is_file():  # written by the call before this one
        return
    # Imported here: the process that answers requests must not load them.
    from mdrive_sumo.episode import load_episode
    from mdrive_sumo.report.replay_marks import find_marks
    from mdrive_sumo.report.replay_page import render_replay
    from mdrive_sumo.scenario.season import read_stored_name
    from mdrive_sumo.scenario.suite import load_suite
    from mdrive_sumo.scenario.variation import load_varied_scenario
    from mdrive_sumo.scoring import ScenarioResult

    suite = load_suite(read_stored_name(request.suite))
    result = ScenarioResult.model_validate(request.result)
    written = next(scenario for scenario in suite.scenarios if scenario.id == request.scenario)
    scenario, roads = load_varied_scenario(suite, written, result.seed)
    episode = load_episode(request.recording)
    marks = find_marks(episode, result)
    write_text(request.page, render_replay(episode, scenario, roads, marks, result))
