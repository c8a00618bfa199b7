"""Compare two runs: differences paired by scenario, with bootstrap confidence intervals."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from mdrive_sumo.core.data_frame import build_data_frame
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.statistics import (
    ConfidenceInterval,
    Label,
    bootstrap_nested,
    describe_comparisons,
    describe_too_few,
    format_interval_cells,
)
from mdrive_sumo.core.tables import format_text, make_text_table
from mdrive_sumo.runs.setting_differences import SettingDifference, find_setting_differences
from mdrive_sumo.scenario.season import SEASON_REMEDY, check_one_season
from mdrive_sumo.scoring import Results, RunInfo, ScenarioResult
from mdrive_sumo.scoring.summary import compute_means

if TYPE_CHECKING:
    import pandas as pd

OPTIONAL_SCORES = ("efficient_sr", "time_ratio")
"""Scores of a scenario that may be undefined."""
TIE = 0.005
"""Driving scores closer than this are a tie: half of the last digit that tables show."""


@dataclass(frozen=True, slots=True)
class ScenarioPair:
    """One scenario in both runs. Scores in percent."""

    scenario: str
    category: str
    ds: tuple[float, float]
    sr: tuple[float, float]
    efficient_sr: tuple[float | None, float | None] = (None, None)
    time_ratio: tuple[float | None, float | None] = (None, None)
    """Undefined (None) where not every CAV arrived."""

    @property
    def ds_difference(self) -> float:
        """Driving score of B minus that of A."""
        return self.ds[1] - self.ds[0]


@dataclass(frozen=True, slots=True)
class RunComparison:
    """B against A. Differences are B minus A: positive means that B is better."""

    names: tuple[str, str]
    """The runs' folders or files, or their agents where the place is unknown."""
    pairs: tuple[ScenarioPair, ...]
    """Sorted by difference, B's worst losses first."""
    ds: ConfidenceInterval
    sr: ConfidenceInterval
    efficient_sr: ConfidenceInterval | None
    """None without reference times."""
    time_ratio: ConfidenceInterval | None
    """Over the `timed` pairs; None if there are none."""
    timed: int
    """Pairs in which every CAV arrived in both runs."""
    left_out: tuple[str, ...]
    """Scenarios that could not be paired, each with the reason."""
    warnings: tuple[str, ...]
    settings: tuple[SettingDifference, ...] = ()
    """Settings that differ, such as the agent or the channel."""
    agents: tuple[str, str] = ("", "")
    suites: tuple[str, str] = ("", "")
    """Suite with season and checksum of each, as `RunInfo.describe_suite` has them."""

    def count_wins_ties_losses(self) -> tuple[int, int, int]:
        """Scenarios that B wins, ties and loses by driving score."""
        differences = [pair.ds_difference for pair in self.pairs]
        wins = sum(d > TIE for d in differences)
        losses = sum(d < -TIE for d in differences)
        return wins, len(differences) - wins - losses, losses

    def __str__(self) -> str:
        return comparison_table(self)

    def to_frame(self) -> "pd.DataFrame":
        """Return one row per scenario with the scores of both runs, the worst losses of B first. Needs pandas."""
        return build_data_frame(
            {
                "scenario": pair.scenario,
                "category": pair.category,
                **{"ds_a": pair.ds[0], "ds_b": pair.ds[1], "sr_a": pair.sr[0], "sr_b": pair.sr[1]},
                **{"efficient_sr_a": pair.efficient_sr[0], "efficient_sr_b": pair.efficient_sr[1]},
                **{"time_ratio_a": pair.time_ratio[0], "time_ratio_b": pair.time_ratio[1]},
                "ds_difference": pair.ds_difference,
            }
            for pair in self.pairs
        )


