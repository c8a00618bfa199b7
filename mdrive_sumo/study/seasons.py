"""The study of seasons: agents on season 0, which they may know by heart, and on fresh ones."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from statistics import fmean

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.statistics import ConfidenceInterval, bootstrap_nested
from mdrive_sumo.runs.evaluate import evaluate
from mdrive_sumo.runs.prepared_run import PreparedRun
from mdrive_sumo.runs.run_folder import load_run_results
from mdrive_sumo.scenario.season import FIRST_SEASON
from mdrive_sumo.scoring import Results, ScenarioResult, load_results
from mdrive_sumo.scoring.paired_intervals import group_by_scenario, list_results
from mdrive_sumo.study.study_runs import RUNS_FOLDER, StudyProgress, name_agent_folder

METRICS = ("ds", "sr")
OLD = str(FIRST_SEASON)
"""The season that everyone has had time to learn."""


@dataclass(frozen=True, slots=True)
class SeasonRow:
    """An agent in a season, with its results: of one run, or of several with different seeds."""

    agent: str
    season: str
    results: tuple[Results, ...]

    @property
    def scenarios(self) -> tuple[ScenarioResult, ...]:
        """The scenarios of all seeds."""
        return tuple(scenario for results in self.results for scenario in results.scenarios)

    @property
    def seeds(self) -> tuple[int, ...]:
        """The seeds of all runs, in ascending order."""
        return tuple(sorted(seed for results in self.results for seed in results.run.all_seeds))


@dataclass(frozen=True, slots=True)
class SeasonStudy:
    """The runs of the study. runs: prepared by agent and season, with all seeds; those of `given` are not driven."""

    runs: Mapping[tuple[str, str], PreparedRun]
    given: tuple[SeasonRow, ...]
    folder: Path

    def episodes(self) -> int:
        """Return the number of episodes that are not given."""
        return sum(len(run.scenarios) * len(run.config.seeds) for run in self.runs.values())

    def rows(self, progress: StudyProgress) -> Iterator[SeasonRow]:
        """Drive the unfinished runs and yield all rows. Raises InputError and KeyboardInterrupt."""
        yield from self.given
        for (agent, season), prepared in self.runs.items():
            folder = self.folder / RUNS_FOLDER / name_agent_folder(prepared.config.agent) / f"season_{season}"
            progress.run(f"{agent}, season {season}")
            run = prepared.with_config(replace(prepared.config, out=folder))
            yield SeasonRow(agent, season, (evaluate(run, progress),))


def load_given_rows(places: Iterable[Path]) -> tuple[SeasonRow, ...]:
    """Return a row for each agent and season of finished runs, folders or results files; runs may have one seed each.

    Raises InputError for runs without a season, and for an agent that has a seed of a season twice.
    """
    runs: dict[tuple[str, str], list[Results]] = {}
    for place in places:
        results = load_results(place) if place.is_file() else load_run_results(place)
        if not (season := results.run.season):
            raise InputError(f"{place}: expected a run of a suite with seasons, found {results.run.suite_label}")
        if results.planned is not None:
            raise InputError(f"{place}: expected a finished run, found {len(results.scenarios)} of {results.planned}")
        runs.setdefault((results.run.agent, season), []).append(results)
    rows = tuple(SeasonRow(agent, season, tuple(found)) for (agent, season), found in runs.items())
    for row in rows:
        if len(set(row.seeds)) < len(row.seeds):
            raise InputError(f"agent {row.agent}, season {row.season}: expected each seed once, found {row.seeds}")
    return rows


def check_rows(rows: Sequence[SeasonRow]) -> None:
    """Raise InputError unless all runs have one suite but for the season, one score mode, and every agent all seasons.

    Runs of a season must have one checksum.
    """
    first = rows[0].results[0].run
    checksums: dict[str, str] = {}
    for row in rows:
        for run in (results.run for results in row.results):
            _check_same("suite", first.suite.partition("@")[0], run.suite.partition("@")[0], row)
            _check_same("score mode", first.score_mode, run.score_mode, row)
            _check_same("checksum of the suite", checksums.setdefault(row.season, run.suite_checksum),
                        run.suite_checksum, row)  # fmt: skip
        _check_same("set of seeds", str(rows[0].seeds), str(row.seeds), row)
    found = {(row.agent, row.season) for row in rows}
    for agent in dict.fromkeys(row.agent for row in rows):
        if missing := [season for season in checksums if (agent, season) not in found]:
            raise InputError(f"study seasons: expected a run of {agent} in season {missing[0]}, found none")


def _check_same(what: str, expected: str, found: str, row: SeasonRow) -> None:
    if found != expected:
        raise InputError(
            f"study seasons: expected runs of one {what}, found {expected} and {found} ({row.agent}, season"
            f" {row.season})"
        )


@dataclass(frozen=True, slots=True)
class SeasonLine:
    """An agent's score in a metric [%]."""

    agent: str
    by_season: Mapping[str, float]
    """Mean over scenarios and seeds of each season."""
    mean: ConfidenceInterval
    """Mean over the seasons; the places of each season are resampled apart."""
    fresh_loss: ConfidenceInterval | None
    """Mean over the fresh seasons minus season 0; None unless there are both."""


@dataclass(frozen=True, slots=True)
class SeasonSummary:
    """The numbers of the study. A scenario that is void with any seed is left out of its agent's mean."""

    seasons: tuple[str, ...]
    lines: Mapping[str, tuple[SeasonLine, ...]]
    """By metric."""
    void: int
    """Episodes that are void."""


def summarise_seasons(rows: Sequence[SeasonRow]) -> SeasonSummary:
    """Return every agent's mean over seasons and what it loses from season 0 to fresh ones. Raises InputError."""
    check_rows(rows)
    seasons = tuple(sorted({row.season for row in rows}, key=lambda name: (not name.isdigit(), name.zfill(5))))
    by_key = {(row.agent, row.season): row for row in rows}
    agents = tuple(dict.fromkeys(row.agent for row in rows))
    lines = {
        metric: tuple(
            _summarise_agent(agent, {season: _select_results(by_key[agent, season]) for season in seasons}, metric)
            for agent in agents
        )
        for metric in METRICS
    }
    return SeasonSummary(seasons, lines, sum(one.status == "void" for row in rows for one in row.scenarios))


def _summarise_agent(agent: str, results: Mapping[str, Sequence[ScenarioResult]], metric: str) -> SeasonLine:
    """Return the line of an agent. Seasons are strata: a few of them cannot be drawn anew, and their places can."""
    values = {season: [getattr(one, metric) for one in members] for season, members in results.items()}
    by_season = {season: fmean(scores) for season, scores in values.items()}
    labels = {season: [one.label for one in members] for season, members in results.items()}
    strata = [season for season, members in results.items() for _ in members]

    def bootstrap(weights: Mapping[str, float]) -> ConfidenceInterval:
        return bootstrap_nested([*chain(*values.values())], [*chain(*labels.values())], strata, weights)

    fresh = [season for season in results if season != OLD]
    gain = {season: 1 / len(fresh) for season in fresh} | {OLD: -1.0}
    loss = bootstrap(gain) if fresh and OLD in results else None
    return SeasonLine(agent, by_season, bootstrap(dict.fromkeys(results, 1 / len(results))), loss)


def _select_results(row: SeasonRow) -> list[ScenarioResult]:
    """Return the results of a row. Raises InputError if all scenarios are void."""
    table = group_by_scenario(row.scenarios)
    if not table:
        raise InputError(f"study seasons: expected scenarios that are not void, found none ({row.agent}, {row.season})")
    return list_results(table)
