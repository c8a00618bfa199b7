"""Write published tables anew from the values of their runs: docs/results/values/NAME.parquet.

    python -m tools.write_published_tables [--values NAME RUN...] [--dry-run]

A page marks a table with the lines `<!-- values:NAME:TABLE:begin -->` and `<!-- values:NAME:TABLE:end -->`, where TABLE
is one of those below. RUN is a folder of `mdrive-sumo eval` or of a study, or a results file: all results below it
become the file of that name; of `study twins`, the scores that are compared. RUN may also be the folder of tables of
`learn evaluate-detectors`: its `detectors.json` becomes docs/results/values/NAME.json. A test compares pages and files.
"""

import re
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from itertools import product
from pathlib import Path
from typing import TypeVar

import click

from mdrive_sumo.agents.registry import DEFENDED_AGENTS
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.input_files import read_text
from mdrive_sumo.core.output_files import copy_file, make_parents, write_text
from mdrive_sumo.core.statistics import TOO_FEW_NOTE, Verdict, describe_comparisons
from mdrive_sumo.core.tables import (
    TOO_FEW,
    format_markdown,
    join_paragraphs,
)
from mdrive_sumo.core.terminal import echo
from mdrive_sumo.learning.fusion import detector_tables
from mdrive_sumo.learning.fusion.detector_tables import DetectorSummary
from mdrive_sumo.learning.fusion.detectors_file import DETECTORS_FILE, read_detectors
from mdrive_sumo.open_loop import OPEN_LOOP_FILE, OpenLoopResults
from mdrive_sumo.runs.evaluate import RESULTS_FILE
from mdrive_sumo.scenario.scenario import load_model
from mdrive_sumo.scoring import Results, load_results
from mdrive_sumo.sensing.sensing_profile import SensingProfile
from mdrive_sumo.study.attacks import ATTACKS, AttackRow, describe_defence, summarise_attacks
from mdrive_sumo.study.attacks_files import build_attacks_table
from mdrive_sumo.study.conditions import BASE, ChannelCondition
from mdrive_sumo.study.gain import AGENTS, CELLS, METRICS, GainRow, GainSummary, summarise_gain
from mdrive_sumo.study.gain_files import build_gain_table, build_score_table, judge_gains
from mdrive_sumo.study.seasons import SeasonRow, summarise_seasons
from mdrive_sumo.study.seasons_files import build_seasons_table
from mdrive_sumo.study.study_files import LOADS, build_study_table, count_by_chance
from mdrive_sumo.study.study_runs import StudyRow
from mdrive_sumo.study.study_summary import summarise_rows
from mdrive_sumo.study.twin_scenarios import TwinFactor
from mdrive_sumo.study.twins import ORIGINAL
from mdrive_sumo.v2x.attacks.attack_settings import NO_ATTACK
from mdrive_sumo.v2x.comm_settings import parse_comm
from tools.aim_tables import (
    MeasuredDrivers,
    SuiteFigure,
    format_drivers,
    format_figures,
    list_hard_figures,
    list_log_figures,
)
from tools.codriving_values import list_budget_table, list_message_gains
from tools.detector_values import list_detector_order
from tools.paper_values import CLOSED, find_paper_part, list_paper_table, list_shown_runs
from tools.paper_values import TABLES as PAPER_TABLES
from tools.published_values import (
    BUDGET_PART,
    WHOLE,
    Values,
    read_opened,
    read_values,
    write_values,
)
from tools.tool_command import HELP, ToolCommand, dry_run_option
from tools.twin_values import list_originals, list_twins, pair_runs

ROOT = Path(__file__).parents[1]
DOCS, VALUES = Path("docs"), Path("docs/results/values")
MARK = re.compile(r"(<!-- values:([\w-]+):([\w-]+):begin -->\n).*?(<!-- values:\2:\3:end -->)", re.DOTALL)
WITHOUT_FILE = "The values of these runs were not kept", "No runs are published yet"
"""What a marked table says that has no file."""
KeyT = TypeVar("KeyT", bound=Hashable)
Runs = Sequence[Results]
Paragraphs = Sequence[str]
"""Of a marked table: what was measured, the table, what it carries; empty ones are left out."""