def compare(
    a: Results,
    b: Results,
    places: tuple[Path | None, Path | None] = (None, None),
    *,
    mix_seasons: bool = False,
) -> RunComparison:
    """Pair two runs by scenario id; void scenarios are left out, because they say nothing about the agents.

    Of several seeds the mean scores of each scenario are compared; one that is void with any seed is left out.
    places: the folders or files of the runs, by which they are named. mix_seasons: runs of two seasons may be compared,
    by scenarios of the same id. Raises InputError for runs of different score modes, of two seasons otherwise, and if
    no scenario is left.
    """
    if not mix_seasons:
        suites = {f"{letter} ({one.run.agent})": one.run.suite for letter, one in zip("AB", (a, b), strict=True)}
        check_one_season("compare", suites, f"--mix-seasons compares scenarios of the same id, {SEASON_REMEDY}")
    if a.run.score_mode != b.run.score_mode:
        raise InputError(
            f"compare: expected runs of one score mode, found {a.run.score_mode} and {b.run.score_mode};"
            " `mdrive-sumo rescore` brings them together"
        )
    first, second = (average_seeds(results.scenarios) for results in (a, b))
    common = [name for name in first if name in second and "void" not in (first[name].status, second[name].status)]
    if not common:
        raise InputError("compare: expected runs with scenarios in common that are not void, found none")
    pairs = [_make_pair(first[name], second[name]) for name in common]
    labels = [(first[name].place or second[name].label[0], name) for name in common]
    ds, sr, efficient, ratio = (
        _compute_interval([getattr(pair, score) for pair in pairs], labels) for score in ("ds", "sr", *OPTIONAL_SCORES)
    )
    assert ds and sr, "defined in every scenario"
    return RunComparison(
        names=(str(places[0] or a.run.agent), str(places[1] or b.run.agent)),
        pairs=tuple(sorted(pairs, key=lambda pair: (pair.ds_difference, pair.scenario))),
        ds=ds,
        sr=sr,
        efficient_sr=efficient,
        time_ratio=ratio,
        timed=sum(None not in pair.time_ratio for pair in pairs),
        left_out=(
            *(f"{name}: only in A" for name in first if name not in second),
            *(f"{name}: only in B" for name in second if name not in first),
            *(f"{name}: void" for name in first if name in second and name not in common),
        ),
        warnings=tuple(_find_warnings(a, b)),
        settings=find_setting_differences(a.run, b.run, places),
        agents=(a.run.agent, b.run.agent),
        suites=(a.run.describe_suite(), b.run.describe_suite()),
    )


def _make_pair(a: ScenarioResult, b: ScenarioResult) -> ScenarioPair:
    efficient, ratios = ((getattr(a, name), getattr(b, name)) for name in OPTIONAL_SCORES)
    return ScenarioPair(a.id, a.category, (a.ds, b.ds), (a.sr, b.sr), efficient, ratios)


def _compute_interval(
    values: Sequence[tuple[float | None, float | None]], labels: Sequence[Label]
) -> ConfidenceInterval | None:
    """Return B - A over the pairs in which both are defined; None without one."""
    defined = [(b - a, label) for (a, b), label in zip(values, labels, strict=True) if a is not None and b is not None]
    return bootstrap_nested([one for one, _ in defined], [label for _, label in defined]) if defined else None


def _find_warnings(a: Results, b: Results) -> list[str]:
    compared = {
        "suite": (a.run.suite_label, b.run.suite_label),
        "suite checksum": (a.run.suite_checksum, b.run.suite_checksum),
        "seeds": (_list_seeds(a), _list_seeds(b)),
        "versions": select_shared_versions(a.run, b.run),
    }
    partial = [
        f"{letter} is partial: {len(results.scenarios)} of {results.planned} episodes are finished"
        for letter, results in zip("AB", (a, b), strict=True)
        if results.planned is not None
    ]
    warnings = [f"A and B differ in {what}: {x} and {y}" for what, (x, y) in compared.items() if x != y]
    warnings = partial + warnings
    tracks = (a.run.sensing_track, b.run.sensing_track)
    if all(tracks) and len(set(tracks)) > 1:
        warnings.append(f"A is in the {tracks[0]} track and B in the {tracks[1]} track, which are ranked apart")
    return warnings


