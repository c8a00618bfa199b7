"""`mdrive-sumo study seasons`: the main table with a season axis."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import click

from mdrive_sumo.cli.setting_options import setting_option
from mdrive_sumo.cli.study_options import StudyOptions, drive_with_display, parse_agent_names, study_options
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.output_files import make_folder
from mdrive_sumo.core.tables import format_text
from mdrive_sumo.runs.evaluate import report_write_errors
from mdrive_sumo.runs.prepared_run import PreparedRun
from mdrive_sumo.scenario.packaged_suites import list_seasons
from mdrive_sumo.scenario.season import SEASON_SUITES, join_suite_name
from mdrive_sumo.scenario.suite import load_suite
from mdrive_sumo.study.seasons import METRICS, SeasonStudy, load_given_rows, summarise_seasons
from mdrive_sumo.study.seasons_files import build_seasons_table, seasons_csv, seasons_json, seasons_markdown

DEFAULT_AGENTS = "constant-speed,memory,take-turns,idm,single,sharing,sharing+negotiation,omniscient"
"""The ladder of the main table, and the agent that knows season 0 by heart."""
MAX_SEASONS = 100
"""Most seasons of a range; more is a slip of the keyboard."""


@click.command("seasons")
@click.option(
    "--agents",
    default=DEFAULT_AGENTS,
    show_default=True,
    metavar="A,B,...",
    help="Agents, each as --agent of `eval`; none: those of --runs only.",
)
@click.option(
    "--seasons",
    default="",
    metavar="0-3,DIR,...",
    help="Seasons: numbers, ranges, and folders of suites such as that of a secret season.  [default: all packaged]",
)
@click.option(
    "--runs",
    multiple=True,
    type=click.Path(path_type=Path),
    metavar="RUN",
    help="A finished run, which is not driven again; may be repeated.",
)
@study_options(suite="mdrive", seed=0, seeds=3)
@setting_option("agent_limits")
@click.pass_context
def seasons_command(ctx: click.Context, agents: str, seasons: str, runs: tuple[Path, ...], **options: Any) -> None:
    """Measure what agents score in season 0 and what is left of it in fresh seasons.

    Drives every agent in every season with every seed, except what --runs has. Writes seasons.json, .csv and .md into
    --out, and every run into --out/runs. The same command given again continues an interrupted study.

    Exit codes: 0 every scenario has a score, 1 some are void or an agent failed, 2 unusable input, 130 interrupted.
    """
    given = StudyOptions(**options)
    rows = load_given_rows(runs)
    names = parse_agent_names(agents) if agents != "none" else ()
    known = {(row.agent, row.season) for row in rows}
    suites = _list_suites(given.suite, seasons) if names else {}
    prepared = {
        (name, season): _prepare(given, name, suite)
        for name in names
        for season, suite in suites.items()
        if (name, season) not in known
    }
    if not prepared and not rows:
        raise InputError("study seasons: expected --agents or --runs, found neither")
    driven = drive_with_display(ctx, SeasonStudy(prepared, rows, given.out))
    summary = summarise_seasons(driven)
    about = replace(given.describe(driven), seeds=driven[0].seeds)
    pages = {
        "seasons.json": seasons_json(about, driven, summary),
        "seasons.csv": seasons_csv(summary),
        "seasons.md": seasons_markdown(about, driven, summary),
    }
    with report_write_errors(given.out):
        make_folder(given.out)  # --runs alone drives nothing that would
    tables = [f"{metric.upper()}\n{format_text(build_seasons_table(summary, metric))}" for metric in METRICS]
    given.end_study(ctx, driven, pages, (), tables, summary.void)


def _prepare(given: StudyOptions, agent: str, suite: str) -> PreparedRun:
    """Return the run of an agent in a season with all seeds. Raises InputError."""
    run = replace(given, suite=suite).prepare_agent(agent)
    return run.with_config(replace(run.config, seeds=given.all_seeds))


def _list_suites(suite: str, seasons: str) -> dict[str, str]:
    """Return what `load_suite` takes for each season, by season; "": all packaged ones. Raises InputError."""
    if suite not in SEASON_SUITES:
        raise InputError(f"study seasons: --suite: expected one of {', '.join(SEASON_SUITES)}, found {suite!r}")
    texts = _parse_seasons(seasons) if seasons else [str(number) for number in list_seasons(suite)]
    suites: dict[str, str] = {}
    for text in texts:
        name = join_suite_name(suite, text) if text.isdigit() else text
        loaded = load_suite(name)
        if loaded.about.name != suite or loaded.season is None:
            raise InputError(f"study seasons: --seasons: expected a season of {suite}, found {loaded.label} in {text}")
        if str(loaded.season) in suites:
            raise InputError(f"study seasons: --seasons: expected each once, found {loaded.season} twice")
        suites[str(loaded.season)] = name
    return suites


def _parse_seasons(text: str) -> Sequence[str]:
    """Return the numbers and folders of a list with commas; 0-3 is a range. Raises InputError."""
    found: list[str] = []
    for part in (one.strip() for one in text.split(",")):
        first, dash, last = part.partition("-")
        if not part:
            raise InputError(f"study seasons: --seasons: expected numbers, ranges and folders, found {text!r}")
        if not (dash and first.isdecimal() and last.isdecimal()):
            found.append(str(int(part)) if part.isdecimal() else part)
        elif int(first) > int(last) or int(last) - int(first) >= MAX_SEASONS:
            raise InputError(f"study seasons: --seasons: expected a range such as 0-3, found {part!r}")
        else:
            found += map(str, range(int(first), int(last) + 1))
    return found
