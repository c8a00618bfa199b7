"""What a comparison page shows: several runs against the first of them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from string import ascii_uppercase

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.private_paths import hide_place
from mdrive_sumo.report.result_tables import describe_agent
from mdrive_sumo.report.run_page.run_page_data import EpisodeCell, ScenarioRow, build_run_page_data
from mdrive_sumo.runs.compare import TIE, RunComparison, compare, select_shared_versions
from mdrive_sumo.runs.stored_run import StoredRun, load_viewed_run
from mdrive_sumo.scenario.season import SEASON_REMEDY, check_one_season

MAX_RUNS = len(ascii_uppercase)
PairKey = tuple[str, str]
"""Scenario, letter of the run that is compared with the first."""


@dataclass(frozen=True, slots=True)
class ComparedRun:
    """One of the runs of a comparison."""

    letter: str
    folder: Path
    stored: StoredRun

    @property
    def place(self) -> str:
        """The folder as a page names it: never as an absolute path."""
        return hide_place(self.folder)

    @property
    def agent(self) -> str:
        """The agent with its labels."""
        return describe_agent(self.stored.results)


def load_compared_runs(folders: Sequence[Path], suite: str | None) -> tuple[ComparedRun, ...]:
    """Load runs and name them A, B, C in their order. suite: the suite's place now if it has moved.

    Raises InputError for a run that is named twice, and for runs of different suites, score modes or versions.
    """
    if len(folders) > MAX_RUNS:
        raise InputError(f"view: expected at most {MAX_RUNS} runs, found {len(folders)}")
    places = [folder.resolve() for folder in folders]
    if twice := next((folder for folder, place in zip(folders, places, strict=True) if places.count(place) > 1), None):
        raise InputError(f"view: expected different runs, found {str(twice)!r} twice")
    runs = tuple(
        ComparedRun(letter, folder, load_viewed_run(folder, suite))
        for letter, folder in zip(ascii_uppercase, folders, strict=False)
    )
    for run in runs[1:]:
        _check_comparable(runs[0], run)
    return runs


def _check_comparable(first: ComparedRun, other: ComparedRun) -> None:
    a, b = first.stored.results.run, other.stored.results.run
    places = {str(run.folder): run.stored.results.run.suite for run in (first, other)}
    check_one_season("view", places, SEASON_REMEDY)
    compared = {
        "suite": (a.describe_suite(), b.describe_suite()),
        "score mode": (a.score_mode, b.score_mode),
        "versions": tuple(
            ", ".join(f"{name} {version}" for name, version in sorted(versions.items()))
            for versions in select_shared_versions(a, b)
        ),
    }
    remedies = {
        "suite": "runs of one suite can be compared",
        "score mode": "`mdrive-sumo rescore` brings them together",
        "versions": "`mdrive-sumo compare` compares their scores with a warning",
    }
    for what, (first_value, other_value) in compared.items():
        if first_value != other_value:
            raise InputError(
                f"view: expected runs with the same {what}, found {first_value} in {first.folder} and {other_value} in"
                f" {other.folder}; {remedies[what]}"
            )


@dataclass(frozen=True, slots=True)
class ComparedCell:
    """One scenario in one run."""

    letter: str
    row: ScenarioRow | None
    """The scenario's row on the page of the run; None if the run has not driven it."""
    difference: float | None
    """DS minus that of the first run; None for the first run itself, and where a run is void or has none."""
    outcome: str
    """Compared with the first run: better, worse, equal, or "not compared"; "" for the first run itself."""
    in_step: str
    """Link to the replays of both in step; "" if there is none."""

    @property
    def is_void(self) -> bool:
        """Whether an episode of the scenario is void."""
        return self.row is not None and any(cell.outcome == "void" for cell in self.row.cells)

    @property
    def colour_step(self) -> int:
        """The colour of the cell: that of the mean over the seeds."""
        if self.row is None:
            return 0
        steps = {cell.colour_step for cell in self.row.cells}
        return steps.pop() if len(steps) == 1 else min(int(self.row.ds / 10), 9)

    @property
    def kinds(self) -> list[str]:
        """Kinds of all infractions, sorted."""
        return sorted({kind for cell in self.episodes for kind in cell.kinds})

    @property
    def has_failed_agent(self) -> bool:
        """Whether the agent of a CAV failed."""
        return any(cell.has_failed_agent for cell in self.episodes)

    @property
    def episodes(self) -> tuple[EpisodeCell, ...]:
        """Its episodes, one per seed."""
        return self.row.cells if self.row else ()


