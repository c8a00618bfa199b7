"""Write a short suite for quick work: the scenarios of a season that keep the ranking of its agents.

    mdrive-sumo eval --suite mdrive@3 --agent NAME ... --out RUN       # once for each agent
    python -m tools.build_short_suite RUN... --count 40 --out mdrive_sumo/scenarios/season_3/mdrive-40

OUT lies beside the suites of the season, whose scenarios it names. What is printed comes from the same runs; runs with
other seeds say how well the choice holds: `--check RUN`. With `--dry-run` only that is printed.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import fmean

import click

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.terminal import echo
from mdrive_sumo.generate.short_suite import AgentScores, choose_scenarios, compare_rankings
from mdrive_sumo.runs.run_folder import load_run_results
from mdrive_sumo.scenario.suite import Suite, SuiteFile, load_suite, save_suite, seal_suite
from mdrive_sumo.scoring import Results, load_results
from tools.tool_command import HELP, ToolCommand, dry_run_option


def load_scores(places: Sequence[Path], suite: Suite) -> AgentScores:
    """Return the scores of finished runs of a suite. Raises InputError."""
    found: dict[str, dict[str, list[float]]] = {}
    for place in places:
        results = _load(place)
        if results.run.suite_checksum != suite.checksum() or results.planned is not None:
            raise InputError(f"{place}: expected a finished run of {suite.label}, found another")
        of_agent = found.setdefault(results.run.agent, {})
        for one in results.scenarios:
            of_agent.setdefault(one.id, []).append(one.ds)
    return {agent: {name: fmean(values) for name, values in scores.items()} for agent, scores in found.items()}


def _load(place: Path) -> Results:
    return load_results(place) if place.is_file() else load_run_results(place)


def build_suite(suite: Suite, scenarios: Sequence[str], folder: Path) -> Suite:
    """Write the sealed suite of some scenarios of a season's whole suite."""
    about = SuiteFile(
        name=folder.name,
        title=f"{len(scenarios)} scenarios of {suite.label} that keep the ranking of agents",
        description="For quick work; chosen by tools/build_short_suite.py.",
        season=suite.about.season,
        parts=suite.about.parts,
        only=tuple(scenarios),
    )
    save_suite(Suite(about, folder, ()))
    sealed = seal_suite(load_suite(str(folder)))
    save_suite(Suite(sealed.about, folder, ()))
    return load_suite(str(folder))


PATH = click.Path(path_type=Path, exists=True)


@click.command(cls=ToolCommand, context_settings=HELP)
@click.argument("runs", metavar="RUN...", nargs=-1, required=True, type=PATH)
@click.option("--suite", "name", default="mdrive", show_default=True, help="Suite of the runs.")
@click.option("--count", type=click.IntRange(min=1), default=40, show_default=True, help="Scenarios to choose.")
@click.option("--check", "checks", multiple=True, type=PATH, help="A run that chooses nothing; may repeat.")
@click.option("--out", required=True, type=click.Path(path_type=Path), help="Folder of the suite.")
@dry_run_option
def main(runs: Sequence[Path], name: str, count: int, checks: Sequence[Path], out: Path, dry_run: bool) -> None:
    """Choose scenarios by runs of several agents and write the suite."""
    suite = load_suite(name)
    buckets = {scenario.id: scenario.bucket for scenario in suite.scenarios}
    scores = load_scores(runs, suite)
    chosen = choose_scenarios(scores, buckets, count)
    if not dry_run:
        build_suite(suite, chosen, out)
    told = f"{len(chosen)} scenarios{' would be written' if dry_run else ''}"
    echo(f"{out}: {told}; Kendall's tau of {len(scores)} agents {_compare(scores, chosen, buckets)}")
    for agent in scores:
        others = {other: of_agent for other, of_agent in scores.items() if other != agent}
        tau = _compare(scores, choose_scenarios(others, buckets, count), buckets)
        echo(f"  chosen without {agent}: {tau}")
    if checks:
        fresh = load_scores(checks, suite)
        echo(f"  other seeds: {_compare(fresh, chosen, buckets)}")


def _compare(scores: AgentScores, chosen: Sequence[str], buckets: Mapping[str, str]) -> str:
    return f"{compare_rankings(scores, chosen, buckets):.3f}"


if __name__ == "__main__":
    main()