def _group_runs(runs: Runs, name: Callable[[Results], KeyT]) -> Mapping[tuple[str, KeyT], tuple[Results, ...]]:
    """Return runs by agent and another setting, in the order in which they come."""
    groups: dict[tuple[str, KeyT], list[Results]] = {}
    for results in runs:
        groups.setdefault((results.run.agent, name(results)), []).append(results)
    return {key: tuple(found) for key, found in groups.items()}


def _summarise_gain(runs: Runs) -> GainSummary:
    _describe_runs(runs)
    groups = _group_runs(runs, lambda results: str(results.run.conditions["sensing"]))
    seeds = {key: sorted(seed for results in found for seed in results.run.all_seeds) for key, found in groups.items()}
    wanted = next(iter(seeds.values()))
    cells = [cell for cell in product(SensingProfile, AGENTS) if cell in CELLS]
    for sensing, agent in cells:
        if (found := seeds.get((agent, sensing), [])) != wanted:
            raise InputError(f"table gain: expected {agent}, sensing {sensing}, with seeds {wanted}, found {found}")
    return summarise_gain([GainRow(sensing, agent, groups[agent, sensing]) for sensing, agent in cells])


def _list_seasons(runs: Runs, metric: str) -> Paragraphs:
    groups = _group_runs(runs, lambda results: results.run.season)
    summary = summarise_seasons([SeasonRow(*key, found) for key, found in groups.items()])
    counted = describe_comparisons([line.fresh_loss for line in summary.lines[metric]])
    return format_markdown(build_seasons_table(summary, metric)), counted


def _list_gain(runs: Runs) -> Paragraphs:
    summary = _summarise_gain(runs)
    verdicts = judge_gains(summary)
    shown = [
        f"{line.part.name} in {line.group} ({metric.upper()} {line.gain[metric].mean:+.1f})"
        for metric in METRICS
        for line, verdict in zip(summary.gains, verdicts[metric], strict=True)
        if verdict in (Verdict.GAIN, Verdict.LOSS)
    ]
    claims = f"Shown after correction, for DS and SR apart, and nothing beyond: {', '.join(shown) or 'nothing'}."
    counted = count_by_chance(line.gain for line in summary.gains)
    return _describe_runs(runs), format_markdown(build_gain_table(summary)), counted, claims


def _describe_runs(runs: Runs) -> str:
    """Return what was measured with which seeds, and what is left out. Raises InputError for runs of several suites."""
    suites = [*dict.fromkeys(results.run.describe_suite() for results in runs)]
    if len(suites) > 1:
        raise InputError(f"table: expected runs of one suite and season, found {suites[0]} and {suites[1]}")
    seeds = sorted({seed for results in runs for seed in results.run.all_seeds})
    places = {one.id: one.label[0] for results in runs for one in results.scenarios}
    void = sum(results.void for results in runs)
    left_out = f" {void} episodes are void and their scenarios left out." if void else ""
    return (
        f"Measured on {suites[0]}, scenarios: {len(places)}, places: {len({*places.values()})},"
        f" seeds: {', '.join(map(str, seeds))}.{left_out}"
    )


def _list_aims(runs: Runs, list_figures: Callable[[MeasuredDrivers], Iterable[SuiteFigure]]) -> Paragraphs:
    return _describe_runs(runs), *format_figures([*list_figures(MeasuredDrivers(runs))])


def _name_channel(results: Results) -> str:
    comm = parse_comm(results.run.comm)
    share = 0.0 if comm.radio is None else comm.radio.connected_background
    return f"{comm.preset}, {share:.0%} connected" if share else comm.preset


