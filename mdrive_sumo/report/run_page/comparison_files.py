"""The pages of a comparison: where they lie, which pairs of replays are written, and how."""

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.report.run_page.comparison_data import ComparedRun, PairKey, find_telling_seeds
from mdrive_sumo.report.run_page.in_step_page import APART_M, InStepSide, render_in_step
from mdrive_sumo.report.run_page.replay_files import VIEW_FOLDER, ReplaySelection, build_replay, write_page
from mdrive_sumo.runs.compare import TIE
from mdrive_sumo.runs.episode_difference import find_parting, find_separation
from mdrive_sumo.runs.recording_check import load_recording
from mdrive_sumo.scoring import EpisodeKey, ScenarioResult

MAX_NAME = 80
"""Characters of the folder of a comparison."""


def find_comparison_folder(runs: Sequence[ComparedRun]) -> Path:
    """Return the folder of the pages of a comparison, in that of the first run's pages."""
    names = "+".join(run.folder.resolve().name for run in runs[1:])
    return runs[0].folder / VIEW_FOLDER / f"with-{names[:MAX_NAME]}"


def name_in_step_file(scenario: str, letter: str) -> str:
    """Return the name of the page with two replays of a scenario, those of A and of another run."""
    return f"{scenario}-A{letter}.html"


def select_pairs(runs: Sequence[ComparedRun], selection: ReplaySelection) -> dict[PairKey, int]:
    """Return the pairs of replays that are written, each with its seed: of runs that have recordings.

    `ReplaySelection.LOST` selects those whose driving scores differ.
    """
    if selection is ReplaySelection.NONE or not runs[0].stored.run.config.record:
        return {}
    is_all = selection is ReplaySelection.ALL
    scores = {run.letter: {result.key: result.ds for result in run.stored.results.scenarios} for run in runs}
    recorded = {run.letter for run in runs if run.stored.run.config.record}
    return {
        (scenario, letter): seed
        for (scenario, letter), seed in find_telling_seeds(runs).items()
        if letter in recorded
        and (is_all or abs(scores[letter][scenario, seed] - scores[runs[0].letter][scenario, seed]) > TIE)
    }


def check_recordings_exist(runs: Sequence[ComparedRun], pairs: Iterable[tuple[PairKey, int]]) -> None:
    """Raise InputError for a recording that a run should have, but has not. pairs: with their seeds."""
    by_letter = {run.letter: run for run in runs}
    for (scenario, letter), seed in pairs:
        for run in (runs[0], by_letter[letter]):
            path = run.stored.run.find_recording((scenario, seed))
            if not path.is_file():
                raise InputError(
                    f"{path}: expected the recording of {run.stored.run.name_episode((scenario, seed))}, found none;"
                    " --replays none writes the page without replays"
                )


def write_in_step_pages(
    folder: Path, runs: Sequence[ComparedRun], pairs: Iterable[tuple[PairKey, int]]
) -> Iterator[Path]:
    """Write pages with two replays in step, one for each pair; yield each path after its page is written."""
    by_letter = {run.letter: run for run in runs}
    first: dict[EpisodeKey, InStepSide] = {}
    for (scenario, letter), seed in sorted(pairs):
        key, other = (scenario, seed), by_letter[letter]
        if key not in first:  # all pairs of a scenario share it
            first = {key: _build_side(runs[0], key)}
        path = folder / name_in_step_file(scenario, letter)
        write_page(path, _render((runs[0], other), (first[key], _build_side(other, key)), key))
        yield path


def build_in_step_page(first: ComparedRun, other: ComparedRun, key: EpisodeKey) -> str:
    """Return the page with the replays of one episode in two runs. Raises InputError unless both have recorded it."""
    for run in (first, other):
        _find_result(run, key)  # before the work of the first replay
    return _render((first, other), (_build_side(first, key), _build_side(other, key)), key)


def _render(runs: tuple[ComparedRun, ComparedRun], sides: tuple[InStepSide, InStepSide], key: EpisodeKey) -> str:
    a, b = (load_recording(run.stored.run, _find_result(run, key)) for run in runs)
    is_seeded = any(len(run.stored.results.run.all_seeds) > 1 for run in runs)
    seed_text = f"seed {key[1]}" if is_seeded else ""
    return render_in_step(key[0], seed_text, sides, find_parting(a, b), find_separation(a, b, APART_M))


def _build_side(run: ComparedRun, key: EpisodeKey) -> InStepSide:
    result = _find_result(run, key)
    return InStepSide(run.letter, run.agent, str(run.folder), result.ds, build_replay(run.stored.run, result))


def _find_result(run: ComparedRun, key: EpisodeKey) -> ScenarioResult:
    match = next((result for result in run.stored.results.scenarios if result.key == key), None)
    if match is None:
        seeds = [result.seed for result in run.stored.results.scenarios if result.id == key[0]]
        other = f"seeds {', '.join(map(str, seeds))} of it" if seeds else "none"
        remedy = "; --seed chooses one" if seeds else f"; `mdrive-sumo eval --scenario {key[0]}` drives it"
        raise InputError(
            f"scenario {key[0]}, seed {key[1]}: expected an episode that {run.folder} has driven, found {other}{remedy}"
        )
    return match