@dataclass(frozen=True, slots=True)
class ComparedRow:
    """One scenario in all runs."""

    id: str
    bucket: str
    category: str
    description: str
    cells: tuple[ComparedCell, ...]

    @property
    def worst(self) -> float:
        """The lowest difference from the first run; 0 if there is none."""
        return min((cell.difference for cell in self.cells if cell.difference is not None), default=0.0)

    @property
    def first_linked(self) -> ComparedCell | None:
        """The cell to whose replays in step the reasons of the first run lead, too."""
        return next((cell for cell in self.cells if cell.in_step), None)


@dataclass(frozen=True, slots=True)
class ComparisonData:
    """The content of a comparison page."""

    runs: tuple[ComparedRun, ...]
    rows: tuple[ComparedRow, ...]
    """One row for each scenario, the worst difference first."""
    comparisons: tuple[RunComparison, ...]
    """The comparison of every other run with the first."""
    seeds: Mapping[PairKey, int]
    """The seed of the replays in step: that with the largest difference."""

    def list_kinds(self) -> list[str]:
        """Return the kinds of all infractions, sorted."""
        return sorted({kind for row in self.rows for cell in row.cells for kind in cell.kinds})

    def find_replay(self, row: ComparedRow, cell: ComparedCell, seed: int) -> str:
        """Return the link to the replays in step that show an episode of a cell; "" if there are none."""
        shown = row.first_linked if cell is row.cells[0] else cell
        if shown is None or self.seeds.get((row.id, shown.letter)) != seed:
            return ""
        return shown.in_step

    @property
    def has_failed_agents(self) -> bool:
        """Whether the agent of a CAV failed in a run."""
        return any(cell.has_failed_agent for row in self.rows for cell in row.cells)


def build_comparison_data(runs: Sequence[ComparedRun], in_step: Mapping[PairKey, str], page: Path) -> ComparisonData:
    """Return the content of the page that compares runs with the first of them.

    in_step: links to the replays in step. page: the place of the page itself. Raises InputError if no scenario can be
    compared.
    """
    tables = [{row.id: row for row in build_run_page_data(run.stored, {}, page).rows} for run in runs]
    ids = dict.fromkeys(name for table in tables for name in table)
    rows = [_build_row(name, runs, [table.get(name) for table in tables], in_step) for name in ids]
    first = runs[0]
    return ComparisonData(
        tuple(runs),
        tuple(sorted(rows, key=lambda row: (row.worst, row.id))),
        tuple(compare(first.stored.results, other.stored.results, (first.folder, other.folder)) for other in runs[1:]),
        find_telling_seeds(runs),
    )


def find_telling_seeds(runs: Sequence[ComparedRun]) -> dict[PairKey, int]:
    """Return, for every scenario that another run shares with the first, the seed with the largest difference of DS.

    Of equal differences the first seed counts; seeds with which one of both is void are left out.
    """
    seed_by_pair: dict[PairKey, int] = {}
    first, *others = ({result.key: result for result in run.stored.results.scenarios} for run in runs)
    for other, run in zip(others, runs[1:], strict=True):
        largest: dict[str, float] = {}
        for key, result in first.items():
            pair = other.get(key)
            if pair is None or "void" in (result.status, pair.status):
                continue
            difference = abs(pair.ds - result.ds)
            if difference > largest.get(result.id, -1.0):
                largest[result.id] = difference
                seed_by_pair[result.id, run.letter] = result.seed
    return seed_by_pair


def _build_row(
    name: str, runs: Sequence[ComparedRun], rows: Sequence[ScenarioRow | None], in_step: Mapping[PairKey, str]
) -> ComparedRow:
    described = next(row for row in rows if row is not None)
    cells: list[ComparedCell] = []
    for run, row in zip(runs, rows, strict=True):
        is_first = run is runs[0]
        difference = None if is_first else _compute_difference(rows[0], row)
        outcome = "" if is_first else _name_outcome(difference)
        cells.append(ComparedCell(run.letter, row, difference, outcome, in_step.get((name, run.letter), "")))
    return ComparedRow(name, described.bucket, described.category, described.description, tuple(cells))


def _compute_difference(first: ScenarioRow | None, other: ScenarioRow | None) -> float | None:
    if first is None or other is None:
        return None
    if any(cell.outcome == "void" for cell in (*first.cells, *other.cells)):
        return None
    return other.ds - first.ds


def _name_outcome(difference: float | None) -> str:
    if difference is None:
        return "not compared"
    return "better" if difference > TIE else "worse" if difference < -TIE else "equal"