def _list_channels(runs: Runs) -> Paragraphs:
    """Scores of agents by channel; differences are to the channel of the first run."""
    groups = _group_runs(runs, _name_channel)
    _, base = next(iter(groups))
    for agent in dict.fromkeys(agent for agent, _ in groups):
        if (agent, base) not in groups:
            raise InputError(f"table channels: expected a run of {agent} over channel {base}, found none")
    rows = [
        StudyRow(
            agent, ChannelCondition(BASE if name == base else name, parse_comm(found[0].run.comm), {}), found, False
        )
        for (agent, name), found in groups.items()
    ]
    lines = summarise_rows(rows)
    counted = describe_comparisons([one for line in lines for one in (line.ds_difference, line.sr_difference)])
    return (
        _describe_runs(runs),
        format_markdown(build_study_table(lines)),
        f"Condition `{BASE}` is {base}. {LOADS}",
        counted,
    )


def _list_attacks(runs: Runs) -> Paragraphs:
    """Scores under attacks, beside the first agent that has no defence; drives without a defence have options."""

    def name(results: Results) -> tuple[bool | None, str]:
        is_defended = None if results.run.agent not in DEFENDED_AGENTS else not results.run.agent_config
        return is_defended, str(results.run.conditions["attack"])

    groups = _group_runs(runs, name)
    rows = [AttackRow(agent, *key, found) for (agent, key), found in groups.items()]
    if all(row.has_defence is not None for row in rows):
        raise InputError("table attacks: expected an agent without a defence, found none")
    for row in rows:
        if (row.agent, (row.has_defence, NO_ATTACK)) not in groups:
            said = describe_defence(row.has_defence)
            raise InputError(f"table attacks: expected an honest run of {row.agent}{said}, found none")
    order = {attack: i for i, attack in enumerate(dict.fromkeys((NO_ATTACK, *ATTACKS, *(row.attack for row in rows))))}
    rows.sort(key=lambda row: (row.has_defence is not None, row.agent, row.has_defence is False, order[row.attack]))
    summary = summarise_attacks(rows)
    counted = count_by_chance({"ds": line.to_alone["ds"]} for line in summary.lines if line.to_alone is not None)
    return _describe_runs(runs), format_markdown(build_attacks_table(summary)), counted


TABLES: Mapping[str, Callable[[Runs], Paragraphs]] = {
    "gain": _list_gain,
    "gain-scores": lambda runs: (format_markdown(build_score_table(_summarise_gain(runs))),),
    "seasons-ds": lambda runs: _list_seasons(runs, "ds"),
    "seasons-sr": lambda runs: _list_seasons(runs, "sr"),
    "hard-aims": lambda runs: _list_aims(runs, list_hard_figures),
    "v2xpnp-aims": lambda runs: _list_aims(runs, list_log_figures),
    "drivers": lambda runs: (format_drivers(MeasuredDrivers(runs)),),
    "channels": _list_channels,
    "attacks": _list_attacks,
    "message-gain": lambda runs: (_describe_runs(runs), *list_message_gains(runs)),
}
"""What a page can show of a file: tables of `study gain`, of `study seasons`, of the aims of suites, of `study comm`,
of `study attacks`, and of `codriving` beside its twins."""
DETECTOR_TABLES = {f"ap-{name}": write for name, write in detector_tables.TABLES.items()}
"""Tables of a file of `learn evaluate-detectors`."""
DETECTOR_ORDER, DETECTORS = "ap-ds", "detectors"
"""RQ3: the table of runs of agents behind detectors, and the file that holds the precisions of these."""
BUDGETS = "budgets"
"""The table of runs of `codriving`, whose files have a part for each budget (`BUDGET_PART`), and one for its twin."""
TWINS = "twins"
"""The table of `study twins`, whose files have a part for each factor and one for its originals."""


