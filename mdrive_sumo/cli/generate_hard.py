"""`mdrive-sumo generate --hard`."""

import signal
import sys
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from shutil import get_terminal_size
from typing import Any

import click
from pydantic import ValidationError

from mdrive_sumo.cli.options import workers_option
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.terminal import echo, echo_live
from mdrive_sumo.generate.generated_suite import check_output_folder
from mdrive_sumo.generate.hard.adversarial_search import SearchJournal, SearchSettings, run_search
from mdrive_sumo.generate.hard.archive_file import build_archive_file, save_archive_file
from mdrive_sumo.generate.hard.archive_picture import draw_archives
from mdrive_sumo.generate.hard.behaviour_archive import FamilySearch, SearchSeed, check_search_library
from mdrive_sumo.generate.hard.candidate_evaluation import KNOWN_SUITES, CandidateEvaluation
from mdrive_sumo.generate.hard.hard_recipe import find_families, load_start
from mdrive_sumo.generate.hard.hard_selection import ChosenElite, SelectionSettings, select_checked_elites
from mdrive_sumo.generate.hard.hard_suite import write_hard_suite
from mdrive_sumo.generate.hard.suite_aims import find_missed_aims, is_certified, is_on_corridor
from mdrive_sumo.runs.journal import open_journal
from mdrive_sumo.scenario.packaged_suites import list_packaged_suites
from mdrive_sumo.scenario.suite import SuiteFile

HARD_SUITE = "hard"
"""The packaged suite; a hidden one must not repeat it."""
HARD_COUNT = 126
"""A third on corridors, 80 certificates (issue K), and room for categories that are neither."""
BUDGET = 72
"""New candidates of a family in a command that says no budget: nine batches of eight."""
HARD_ONLY = ("families", "budget", "start_from", "search_folder", "fresh", "no_search")
NOT_HARD = ("proposer", "endpoint", "model", "explain")


def hard_options(function: Callable[..., None]) -> Callable[..., None]:
    """Add the options of the adversarial search to a command."""
    options = (
        click.option("--hard", is_flag=True, help="Search the hard tier (needs the extra `search`)."),
        click.option("--family", "families", multiple=True, metavar="F", help="hard: only this family; may repeat."),
        click.option(
            "--budget",
            type=click.IntRange(1, 100_000),
            default=BUDGET,
            show_default=True,
            help="hard: new candidates per family, rounded up to batches of 8.",
        ),
        click.option(
            "--start-from",
            metavar="SUITE",
            help="hard: begin with the scenarios of this suite of the hard tier, not with random ones.",
        ),
        click.option(
            "--search-folder",
            type=click.Path(path_type=Path, file_okay=False),
            help="hard: journal, archive and pictures of the search.  [default: OUT.search]",
        ),
        click.option("--fresh", is_flag=True, help="hard: drop what the search folder holds."),
        click.option("--no-search", is_flag=True, help="hard: only choose from what the search folder holds."),
        workers_option,
    )
    for option in reversed(options):
        function = option(function)
    return function


def check_hard_options(options: Mapping[str, Any], category: str | None) -> None:
    """Raise click.UsageError for options that do not go with --hard, or only with it."""
    given = click.get_current_context().get_parameter_source
    typed = [name for name in (*HARD_ONLY, *NOT_HARD) if given(name) is click.core.ParameterSource.COMMANDLINE]
    if options["hard"] and category is not None:
        raise click.UsageError("--hard chooses families, so --category does not go with it; --family names one")
    for name in typed:
        option = "--family" if name == "families" else "--" + name.replace("_", "-")
        if options["hard"] != (name in HARD_ONLY):
            raise click.UsageError(f"{option} goes {'only' if name in HARD_ONLY else 'not'} with --hard")


