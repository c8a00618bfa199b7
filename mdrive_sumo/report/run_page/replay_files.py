"""The replay pages of a run: where they lie, which episodes get one, and how they are written."""

from collections.abc import Iterable, Iterator
from enum import StrEnum, auto
from pathlib import Path

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.output_files import make_parents, write_text
from mdrive_sumo.episode.camera_archive import load_camera_tracks
from mdrive_sumo.report.replay_marks import find_marks
from mdrive_sumo.report.replay_page import render_replay
from mdrive_sumo.runs.evaluate import report_write_errors
from mdrive_sumo.runs.prepared_run import PreparedRun
from mdrive_sumo.runs.recording_check import load_recording
from mdrive_sumo.scenario.variation import load_varied_scenario
from mdrive_sumo.scoring import RunInfo, ScenarioResult
from mdrive_sumo.scoring.score_mode import SUCCESS_DS

VIEW_FOLDER = "view"
"""Of a run: the folder of its pages."""


class ReplaySelection(StrEnum):
    """Which episodes of a run get a replay page."""

    LOST = auto()
    """Those in which a CAV lost something."""
    ALL = auto()
    NONE = auto()


def name_replay_file(info: RunInfo, result: ScenarioResult) -> str:
    """Return the name of an episode's replay page. info: of its run."""
    ending = f"-seed{result.seed}" if len(info.all_seeds) > 1 else ""
    return f"{result.id}{ending}.html"


def select_replays(
    run: PreparedRun, results: Iterable[ScenarioResult], selection: ReplaySelection
) -> list[ScenarioResult]:
    """Return the episodes that get a replay page: none without recordings, never a void one.

    Raises InputError for a recording that the run should have, but has not.
    """
    if selection is ReplaySelection.NONE or not run.config.record:
        return []
    is_all = selection is ReplaySelection.ALL
    chosen = [result for result in results if result.status != "void" and (is_all or has_losses(result))]
    for result in chosen:
        path = run.find_recording(result.key)
        if not path.is_file():
            raise InputError(
                f"{path}: expected the recording of {run.name_episode(result.key)}, found none; --replays none"
                " writes the page without replays, and the same `mdrive-sumo eval` command drives it again"
            )
    return chosen


def has_losses(result: ScenarioResult) -> bool:
    """Return whether a CAV of the episode did not succeed, or the episode is void."""
    return result.status == "void" or any(ego.ds <= SUCCESS_DS for ego in result.egos)


def build_replay(run: PreparedRun, result: ScenarioResult) -> str:
    """Return the replay page of an episode. Raises InputError for a run or an episode without a recording."""
    if result.status == "void":
        raise InputError(f"scenario {result.id}: expected a recorded episode, found a void one ({result.reason})")
    if not run.config.record:
        raise InputError(f"{run.folder}: expected a run with recordings, found one made with --no-record")
    scenario = next(scenario for scenario in run.scenarios if scenario.id == result.id)
    episode = load_recording(run, result)
    varied, roads = load_varied_scenario(run.suite, scenario, result.seed)
    images = run.find_camera_images(result.key)
    cameras = load_camera_tracks(images) if images.is_file() else ()
    return render_replay(episode, varied, roads, find_marks(episode, result), result, cameras)


def write_replays(folder: Path, run: PreparedRun, results: Iterable[ScenarioResult]) -> Iterator[Path]:
    """Write the replay pages of episodes into a folder; yield each path after its page is written."""
    for result in results:
        path = folder / name_replay_file(run.info, result)
        write_page(path, build_replay(run, result))
        yield path


def write_page(path: Path, html: str) -> None:
    """Write a page, over one that is there. Raises InputError if that is not possible."""
    with report_write_errors(path):
        make_parents(path)
        write_text(path, html)
