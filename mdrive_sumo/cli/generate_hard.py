"""`mdrive-sumo generate --hard`."""

import importlib.util
import signal
import sys
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from shutil import get_terminal_size
from typing import Any

import click

from mdrive_sumo.cli.generate_season import read_secret
from mdrive_sumo.cli.options import workers_option
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.installation_command import format_installation
from mdrive_sumo.core.terminal import echo, echo_live
from mdrive_sumo.generate.generated_suite import check_output_folder
from mdrive_sumo.generate.hard.adversarial_search import SearchJournal, SearchSettings, run_search
from mdrive_sumo.generate.hard.candidate_evaluation import CandidateEvaluation
from mdrive_sumo.generate.hard.family_search import FamilySearch
from mdrive_sumo.generate.hard.hard_places import HardPlace, draw_pool, list_choices
from mdrive_sumo.generate.hard.hard_recipe import HARD_GENERATOR, find_families
from mdrive_sumo.generate.hard.hard_selection import ChosenCandidate, choose_scenarios
from mdrive_sumo.generate.hard.hard_suite import certify_chosen, write_hard_suite
from mdrive_sumo.generate.hard.suite_aims import find_missed_aims
from mdrive_sumo.generate.hard.suite_requirements import LEAST_SCENARIOS
from mdrive_sumo.generate.seasons.season_seed import SeasonSeed, parse_season
from mdrive_sumo.roads.netconvert import find_netconvert
from mdrive_sumo.runs.journal import open_journal
from mdrive_sumo.scenario.suite import SuiteFile
from mdrive_sumo.study.need_certificate import NeedCertificate, Proof

HARD_NAME = "hard"
BUDGET = 96
"""Candidates of a family in a command that says no budget."""
PLACES_FOLDER = "places"
HARD_ONLY = ("families", "budget", "search_folder", "fresh", "no_search")
WITH_HARD = ("hard", "season", "secret", "count", "out", "workers", *HARD_ONLY)


def hard_options(function: Callable[..., None]) -> Callable[..., None]:
    """Add the options of the adversarial search to a command."""
    options = (
        click.option(
            "--hard", is_flag=True, help="Search a season of the hard tier: with --season N (needs the extra `search`)."
        ),
        click.option("--family", "families", multiple=True, metavar="F", help="hard: only this family; may repeat."),
        click.option(
            "--budget",
            type=click.IntRange(1, 100_000),
            default=BUDGET,
            show_default=True,
            help="hard: candidates per family.",
        ),
        click.option(
            "--search-folder",
            type=click.Path(path_type=Path, file_okay=False),
            help="hard: journal and places of the search.  [default: OUT.search]",
        ),
        click.option("--fresh", is_flag=True, help="hard: drop what the journal of the search holds."),
        click.option("--no-search", is_flag=True, help="hard: only choose from what the search folder holds."),
        workers_option,
    )
    for option in reversed(options):
        function = option(function)
    return function


def check_hard_options(options: Mapping[str, Any]) -> None:
    """Raise click.UsageError for options that do not go with --hard, or only with it."""
    context = click.get_current_context()
    given = context.get_parameter_source
    typed = [name for name in context.params if given(name) is click.core.ParameterSource.COMMANDLINE]
    names = {one.name: one.opts[0] for one in context.command.params}
    for name in typed:
        if options["hard"] and name not in WITH_HARD:
            raise click.UsageError(f"{names[name]} goes not with --hard")
        if not options["hard"] and name in HARD_ONLY:
            raise click.UsageError(f"{names[name]} goes only with --hard")
    if options["hard"] and options["season"] is None:
        raise click.UsageError("--hard: expected --season N, found none")


def generate_hard(ctx: click.Context, options: Mapping[str, Any], out: Path) -> int:
    """Search, choose, write the suite and return the exit code; Ctrl-C ends the command with 130."""
    _check_choice_library()
    families = find_families(options["families"])
    check_output_folder(out)
    seed = parse_season(options["season"], read_secret(options["secret"]) if options["secret"] else "")
    about = _describe_suite(seed)
    folder: Path = options["search_folder"] or out.parent / f"{out.name}.search"
    find_netconvert()
    settings = SearchSettings(families, options["budget"], seed, options["workers"])
    display = SearchDisplay()
    try:
        with open_journal(folder, settings.fingerprint, fresh=options["fresh"]) as opened:
            if opened.torn:
                display.note("the last line of the journal was incomplete and has been dropped")
            pool = _draw_pool(settings, folder)
            display.note(f"{len(pool)} places for {len(families)} families: {folder / PLACES_FOLDER}")
            searches = run_search(settings, pool, SearchJournal(opened), display, only_kept=options["no_search"])
    except KeyboardInterrupt:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # a second Ctrl-C must not swallow the answer to the first
        display.close()
        again = "the same command" + (" without --fresh" if options["fresh"] else "")
        echo(f"interrupted; {again} continues {folder}, with --no-search it chooses from what is there", err=True)
        ctx.exit(130)
    display.close()
    echo(_format_searches(searches))
    passed = [one for search in searches for one in search.evaluations if one.figures is not None]
    count = options["count"] or LEAST_SCENARIOS
    chosen = choose_scenarios(passed, {place.name: place for place in pool}, count)
    if not chosen:
        tried = sum(len(search.evaluations) for search in searches)
        raise InputError(f"{folder}: expected a scenario among {tried} candidates, found none; a larger --budget helps")
    need = certify_chosen(chosen, options["workers"])
    write_hard_suite(about, chosen, need, out)
    echo(_format_chosen(chosen, need, count, out))
    return 0 if len(chosen) == count else 1