def generate_hard(ctx: click.Context, options: Mapping[str, Any], secret: str, out: Path) -> int:
    """Search, choose, write the suite and return the exit code; Ctrl-C ends the command with 130."""
    check_search_library()
    families = find_families(options["families"])
    check_output_folder(out)
    about = _describe_suite(out, options)
    folder: Path = options["search_folder"] or out.parent / f"{out.name}.search"
    start, checksum = load_start(options["start_from"]) if options["start_from"] else ({}, "")
    seed = SearchSeed(options["seed"], options["split"], secret, checksum)
    known = KNOWN_SUITES + ((HARD_SUITE,) if secret and HARD_SUITE in list_packaged_suites() else ())
    search = SearchSettings(families, options["budget"], seed, options["workers"], known, start)
    display = SearchDisplay()
    try:
        with open_journal(folder, search.fingerprint, fresh=options["fresh"]) as opened:
            if opened.torn:
                display.note("the last line of the journal was incomplete and has been dropped")
            journal = SearchJournal(opened)
            searches = run_search(search, journal, display, only_kept=options["no_search"])
            display.close()
            save_archive_file(build_archive_file(searches), folder)
            selection = SelectionSettings(options["count"] or HARD_COUNT, options["workers"])
            passed = [one for search in searches for one in search.evaluations if one.figures is not None]
            chosen = select_checked_elites(passed, selection, journal, display.note)
    except KeyboardInterrupt:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # a second Ctrl-C must not swallow the answer to the first
        display.close()
        again = "the same command" + (" without --fresh" if options["fresh"] else "")
        echo(f"interrupted; {again} continues {folder}, with --no-search it chooses from what is there", err=True)
        ctx.exit(130)
    content = build_archive_file(searches, {one.scenario.id for one in chosen})
    save_archive_file(content, folder)
    draw_archives(content, folder)
    echo(_format_searches(searches))
    if not chosen:
        raise InputError(
            f"{folder}: expected a scenario among {len(passed)} candidates, found none; a larger --budget helps"
        )
    need = {name: check.need for name, check in journal.checks.items() if check.need is not None}
    write_hard_suite(about, chosen, need, out)
    echo(f"{folder}  archive.json, pictures and the journal of the search")
    echo(_format_chosen(chosen, selection.count, out))
    return 0 if len(chosen) == selection.count else 1


def _describe_suite(out: Path, options: Mapping[str, Any]) -> SuiteFile:
    title = "Hard tier: `omniscient` arrives in time, rules that see and talk do not"
    about = f"{options['split']} split, adversarial search, seed {options['seed']}"
    try:
        return SuiteFile(name=out.name, title=title, description=about, score_mode="hard")
    except ValidationError:
        raise InputError(
            f"--out {out}: expected a folder name of letters, digits and _.+- (at most 80), found {out.name!r}"
        ) from None


def _format_searches(searches: Sequence[FamilySearch]) -> str:
    return "\n".join(
        f"{one.family.category}: {len(one.elites)} elites of {len(one.evaluations)} candidates"
        f"{_format_rejections(one.evaluations)}"
        for one in searches
    )


def _format_rejections(evaluations: Sequence[CandidateEvaluation]) -> str:
    stages = Counter(str(one.stage) for one in evaluations if one.stage is not None)
    counts = ", ".join(f"{count} at {stage}" for stage, count in stages.most_common())
    return f"; rejected {counts}" if counts else ""


def _format_chosen(chosen: Sequence[ChosenElite], count: int, out: Path) -> str:
    evaluations = [one.evaluation for one in chosen]
    names = evaluations[0].measured.scores
    means = {name: sum(one.measured.scores[name] for one in evaluations) / len(chosen) for name in names}
    missed = list(find_missed_aims(evaluations, count))
    return (
        f"{len(chosen)} of {count} scenarios: {out}; {len({one.family for one in evaluations})} categories,"
        f" {sum(map(is_certified, evaluations))} certificates of need, {sum(map(is_on_corridor, evaluations))} on"
        f" corridors; mean scores {', '.join(f'{name} {mean:.1f}' for name, mean in means.items())}\n"
        + (f"aims missed: {'; '.join(missed)}" if missed else "all aims are met")
    )


class SearchDisplay:
    """Progress of a search on standard error: one live line on a terminal, one line per candidate elsewhere."""

    def __init__(self) -> None:
        self._live = sys.stderr.isatty()
        self._total = self._kept = self._done = self._elites = 0
        self._began = time.monotonic()

    def begin(self, total: int, kept: int) -> None:
        """See SearchProgress."""
        self._total, self._kept = total, kept
        if kept:
            self.note(f"continuing: the journal holds {kept} candidates")

    def evaluated(self, evaluation: CandidateEvaluation) -> None:
        """See SearchProgress."""
        self._done += 1
        self._elites += evaluation.figures is not None
        found = evaluation.figures
        result = (
            f"gap {found.gap:.1f}, unaided {found.unaided_score:.1f}, waiting {found.waiting_score:.1f}"
            if found
            else f"refused at {evaluation.stage}: {evaluation.reason}"
        )
        line = f"{self._kept + self._done}/{self._total}  {self._elites} kept  eta {self._format_eta()}"
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