def _find_kind(values: Values) -> str:
    """Return what the runs of a file are of."""
    if WHOLE in values:
        return "single runs"
    if any(re.fullmatch(BUDGET_PART, part) for part in values):
        return "budgets"
    return "study paper" if CLOSED in values else "study twins"


def _format_runs(table: str, values: Values, opened: Sequence[OpenLoopResults]) -> Paragraphs:
    """Return a table of a file of runs. Raises InputError if the file is one of other runs."""
    kind = {TWINS: "study twins", BUDGETS: "budgets"}.get(
        table, "study paper" if table in PAPER_TABLES else "single runs"
    )
    if kind != (found := _find_kind(values)):
        raise InputError(f"table {table}: expected values of {kind}, found values of {found}")
    if table in PAPER_TABLES:
        return _describe_runs(list_shown_runs(table, values)), *list_paper_table(table, values, opened)
    if table == BUDGETS:
        return list_budget_table(values)
    if table == TWINS:
        return _describe_runs(list_originals(values)), *list_twins(values)
    return TABLES[table](values[WHOLE])


@dataclass(frozen=True, slots=True)
class FreshValues:
    """What some folders hold and no file of values has yet: runs with their open loop, or measured detectors."""

    runs: Values = field(default_factory=dict[str, Sequence[Results]])
    opened: Sequence[OpenLoopResults] = ()
    detectors: Path | None = None
    """A `detectors.json`."""


class _ValueFiles:
    """The files of values below a root; `fresh` takes the place of those of one name."""

    def __init__(self, root: Path, name: str, fresh: FreshValues | None) -> None:
        self._folder = root / VALUES
        self._fresh = {} if fresh is None else {name: fresh}
        self.find_runs = cache(self._find_runs)
        self.find_detectors = cache(self._find_detectors)

    def has(self, name: str, ending: str) -> bool:
        """Return whether there are values of this name."""
        return name in self._fresh or (self._folder / f"{name}{ending}").is_file()

    def _find_runs(self, name: str) -> tuple[Values, Sequence[OpenLoopResults]]:
        if (fresh := self._fresh.get(name)) is not None:
            return fresh.runs, fresh.opened
        path = self._folder / f"{name}.parquet"
        return read_values(path), read_opened(path)

    def _find_detectors(self, name: str) -> DetectorSummary:
        fresh = self._fresh.get(name)
        measured = None if fresh is None else fresh.detectors
        return read_detectors(measured or self._folder / f"{name}.json")

    def format_table(self, name: str, table: str) -> str:
        """Return a table of the file of a name. Raises InputError."""
        if table in DETECTOR_TABLES:
            parts = DETECTOR_TABLES[table](self.find_detectors(name))
        elif table == DETECTOR_ORDER:
            runs = self.find_runs(name)[0].get(WHOLE, ())
            parts = _describe_runs(runs), *list_detector_order(runs, self.find_detectors(DETECTORS))
        else:
            parts = _format_runs(table, *self.find_runs(name))
        text = join_paragraphs(parts)
        is_said = TOO_FEW not in text or TOO_FEW_NOTE in text
        return text if is_said else join_paragraphs((text.rstrip(), TOO_FEW_NOTE))


def fill_page(text: str, root: Path, page: str, name: str = "", fresh: FreshValues | None = None) -> str:
    """Return a page with its marked tables written anew. Raises InputError for an unknown table and for a bad file.

    fresh: values that are shown instead of those of the file `name`.
    """
    files = _ValueFiles(root, name, fresh)

    def fill(match: re.Match[str]) -> str:
        begin, name, table, end = match.groups()
        if table not in (known := (*TABLES, TWINS, BUDGETS, *PAPER_TABLES, DETECTOR_ORDER, *DETECTOR_TABLES)):
            raise InputError(f"{page}: table: expected one of {', '.join(known)}, found {table}")
        has_file = files.has(name, ".json" if table in DETECTOR_TABLES else ".parquet")
        if not has_file and any(words in match[0] for words in WITHOUT_FILE):
            return match[0]
        return f"{begin}\n{files.format_table(name, table)}\n{end}"

    return MARK.sub(fill, text)


