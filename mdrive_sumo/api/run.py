"""Run: the results of an evaluation with one seed or several; runs are loaded and compared."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, overload

from mdrive_sumo.api.episode import Episode, load_episode
from mdrive_sumo.api.verification import Permission, RunVerification
from mdrive_sumo.core.data_frame import build_data_frame
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.tables import Column, Table, format_text, make_row
from mdrive_sumo.export.export_run import export_runs
from mdrive_sumo.report.result_tables import SCORE_COLUMNS as SHOWN_COLUMNS
from mdrive_sumo.report.result_tables import format_optional, format_summary, list_scores
from mdrive_sumo.runs.compare import RunComparison
from mdrive_sumo.runs.compare import compare as compare_results
from mdrive_sumo.runs.process_pool import count_available_cores
from mdrive_sumo.runs.rescore import rescore_run
from mdrive_sumo.runs.run_folder import load_run_results
from mdrive_sumo.runs.stored_run import load_stored_run, load_unchecked_run
from mdrive_sumo.runs.verify import VerificationResult
from mdrive_sumo.scenario.season import check_one_season
from mdrive_sumo.scoring import (
    MeanIntervals,
    Means,
    Results,
    ScenarioResult,
    ScoreMode,
    compute_mean_intervals,
)
from mdrive_sumo.scoring.score_mode import parse_score_mode
from mdrive_sumo.scoring.summary import compute_means

if TYPE_CHECKING:
    import pandas as pd

SCORE_COLUMNS = (
    *("scenario", "seed", "bucket", "category", "status"),
    *("ds", "sr", "efficient_sr", "time_ratio", "rc", "ip", "min_ttc", "ticks"),
)

CAV_COLUMNS = (
    *("scenario", "seed", "cav", "outcome", "reason"),
    *("ds", "rc", "ip", "ticks", "time_ratio", "infractions"),
)


@dataclass(frozen=True, repr=False)
class Scores(Sequence[ScenarioResult]):
    """Results of scenarios, one per scenario and seed. DS, SR and RC are percentages, IP is a factor in [0, 1]."""

    results: tuple[ScenarioResult, ...]

    def __repr__(self) -> str:
        columns = Column("scenario", "scenario"), Column("seed", "seed", decimals=0, undefined="")
        rows = [make_row((result.id, result.seed, *list_scores(result))) for result in self.results]
        mean = make_row(("mean", None, *list_scores(self.mean)))
        return format_text(Table("scores", "Scores", (*columns, *SHOWN_COLUMNS), (*rows, mean)))

    def __len__(self) -> int:
        return len(self.results)

    def __iter__(self) -> Iterator[ScenarioResult]:
        return iter(self.results)

    @overload
    def __getitem__(self, index: int) -> ScenarioResult: ...
    @overload
    def __getitem__(self, index: slice) -> "Scores": ...
    def __getitem__(self, index: int | slice) -> "ScenarioResult | Scores":
        return Scores(self.results[index]) if isinstance(index, slice) else self.results[index]

    @property
    def mean(self) -> Means:
        """Mean of all scores, every scenario with the same weight. Void scenarios count as DS 0.

        Time ratio and efficient SR are means over the scenarios that have one.
        """
        return compute_means(self.results)

    def to_frame(self) -> "pd.DataFrame":
        """Return one row per scenario and seed, with the number of infractions that cost something. Needs pandas."""
        return build_data_frame(map(_describe_result, self.results), (*SCORE_COLUMNS, "infractions", "reason"))

    def cavs_to_frame(self) -> "pd.DataFrame":
        """Return one row per CAV: how it ended, its scores and the kinds of its infractions. Needs pandas."""
        return build_data_frame((row for result in self.results for row in _describe_cavs(result)), CAV_COLUMNS)


def _describe_result(result: ScenarioResult) -> dict[str, object]:
    infractions = sum(one.factor < 1.0 for ego in result.egos for one in ego.infractions)
    columns = {name: getattr(result, "id" if name == "scenario" else name) for name in SCORE_COLUMNS}
    return {**columns, "infractions": infractions, "reason": result.reason}


def _describe_cavs(result: ScenarioResult) -> Iterator[dict[str, object]]:
    for ego in result.egos:
        kinds = [infraction.kind for infraction in ego.infractions if infraction.factor < 1.0]
        yield {
            "scenario": result.id,
            "seed": result.seed,
            "cav": ego.id,
            "outcome": str(ego.outcome),
            "reason": ego.reason,
            "ds": ego.ds,
            "rc": ego.rc,
            "ip": ego.ip,
            "ticks": ego.ticks,
            "time_ratio": ego.time_ratio,
            "infractions": kinds,
        }


@dataclass(frozen=True)
class Run:
    """A finished evaluation: one run folder, as `mdrive-sumo eval` writes it, or several that were loaded together."""

    folders: tuple[Path, ...]
    results: tuple[Results, ...]
    """The contents of `results.json`, one for every folder."""

    @property
    def seeds(self) -> tuple[int, ...]:
        """The seeds in the order of the folders."""
        return tuple(seed for results in self.results for seed in results.run.all_seeds)

    @property
    def intervals(self) -> tuple[MeanIntervals, ...]:
        """Means of DS and SR by bucket and overall with 95 % bootstrap intervals over places, scenarios and seeds.

        Without bounds over fewer than ten scenarios.
        """
        return compute_mean_intervals(self.results[0].model_copy(update={"scenarios": tuple(self.scores)}))

    @property
    def scores(self) -> Scores:
        """The result of every scenario and seed."""
        return Scores(tuple(scenario for results in self.results for scenario in results.scenarios))

    def __str__(self) -> str:
        return "\n\n".join(format_summary(results) for results in self.results)

    def __repr__(self) -> str:
        info, mean = self.results[0].run, self.scores.mean
        return (
            f"Run(suite {info.suite_label!r}, agent {info.agent!r}, seeds {list(self.seeds)},"
            f" {len(self.scores)} episodes, DS {mean.ds:.2f}, SR {mean.sr:.2f},"
            f" efficient SR {format_optional(mean.efficient_sr)}, time ratio {format_optional(mean.time_ratio)})"
        )

    def worst(self, count: int = 10) -> Scores:
        """Return the scenarios with the lowest driving score, the lowest first; ties are ordered by id and seed."""
        return Scores(tuple(sorted(self.scores, key=lambda result: (result.ds, result.id, result.seed))[:count]))

    def episode(self, scenario: str | ScenarioResult, seed: int | None = None) -> Episode:
        """Return the recorded episode of a scenario: by its id, or by an entry of `scores`.

        seed: needed only to choose among several seeds; default: the first. Raises InputError.
        """
        if isinstance(scenario, ScenarioResult):
            scenario, seed = scenario.id, scenario.seed
        if seed is not None and seed not in self.seeds:
            raise InputError(f"episode: seed: expected one of {', '.join(map(str, self.seeds))}, found {seed}")
        seed = self.seeds[0] if seed is None else seed
        index = next(i for i, results in enumerate(self.results) if seed in results.run.all_seeds)
        run = load_stored_run(self.folders[index]).run
        return load_episode(run.find_recording((scenario, seed)), run.suite)

    def export(self, format: str, out: str | Path, scenarios: str | Sequence[str] = ()) -> Path:
        """Write the recordings in the format of another tool (docs/export.md) and return the folder.

        format: csv, parquet, fcd, scenarionet, commonroad, mcap or openscenario. out: a new or empty folder; of several
        seeds, each gets a folder in it. scenarios: ids, categories or globs; none: all. Raises InputError.
        """
        patterns = (scenarios,) if isinstance(scenarios, str) else tuple(scenarios)
        return export_runs([load_stored_run(folder) for folder in self.folders], format, Path(out), patterns)

    def rescore(self, mode: ScoreMode | str) -> "Run":
        """Return the run in another score mode, computed from its recordings without simulation."""
        stored = [load_stored_run(folder) for folder in self.folders]
        return Run(self.folders, tuple(rescore_run(stored_run, parse_score_mode(mode)) for stored_run in stored))

    def verify(
        self, sample: int | None = None, workers: int | None = None, *, trust_agent: bool = False, sandbox: bool = False
    ) -> list[VerificationResult]:
        """Execute the scenarios again, or a sample of each seed, and compare every tick and every number.

        trust_agent: whether a third-party agent, whose code the run folder names, may run with your permissions.
        sandbox: whether it runs in boxes. A file of the folder with another number than the second execution has a
        result of its own, with its name as `scenario`. Raises InputError without permission.
        """
        verifications: list[VerificationResult] = []
        for folder in self.folders:
            verification = RunVerification(load_unchecked_run(folder), Permission(trust_agent, sandbox), sample)
            verifications += verification.verify_episodes(workers or count_available_cores())
            files = [file for file in verification.verify_files() if file.differences]
            verifications += [VerificationResult(file.file, False, "; ".join(file.differences[:3])) for file in files]
        return verifications


def load_run(folder: str | Path | Iterable[str | Path]) -> Run:
    """Load the results of one run folder, or of several folders of one run with different seeds. Raises InputError.

    Of a run that is going on or was interrupted these are the results of its finished episodes (`Results.planned`).
    """
    folders = tuple(map(Path, (folder,) if isinstance(folder, str | Path) else folder))
    results = tuple(map(load_run_results, folders))
    suite_by_folder = {str(place): one.run.suite for place, one in zip(folders, results, strict=True)}
    check_one_season("load_run", suite_by_folder, "load each season by itself")
    return Run(folders, results)


def compare(run: Run | str | Path, other: Run | str | Path, *, mix_seasons: bool = False) -> RunComparison:
    """Return the paired differences `other` minus `run`, with 95 % bootstrap intervals over places and scenarios.

    Of several seeds the mean score of each scenario is compared; scenarios that are void with any seed are left out.
    mix_seasons: runs of two seasons may be compared, by scenarios of the same id. Raises InputError for runs with
    different score modes, of two seasons otherwise, or without a scenario in common.
    """
    first, second = (given if isinstance(given, Run) else load_run(given) for given in (run, other))
    places = (first.folders[0], second.folders[0])
    return compare_results(_join(first), _join(second), places, mix_seasons=mix_seasons)


def _join(run: Run) -> Results:
    """Return the results of all folders of a run as one."""
    return run.results[0].model_copy(update={"scenarios": tuple(run.scores)})
