"""Write published tables anew from the values of their runs: docs/results/values/NAME.parquet.

    python -m tools.write_published_tables [--values NAME RUN...] [--dry-run]

A page marks a table with the lines `<!-- values:NAME:TABLE:begin -->` and `<!-- values:NAME:TABLE:end -->`, where TABLE
is one of those below. RUN is a folder of `mdrive-sumo eval` or of a study, or a results file: all results below it
become the file of that name. A test compares the pages with the files.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import click

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.input_files import read_text
from mdrive_sumo.core.output_files import write_text
from mdrive_sumo.core.statistics import Verdict, describe_comparisons
from mdrive_sumo.core.tables import format_markdown
from mdrive_sumo.core.terminal import echo
from mdrive_sumo.report.comparison_report.compared_agent import make_agents_of_results
from mdrive_sumo.report.comparison_report.difference_tables import build_difference_table, compute_differences
from mdrive_sumo.report.comparison_report.score_tables import build_bucket_table
from mdrive_sumo.runs.evaluate import RESULTS_FILE
from mdrive_sumo.scoring import Results, load_results
from mdrive_sumo.sensing.sensing_profile import SensingProfile
from mdrive_sumo.study.gain import METRICS, GainRow, GainSummary, summarise_gain
from mdrive_sumo.study.gain_files import build_gain_table, build_score_table, judge_gains
from mdrive_sumo.study.seasons import SeasonRow, summarise_seasons
from mdrive_sumo.study.seasons_files import build_seasons_table
from tools.published_values import read_values, write_values
from tools.tool_command import HELP, ToolCommand, dry_run_option

ROOT = Path(__file__).parents[1]
DOCS, VALUES = Path("docs"), Path("docs/results/values")
MARK = re.compile(r"(<!-- values:([\w-]+):([\w-]+):begin -->\n).*?(<!-- values:\2:\3:end -->)", re.DOTALL)
NOT_KEPT = "The values of these runs were not kept"
"""What a marked table says that is older than its file."""
Runs = Sequence[Results]


def _group_runs(runs: Runs, name: Callable[[Results], str]) -> Mapping[tuple[str, str], tuple[Results, ...]]:
    """Return runs by agent and another setting, in the order in which they come."""
    groups: dict[tuple[str, str], list[Results]] = {}
    for results in runs:
        groups.setdefault((results.run.agent, name(results)), []).append(results)
    return {key: tuple(found) for key, found in groups.items()}


def _summarise_gain(runs: Runs) -> GainSummary:
    groups = _group_runs(runs, lambda results: str(results.run.conditions["sensing"]))
    return summarise_gain([GainRow(SensingProfile(key[1]), key[0], found) for key, found in groups.items()])


def _format_seasons(runs: Runs, metric: str) -> str:
    groups = _group_runs(runs, lambda results: results.run.season)
    summary = summarise_seasons([SeasonRow(*key, found) for key, found in groups.items()])
    counted = describe_comparisons([line.fresh_loss for line in summary.lines[metric]])
    return "\n\n".join(filter(None, (format_markdown(build_seasons_table(summary, metric)), counted)))


def _format_gain(runs: Runs) -> str:
    summary = _summarise_gain(runs)
    verdicts = judge_gains(summary)
    shown = [
        f"{line.part.name} in {line.group} ({metric.upper()} {line.gain[metric].mean:+.1f})"
        for metric in METRICS
        for line, verdict in zip(summary.gains, verdicts[metric], strict=True)
        if verdict in (Verdict.GAIN, Verdict.LOSS)
    ]
    counted = describe_comparisons([line.gain[metric] for line in summary.gains for metric in METRICS])
    facts = f"Measured on {runs[0].run.describe_suite()}, seeds {', '.join(map(str, _list_seeds(runs)))}."
    claims = f"Shown after correction, for DS and SR apart, and nothing beyond: {', '.join(shown) or 'nothing'}."
    return "\n\n".join(filter(None, (facts, format_markdown(build_gain_table(summary)), counted, claims)))


def _list_seeds(runs: Runs) -> list[int]:
    return sorted({seed for results in runs for seed in results.run.all_seeds})


def _format_differences(runs: Runs) -> str:
    table = build_difference_table(compute_differences(make_agents_of_results(runs)))
    return f"{format_markdown(table)}\n\n{table.note}"


TABLES: Mapping[str, Callable[[Runs], str]] = {
    "gain": _format_gain,
    "gain-scores": lambda runs: format_markdown(build_score_table(_summarise_gain(runs))),
    "seasons-ds": lambda runs: _format_seasons(runs, "ds"),
    "seasons-sr": lambda runs: _format_seasons(runs, "sr"),
    "scores": lambda runs: format_markdown(build_bucket_table(make_agents_of_results(runs))),
    "differences": _format_differences,
}
"""What a page can show of a file of values: the tables of `study gain`, `study seasons` and `report`."""


def fill_page(text: str, root: Path, page: str) -> str:
    """Return a page with its marked tables written anew. Raises InputError for an unknown table and for a bad file."""

    def fill(match: re.Match[str]) -> str:
        begin, name, table, end = match.groups()
        if table not in TABLES:
            raise InputError(f"{page}: table: expected one of {', '.join(TABLES)}, found {table}")
        if not (root / VALUES / f"{name}.parquet").is_file() and NOT_KEPT in match[0]:
            return match[0]
        return f"{begin}\n{TABLES[table](read_values(root / VALUES / f'{name}.parquet'))}\n\n{end}"

    return MARK.sub(fill, text)


def find_pages(root: Path) -> list[Path]:
    """Return the pages with marked tables, relative to the root."""
    pages = sorted((root / DOCS).rglob("*.md"))
    return [page.relative_to(root) for page in pages if MARK.search(read_text(page))]


def load_runs(places: Sequence[Path]) -> list[Results]:
    """Return all results below the places. Raises InputError where there are none, and for unfinished runs."""
    files = [file for place in places for file in ([place] if place.is_file() else sorted(place.rglob(RESULTS_FILE)))]
    if not files:
        raise InputError(f"expected runs, found no {RESULTS_FILE} below {', '.join(map(str, places)) or 'no folder'}")
    runs = [load_results(file) for file in files]
    for file, results in zip(files, runs, strict=True):
        if results.planned is not None:
            raise InputError(f"{file}: expected a finished run, found {len(results.scenarios)} of {results.planned}")
    return runs


@click.command(cls=ToolCommand, context_settings=HELP)
@click.argument("runs", nargs=-1, type=click.Path(exists=True, path_type=Path))
@click.option("--values", default="", metavar="NAME", help="Write the values of the runs to docs/results/values/NAME.")
@dry_run_option
def main(runs: tuple[Path, ...], values: str, dry_run: bool) -> None:
    """Write marked tables of the documentation anew from docs/results/values."""
    if bool(values) != bool(runs):
        raise InputError("expected --values NAME with runs, found one without the other")
    if values and not dry_run:
        write_values(ROOT / VALUES / f"{values}.parquet", load_runs(runs))
    for page in find_pages(ROOT):
        text = read_text(ROOT / page)
        if (filled := fill_page(text, ROOT, str(page))) != text:
            if not dry_run:
                write_text(ROOT / page, filled)
            echo(f"{'would change' if dry_run else 'changed'}: {page}")


if __name__ == "__main__":
    main()
