"""`mdrive-sumo view`."""

import webbrowser
from pathlib import Path

import click

from mdrive_sumo.cli.choice import choose_seed, find_one_scenario
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.episode import load_episode
from mdrive_sumo.report.replay_marks import find_marks
from mdrive_sumo.report.replay_page import render_replay
from mdrive_sumo.runs.evaluate import report_write_errors
from mdrive_sumo.runs.prepared_run import PreparedRun
from mdrive_sumo.runs.stored_run import load_stored_run
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.variation import load_varied_scenario
from mdrive_sumo.scoring import Results, ScenarioResult


@click.command("view")
@click.argument("run_folder", metavar="RUN", type=click.Path(path_type=Path))
@click.option(
    "--scenario",
    "patterns",
    multiple=True,
    metavar="GLOB",
    help="Which one: an id, or a glob that fits one; may be repeated [default: the first].",
)
@click.option("--seed", type=int, help="Which one in a run of several seeds [default: the first].")
@click.option("--export", type=click.Path(path_type=Path, dir_okay=False), help="Write the page here, open nothing.")
@click.option("--no-open", is_flag=True, help="Write RUN/view/SCENARIO.html and open nothing.")
@click.option("--suite", metavar="NAME|DIR", help="Where the run's suite is now, if it has moved.")
def command(
    run_folder: Path,
    patterns: tuple[str, ...],
    seed: int | None,
    export: Path | None,
    no_open: bool,
    suite: str | None,
) -> None:
    """Replay a recorded episode in the browser.

    The page is one self-contained HTML file that never reaches the network; `?` in it lists the keys.
    """
    if export is not None and len(patterns) > 1:
        raise click.UsageError(f"--export: expected one --scenario with it, found {len(patterns)}")
    stored = load_stored_run(run_folder, suite)
    run, results = stored.run, stored.results
    chosen = [find_one_scenario(run.suite, pattern) for pattern in patterns] or [run.scenarios[0]]
    found = [_find_result(results, scenario, choose_seed(results, seed)) for scenario in chosen]
    for scenario, result in zip(chosen, found, strict=True):
        ending = f"-seed{result.seed}" if len(results.run.all_seeds) > 1 else ""
        path = export or run_folder / "view" / f"{scenario.id}{ending}.html"
        page = _build_page(run, scenario, result)
        with report_write_errors(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(page, encoding="utf-8")
        click.echo(path)
        if not (export or no_open) and not webbrowser.open(path.resolve().as_uri()):
            click.echo("no browser found here: open the file above in one", err=True)


def _find_result(results: Results, scenario: Scenario, seed: int) -> ScenarioResult:
    found = next((result for result in results.scenarios if result.key == (scenario.id, seed)), None)
    if found is None:
        driven = [*dict.fromkeys(result.id for result in results.scenarios)]
        names = ", ".join(driven[:4]) + (" ..." if len(driven) > 4 else "")
        raise InputError(
            f"scenario {scenario.id}: expected one that this run has driven ({names}), found one outside its"
            f" --scenario; `mdrive-sumo eval --scenario {scenario.id}` drives it in a run of its own"
        )
    if found.status == "void":
        raise InputError(f"scenario {scenario.id}: expected a recorded episode, found a void one ({found.reason})")
    return found


def _build_page(run: PreparedRun, scenario: Scenario, result: ScenarioResult) -> str:
    if not run.config.record:
        raise InputError(f"{run.folder}: expected a run with recordings, found one made with --no-record")
    episode = load_episode(run.find_recording(result.key))
    varied, roads = load_varied_scenario(run.suite, scenario, result.seed)
    return render_replay(episode, varied, roads, find_marks(episode, result), result)