def find_pages(root: Path) -> list[Path]:
    """Return the pages with marked tables, relative to the root."""
    pages = sorted((root / DOCS).rglob("*.md"))
    return [page.relative_to(root) for page in pages if MARK.search(read_text(page))]


def load_values(places: Sequence[Path]) -> Values:
    """Return all results below the places. Raises InputError where there are none, and for unfinished runs."""
    files = _find_files(places, RESULTS_FILE)
    if not files:
        raise InputError(f"expected runs, found no {RESULTS_FILE} below {', '.join(map(str, places)) or 'no folder'}")
    runs = [load_results(file) for file in files]
    for file, results in zip(files, runs, strict=True):
        if results.planned is not None:
            raise InputError(f"{file}: expected a finished run, found {len(results.scenarios)} of {results.planned}")
    names = [find_paper_part(file) or file.parent.name for file in files]
    parts = {name: [runs[i] for i, part in enumerate(names) if part == name] for name in names}
    if ORIGINAL in parts:
        return pair_runs({name: found for name, found in parts.items() if name in (ORIGINAL, *TwinFactor)})
    has_budgets = any(re.fullmatch(BUDGET_PART, name) for name in parts)
    return parts if CLOSED in parts or has_budgets else {WHOLE: runs}


def load_opened(places: Sequence[Path]) -> Sequence[OpenLoopResults]:
    """Return all results of open loop below the places. Raises InputError for an unreadable one."""
    return [load_model(file, OpenLoopResults) for file in _find_files(places, OPEN_LOOP_FILE)]


def load_fresh(places: Sequence[Path]) -> FreshValues:
    """Return what lies below the places: measured detectors or runs. Raises InputError."""
    measured = _find_files(
        [place for place in places if place.is_dir() or place.name == DETECTORS_FILE], DETECTORS_FILE
    )
    if len(measured) > 1:
        raise InputError(f"expected one {DETECTORS_FILE}, found {measured[0]} and {measured[1]}")
    if measured:
        return FreshValues(detectors=measured[0])
    return FreshValues(load_values(places), load_opened([one for one in places if one.is_dir()]))


def _write_fresh(folder: Path, name: str, fresh: FreshValues) -> None:
    if fresh.detectors is None:
        write_values(folder / f"{name}.parquet", fresh.runs, fresh.opened)
        return
    make_parents(folder / f"{name}.json")
    copy_file(fresh.detectors, folder / f"{name}.json")


def _find_files(places: Sequence[Path], name: str) -> list[Path]:
    return [file for place in places for file in ([place] if place.is_file() else sorted(place.rglob(name)))]


@click.command(cls=ToolCommand, context_settings=HELP)
@click.argument("runs", nargs=-1, type=click.Path(exists=True, path_type=Path))
@click.option("--values", default="", metavar="NAME", help="Write the values of the runs to docs/results/values/NAME.")
@dry_run_option
def main(runs: tuple[Path, ...], values: str, dry_run: bool) -> None:
    """Write marked tables of the documentation anew from docs/results/values."""
    if bool(values) != bool(runs):
        raise InputError("expected --values NAME with runs, found one without the other")
    fresh = load_fresh(runs) if values else None
    pages = {page: read_text(ROOT / page) for page in find_pages(ROOT)}
    filled = {page: fill_page(text, ROOT, str(page), values, fresh) for page, text in pages.items()}
    if fresh is not None and not dry_run:
        _write_fresh(ROOT / VALUES, values, fresh)
    for page in (page for page, text in pages.items() if filled[page] != text):
        if not dry_run:
            write_text(ROOT / page, filled[page])
        echo(f"{'would change' if dry_run else 'changed'}: {page}")


if __name__ == "__main__":
    main()