def _check_choice_library() -> None:
    """Raise InputError without SciPy, which chooses."""
    if importlib.util.find_spec("scipy") is None:
        raise InputError(
            "generate --hard: expected the package scipy, which the choice needs, found none;"
            f" {format_installation('search')}"
        )


def _draw_pool(settings: SearchSettings, folder: Path) -> tuple[HardPlace, ...]:
    seed = settings.seed.derive("hard", HARD_GENERATOR, "places")
    return draw_pool(list_choices(settings.families), seed, folder / PLACES_FOLDER, settings.workers)


def _describe_suite(seed: SeasonSeed) -> SuiteFile:
    return SuiteFile(
        name=HARD_NAME,
        title=f"Hard tier: `omniscient` arrives in time, rules without messages do not, season {seed.season}",
        description=f"Season {seed.season}, drawn by `mdrive-sumo generate --hard`"
        + (" with a secret." if seed.secret else "."),
        season=seed.season,
        score_mode="hard",
    )


def _format_searches(searches: Sequence[FamilySearch]) -> str:
    return "\n".join(
        f"{one.family.category}: {sum(it.figures is not None for it in one.evaluations)} of"
        f" {len(one.evaluations)} candidates on {len(one.places)} places passed{_format_rejections(one.evaluations)}"
        for one in searches
    )


def _format_rejections(evaluations: Sequence[CandidateEvaluation]) -> str:
    stages = Counter(str(one.stage) for one in evaluations if one.stage is not None)
    counts = ", ".join(f"{count} at {stage}" for stage, count in stages.most_common())
    return f"; rejected {counts}" if counts else ""


def _format_chosen(
    chosen: Sequence[ChosenCandidate], need: Mapping[str, NeedCertificate], count: int, out: Path
) -> str:
    evaluations = [one.evaluation for one in chosen]
    names = evaluations[0].measured.scores
    means = {name: sum(one.measured.scores[name] for one in evaluations) / len(chosen) for name in names}
    missed = list(find_missed_aims(evaluations, count))
    return (
        f"{len(chosen)} of {count} scenarios: {out}; {len({one.family for one in evaluations})} categories on"
        f" {len({one.place for one in evaluations})} places, {sum(one.holds for one in need.values())}"
        f" certificates of need, {sum(one.proves is Proof.ALL for one in need.values())} of level all; mean scores"
        f" {', '.join(f'{name} {mean:.1f}' for name, mean in means.items())}\n"
        + (f"aims missed: {'; '.join(missed)}" if missed else "all aims are met")
    )


class SearchDisplay:
    """Progress of a search on standard error: one live line on a terminal, one line per candidate elsewhere."""

    def __init__(self) -> None:
        self._live = sys.stderr.isatty()
        self._total = self._kept = self._done = self._passed = 0
        self._began = time.monotonic()

    def begin(self, total: int, kept: int) -> None:
        """See SearchProgress."""
        self._total, self._kept = total, kept
        if kept:
            self.note(f"continuing: the journal holds {kept} candidates")

    def evaluated(self, evaluation: CandidateEvaluation) -> None:
        """See SearchProgress."""
        self._done += 1
        self._passed += evaluation.figures is not None
        found = evaluation.figures
        result = (
            f"talking {found.score:.1f}, unaided {found.unaided_score:.1f}, factor {found.limit_factor:g}"
            if found
            else f"refused at {evaluation.stage}: {evaluation.reason}"
        )
        line = f"{self._kept + self._done}/{self._total}  {self._passed} passed  eta {self._format_eta()}"
        self._write(f"{line}  {evaluation.id}: {result}")

    def note(self, text: str) -> None:
        """See SearchProgress."""
        self.close()
        echo(text, err=True)

    def close(self) -> None:
        """Clear the live line."""
        if self._live:
            echo_live("")

    def _write(self, line: str) -> None:
        if self._live:
            width = max(get_terminal_size().columns, 40)
            echo_live(line[: width - 1])
        else:
            echo(line, err=True)

    def _format_eta(self) -> str:
        left_s = (time.monotonic() - self._began) / self._done * max(self._total - self._kept - self._done, 0)
        minutes, seconds = divmod(round(left_s), 60)
        return f"{minutes}:{seconds:02}"
