"""`mdrive-sumo view`."""

import webbrowser
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from time import sleep as _sleep

import click

from mdrive_sumo.cli.replay_bar import follow_pages, write_run_replays
from mdrive_sumo.cli.stored_run_options import choose_seed, find_one_scenario, moved_suite_option
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.terminal import echo
from mdrive_sumo.report.network_page import render_network_page
from mdrive_sumo.report.run_page.comparison_data import (
    ComparedRun,
    build_comparison_data,
    find_telling_seeds,
    load_compared_runs,
)
from mdrive_sumo.report.run_page.comparison_files import (
    build_in_step_page,
    check_recordings_exist,
    find_comparison_folder,
    name_in_step_file,
    select_pairs,
    write_in_step_pages,
)
from mdrive_sumo.report.run_page.replay_files import (
    VIEW_FOLDER,
    ReplaySelection,
    build_replay,
    name_replay_file,
    select_replays,
    write_page,
    write_replays,
)
from mdrive_sumo.report.run_page.run_page import render_comparison_page, render_run_page
from mdrive_sumo.report.run_page.run_page_data import Replays, build_run_page_data, read_replays
from mdrive_sumo.roads import list_packaged_networks, load_road_map
from mdrive_sumo.roads.network_file import NETWORK_FILE
from mdrive_sumo.runs.evaluate import RESULTS_FILE
from mdrive_sumo.runs.journal import JOURNAL_FILE, read_run_journal
from mdrive_sumo.runs.stored_run import StoredRun, load_viewed_run
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scoring import Results, ScenarioResult

RUN_PAGE = "index.html"
LIVE_INTERVAL_S = 1.0
"""How often `--live` looks for finished episodes [s]: they take seconds."""
LIVE_REFRESH_S = 5
"""How often the browser loads the page of a run that is going on [s]: often enough to follow, rarely enough to read."""
RUN_NOTES: Mapping[ReplaySelection, str] = {
    ReplaySelection.LOST: "Replays are linked where something was lost; `mdrive-sumo view RUN --replays all` writes the"
    " others as well.",
    ReplaySelection.ALL: "",
    ReplaySelection.NONE: "Written without replays: `mdrive-sumo view RUN` writes the page with them.",
}
COMPARISON_NOTES: Mapping[ReplaySelection, str] = {
    ReplaySelection.LOST: "Scores that differ link to both replays in step; `mdrive-sumo view A B --replays all` writes"
    " the others as well.",
    ReplaySelection.ALL: "",
    ReplaySelection.NONE: "Written without replays: `mdrive-sumo view RUN_A RUN_B` writes the page with them.",
}