def select_shared_versions(a: RunInfo, b: RunInfo) -> tuple[dict[str, str], dict[str, str]]:
    """Return the versions of the packages that both runs depend on: not ONNX Runtime, if one of the agents learned."""
    shared = a.versions.keys() & b.versions.keys()
    return {name: a.versions[name] for name in sorted(shared)}, {name: b.versions[name] for name in sorted(shared)}


def average_seeds(results: Iterable[ScenarioResult]) -> dict[str, ScenarioResult]:
    """Return a result for every scenario id, with the mean scores over its seeds; void if it is void with any."""
    by_id: dict[str, list[ScenarioResult]] = {}
    for result in results:
        by_id.setdefault(result.id, []).append(result)
    return {name: _average(found) for name, found in by_id.items()}


def _average(results: Sequence[ScenarioResult]) -> ScenarioResult:
    if len(results) == 1:
        return results[0]
    if void := next((result for result in results if result.status == "void"), None):
        return void
    return results[0].model_copy(update=compute_means(results).model_dump())


def _list_seeds(results: Results) -> str:
    return ", ".join(map(str, sorted({*results.run.all_seeds, *(result.seed for result in results.scenarios)})))


def comparison_table(comparison: RunComparison) -> str:
    """Return the comparison for the terminal: warnings, means, then scenario by scenario."""
    wins, ties, losses = comparison.count_wins_ties_losses()
    means = format_text(
        make_text_table(
            ("B - A", "mean", "95 % from", "to"),
            [
                _format_interval("DS", comparison.ds),
                _format_interval("SR", comparison.sr),
                _format_interval("efficient SR", comparison.efficient_sr),
                _format_interval(f"time ratio (of {comparison.timed})", comparison.time_ratio),
            ],
        )
    )
    rows = [
        (p.scenario, p.category, *map(_format_score, (*p.ds, *p.sr, *p.time_ratio)), f"{p.ds_difference:+.2f}")
        for p in comparison.pairs
    ]
    header = ("scenario", "category", "DS A", "DS B", "SR A", "SR B", "time A", "time B", "DS B - A")
    return "\n".join(
        (
            *_format_names(comparison),
            *(f"warning: {warning}" for warning in comparison.warnings),
            "",
            *_format_settings(comparison),
            "",
            means,
            *filter(None, (describe_too_few(comparison.ds), describe_comparisons(list_differences(comparison)))),
            f"B is better in {wins}, as good in {ties}, worse in {losses}",
            "",
            format_text(make_text_table(header, rows)),
            *(("", "left out:", *(f"  {line}" for line in comparison.left_out)) if comparison.left_out else ()),
        )
    )


def list_differences(comparison: RunComparison) -> tuple[ConfidenceInterval | None, ...]:
    """Return all differences of a comparison."""
    return comparison.ds, comparison.sr, comparison.efficient_sr, comparison.time_ratio


def _format_names(comparison: RunComparison) -> tuple[str, ...]:
    """Return the line that names both runs; a line for each where folders name them."""
    names, agents = comparison.names, comparison.agents
    shared = dict.fromkeys(comparison.suites)
    count = f"{len(comparison.pairs)} scenarios in both, of {' and '.join(shared)}"
    if names == agents:
        return (f"A = {names[0]}, B = {names[1]}, {count}",)
    lines = (f"{letter} = {name} ({agent})" for letter, name, agent in zip("AB", names, agents, strict=True))
    return (*lines, count)


def _format_settings(comparison: RunComparison) -> tuple[str, ...]:
    if not comparison.settings:
        return ("no setting differs" + (" but those above" if comparison.warnings else ""),)
    rows = [(difference.name, difference.a, difference.b) for difference in comparison.settings]
    return ("settings that differ:", format_text(make_text_table(("", "A", "B"), rows)))


def _format_score(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"


def _format_interval(name: str, interval: ConfidenceInterval | None) -> Sequence[str]:
    return (name, *format_interval_cells(interval, "+.2f"))