@click.command("view")
@click.argument("run_folders", metavar="RUN...|NETWORK", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option(
    "--scenario",
    "patterns",
    multiple=True,
    metavar="GLOB",
    help="Replay this scenario: an id, or a glob that fits one; may be repeated [default: the page of the runs].",
)
@click.option(
    "--seed",
    type=int,
    help="Of --scenario [default: the run's first; of two runs, the one in which they differ most].",
)
@click.option("--export", type=click.Path(path_type=Path, dir_okay=False), help="Write the page here, open nothing.")
@click.option("--no-open", is_flag=True, help="Open nothing.")
@click.option(
    "--replays",
    type=click.Choice([str(selection) for selection in ReplaySelection]),
    help="Replays beside the page: where something was lost (of several runs: where scores differ), all, none"
    " [default: lost].",
)
@click.option(
    "--live", is_flag=True, help="Write the page of a run that is going on anew as it grows, until it is finished."
)
@moved_suite_option
def command(run_folders: tuple[Path, ...], **options: object) -> None:
    """Open the page of a run in the browser, compare runs, or replay an episode.

    The page of a run lists its scenarios, the worst first: what each CAV lost and why, with links into the replays.
    Several runs are compared with the first of them: paired differences, settings that differ, and two replays of a
    scenario in step. --scenario opens the replay of one episode, or those of two runs in step.

    A run that is going on or was interrupted is shown with what it has finished, marked "partial". With --live its page
    is written anew as episodes finish, and the browser shows it; Ctrl-C ends this, and never the run.

    NETWORK is a network's folder, or the name of a packaged one: its page shows the ids of lanes, and clicks on its map
    become routes for scenarios that you write.

    All pages are HTML files that never reach the network, those of runs below the (first) RUN/view; those of earlier
    calls are written anew. `?` in a replay lists the keys.
    """
    given = _ViewOptions(**options)  # pyright: ignore[reportArgumentType] - click has made them what the fields say
    given.check(len(run_folders))
    if (network := _find_network(run_folders)) is not None:
        path = given.export or Path(f"{network.name}.html")
        write_page(path, render_network_page(load_road_map(network)))
        _open([path], is_wanted=not (given.export or given.no_open))
        return
    first, *others = run_folders
    if others:
        runs = load_compared_runs(run_folders, given.suite)
        paths = [*_write_in_step(runs, given)] if given.patterns else [_write_comparison(runs, given)]
    else:
        if given.live:
            _follow_run(first, given)
            return
        stored = load_viewed_run(first, given.suite)
        paths = [*_write_episodes(stored, given)] if given.patterns else [_write_run_page(stored, given)]
    _open(paths, is_wanted=not (given.export or given.no_open))


def _find_network(folders: Sequence[Path]) -> Path | None:
    """Return the folder of a network, if that is what is to be shown; a folder goes before a packaged network."""
    if len(folders) != 1:
        return None
    folder = folders[0] if folders[0].exists() else list_packaged_networks().get(str(folders[0]), folders[0])
    return folder if (folder / NETWORK_FILE).is_file() else None


@dataclass(frozen=True, slots=True)
class _ViewOptions:
    patterns: tuple[str, ...]
    seed: int | None
    export: Path | None
    no_open: bool
    replays: str | None
    live: bool
    suite: str | None

    @property
    def selection(self) -> ReplaySelection:
        """The replays beside a page; an exported one stands alone."""
        return ReplaySelection.NONE if self.export else ReplaySelection(self.replays or ReplaySelection.LOST)

    def check(self, runs: int) -> None:
        """Raise click.UsageError for options that do not go together. runs: how many are viewed."""
        if self.live and (runs > 1 or self.patterns or self.export):
            raise click.UsageError("--live: expected one RUN with it, without --scenario and --export")
        if self.patterns and runs > 2:
            raise click.UsageError(f"--scenario: expected one RUN or two with it, found {runs}")
        if self.export is not None and len(self.patterns) > 1:
            raise click.UsageError(f"--export: expected one --scenario with it, found {len(self.patterns)}")
        if self.seed is not None and not self.patterns:
            raise click.UsageError("--seed: expected a --scenario with it, found none")
        if self.replays is not None and (self.patterns or self.export):
            raise click.UsageError("--replays: expected neither --scenario nor --export with it")


def _write_run_page(stored: StoredRun, given: _ViewOptions) -> Path:
    selection = given.selection
    path = given.export or stored.run.folder / VIEW_FOLDER / RUN_PAGE
    chosen = write_run_replays(stored, selection)
    data = build_run_page_data(stored, read_replays(stored, chosen), path)
    write_page(path, render_run_page(data, replays_note=RUN_NOTES[selection]))
    return path


def _follow_run(folder: Path, given: _ViewOptions) -> None:
    """Write the page of a run whenever an episode has finished, until all have; open it once."""
    path = folder / VIEW_FOLDER / RUN_PAGE
    written: Replays = {}
    shown: tuple[int, int | None] | None = None
    with suppress(KeyboardInterrupt):
        while True:
            stored = _load_begun_run(folder, given.suite)
            state = None if stored is None else (len(stored.results.scenarios), stored.results.planned)
            if stored is not None and state != shown:
                written = _write_live_page(stored, given.selection, written, path)
                if shown is None:
                    _open([path], is_wanted=not given.no_open)
                shown = state
            if stored is not None and stored.results.planned is None:
                return
            _sleep(LIVE_INTERVAL_S)


def _load_begun_run(folder: Path, suite: str | None) -> StoredRun | None:
    """Return a run with what it has finished; None before its first episode has. Raises InputError."""
    if (folder / JOURNAL_FILE).is_file() and not (folder / RESULTS_FILE).is_file():
        journal = read_run_journal(folder)[1]
        if journal.about and not journal.results:
            return None
    return load_viewed_run(folder, suite)


def _write_live_page(stored: StoredRun, selection: ReplaySelection, written: Replays, path: Path) -> Replays:
    """Write the page of a run, and the replays that are not among the written ones; return all that are written."""
    chosen = select_replays(stored.run, stored.results.scenarios, selection)
    new = [result for result in chosen if result.key not in written]
    for _ in write_replays(path.parent, stored.run, new):
        pass
    written = {**written, **read_replays(stored, new)}
    data = build_run_page_data(stored, written, path)
    refresh_s = 0 if stored.results.planned is None else LIVE_REFRESH_S
    write_page(path, render_run_page(data, replays_note=RUN_NOTES[selection], refresh_s=refresh_s))
    return written


def _write_comparison(runs: Sequence[ComparedRun], given: _ViewOptions) -> Path:
    folder, selection = find_comparison_folder(runs), given.selection
    path = given.export or folder / RUN_PAGE
    seeds = select_pairs(runs, selection)
    check_recordings_exist(runs, seeds.items())
    links = {(scenario, letter): name_in_step_file(scenario, letter) for scenario, letter in seeds}
    data = build_comparison_data(runs, links, path)
    follow_pages(write_in_step_pages(folder, runs, seeds.items()), len(seeds))
    write_page(path, render_comparison_page(data, replays_note=COMPARISON_NOTES[selection]))
    return path


def _write_in_step(runs: Sequence[ComparedRun], given: _ViewOptions) -> Iterator[Path]:
    first, other = runs
    seeds = find_telling_seeds(runs)
    for pattern in given.patterns:
        scenario = find_one_scenario(first.stored.run.suite, pattern).id
        telling_seed = seeds.get((scenario, other.letter), first.stored.results.run.seed)
        seed = telling_seed if given.seed is None else choose_seed(first.stored.results, given.seed)
        path = given.export or find_comparison_folder(runs) / name_in_step_file(scenario, other.letter)
        write_page(path, build_in_step_page(first, other, (scenario, seed)))
        yield path


def _write_episodes(stored: StoredRun, given: _ViewOptions) -> Iterator[Path]:
    run, results = stored.run, stored.results
    chosen = [find_one_scenario(run.suite, pattern) for pattern in given.patterns]
    results_to_show = [_find_result(results, scenario, choose_seed(results, given.seed)) for scenario in chosen]
    for result in results_to_show:
        path = given.export or run.folder / VIEW_FOLDER / name_replay_file(run.info, result)
        write_page(path, build_replay(run, result))
        yield path


def _open(paths: Sequence[Path], *, is_wanted: bool) -> None:
    for path in paths:
        echo(path)
        if is_wanted and not webbrowser.open(path.resolve().as_uri()):
            echo("no browser found here: open the file above in one", err=True)


def _find_result(results: Results, scenario: Scenario, seed: int) -> ScenarioResult:
    result_of_seed = next((result for result in results.scenarios if result.key == (scenario.id, seed)), None)
    if result_of_seed is None:
        driven = [*dict.fromkeys(result.id for result in results.scenarios)]
        names = ", ".join(driven[:4]) + (" ..." if len(driven) > 4 else "")
        raise InputError(
            f"scenario {scenario.id}: expected one that this run has driven ({names}), found one outside its"
            f" --scenario; `mdrive-sumo eval --scenario {scenario.id}` drives it in a run of its own"
        )
    return result_of_seed
