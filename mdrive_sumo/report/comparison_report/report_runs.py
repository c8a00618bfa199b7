"""Load the runs of a report and check that their numbers can stand in one table."""

import hashlib
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.runs.journal import JOURNAL_FILE, read_fingerprint
from mdrive_sumo.runs.run_folder import load_run_results
from mdrive_sumo.runs.setting_differences import LIBRARY_CODE, compare_settings, list_settings
from mdrive_sumo.scenario.season import SEASON_REMEDY, check_one_season, split_suite_name
from mdrive_sumo.scoring import Results, load_results, summarize_run

MIX_REMEDY = f"--mix-seasons puts the seasons of an agent into one line, {SEASON_REMEDY}"
VERSIONS_THAT_COUNT = ("mdrive-sumo", "libsumo")
"""Packages whose releases change results; Python and NumPy do not (docs/decisions/030)."""


@dataclass(frozen=True, slots=True)
class ReportRun:
    """A run of a report: its results, and where they were found."""

    results: Results
    place: str
    """The folder or file; the agent of results without one."""
    settings: Mapping[str, Any]
    """As `list_settings` returns them, with the checksum of the library's code where it is known."""

    @classmethod
    def from_results(cls, results: Results, folder: Path | None = None) -> Self:
        """Return a run of loaded results. folder: its run folder, whose journal names more of its settings."""
        settings = list_settings(results.run, folder)
        if folder is not None and (folder / JOURNAL_FILE).is_file():
            settings[LIBRARY_CODE] = read_fingerprint(folder).get("code")
        return cls(results, str(folder or results.run.agent), settings)


def load_report_runs(places: Iterable[Path], *, mix_seasons: bool = False) -> tuple[ReportRun, ...]:
    """Load runs by their folders or results files. Raises InputError for what cannot stand in one report.

    mix_seasons: runs of an agent that differ in their season only become one run, over all scenarios of them.
    """
    listed = tuple(places)
    _check_places(listed)
    loaded = tuple(_load_run(place) for place in listed)
    runs = _keep_shared_scenarios(merge_seasons(loaded) if mix_seasons else loaded)
    check_report_runs(runs)
    return runs


def merge_seasons(runs: Sequence[ReportRun]) -> tuple[ReportRun, ...]:
    """Return runs that differ in their season only as one. Raises InputError for a scenario that is in two of them."""
    groups: list[list[ReportRun]] = []
    for run in runs:
        same = next((group for group in groups if _differ_in_season_only(group, run)), None)
        if same is None:
            groups.append([run])
        else:
            same.append(run)
    return tuple(_merge([*sorted(group, key=lambda run: run.results.run.suite)]) for group in groups)


def _differ_in_season_only(group: Sequence[ReportRun], run: ReportRun) -> bool:
    first = group[0].results.run
    return (
        not compare_settings(group[0].settings, run.settings)
        and first.all_seeds == run.results.run.all_seeds
        and split_suite_name(first.suite)[0] == split_suite_name(run.results.run.suite)[0]
        and run.results.run.season not in {"", *(other.results.run.season for other in group)}
    )


def _merge(runs: Sequence[ReportRun]) -> ReportRun:
    if len(runs) == 1:
        return runs[0]
    infos, scenarios = [run.results.run for run in runs], [one for run in runs for one in run.results.scenarios]
    twice = [name for name, count in Counter(one.key for one in scenarios).items() if count > 1]
    if twice:
        raise InputError(f"report: expected scenarios of one season each, found {twice[0][0]} in {len(runs)} seasons")
    seasons = ", ".join(info.season for info in infos)
    checksums = " ".join(info.suite_checksum for info in infos)
    about = {
        "suite": f"{split_suite_name(infos[0].suite)[0]}, seasons {seasons}",
        "suite_checksum": f"sha256:{hashlib.sha256(checksums.encode()).hexdigest()}",
    }
    planned = sum(run.results.planned or len(run.results.scenarios) for run in runs)
    merged = summarize_run(infos[0].model_copy(update=about), scenarios)
    if any(run.results.planned is not None for run in runs):
        merged = merged.model_copy(update={"planned": planned})
    return ReportRun(merged, ", ".join(run.place for run in runs), runs[0].settings)


def _keep_shared_scenarios(runs: Sequence[ReportRun]) -> tuple[ReportRun, ...]:
    """Return the runs, if some are partial with the scenarios that all have: other means could not be compared.

    Raises InputError if they share none.
    """
    if all(run.results.planned is None for run in runs):
        return tuple(runs)
    shared = set[str].intersection(*({result.id for result in run.results.scenarios} for run in runs))
    if not shared:
        raise InputError("report: expected runs with finished scenarios in common, found none yet")
    return tuple(replace(run, results=_keep_scenarios(run.results, shared)) for run in runs)


def _keep_scenarios(results: Results, names: Collection[str]) -> Results:
    """Return the results of some of the scenarios, marked as partial unless these are all."""
    kept = [result for result in results.scenarios if result.id in names]
    planned = results.planned or (len(results.scenarios) if len(kept) < len(results.scenarios) else None)
    return summarize_run(results.run, kept).model_copy(update={"planned": planned})


def check_report_runs(runs: Sequence[ReportRun]) -> None:
    """Raise InputError unless the runs have one suite, score mode, version and set of scenarios."""
    if not runs:
        raise InputError("report: expected at least one run, found none")
    for run in runs:
        if not run.results.scenarios:
            raise InputError(f"{run.place}: scenarios: expected at least one, found none")
    check_one_season("report", {run.place: run.results.run.suite for run in runs}, MIX_REMEDY)
    _check_shared(runs, "suite", [run.results.run.describe_suite() for run in runs])
    _check_shared(runs, "score mode", [run.results.run.score_mode for run in runs])
    _check_shared(runs, "version", [_describe_versions(run) for run in runs])
    _check_scenarios(runs)
    _check_groups(runs)


def _describe_versions(run: ReportRun) -> str:
    versions = run.results.run.versions
    return " ".join(f"{name} {versions[name]}" for name in VERSIONS_THAT_COUNT if name in versions)


def _check_places(places: Sequence[Path]) -> None:
    place_by_path: dict[Path, Path] = {}
    for place in places:
        if (path := place.resolve()) in place_by_path:
            raise InputError(f"report: expected every run once, found {str(place_by_path[path])!r} twice")
        place_by_path[path] = place


def _load_run(place: Path) -> ReportRun:
    if place.is_file():
        return replace(ReportRun.from_results(load_results(place)), place=str(place))
    return ReportRun.from_results(load_run_results(place), place)


def _check_shared(runs: Sequence[ReportRun], what: str, values: Sequence[str]) -> None:
    other = next((i for i, value in enumerate(values) if value != values[0]), None)
    if other is not None:
        raise InputError(
            f"report: expected runs of one {what}, found {values[0]} in {runs[0].place} and {values[other]} in"
            f" {runs[other].place}"
        )


def _check_groups(runs: Sequence[ReportRun]) -> None:
    """Raise InputError for a scenario that is in different groups: the file of one run was changed."""
    first_by_id: dict[str, tuple[ReportRun, tuple[str, str]]] = {}
    for run in runs:
        for drive in run.results.scenarios:
            first, groups = first_by_id.setdefault(drive.id, (run, (drive.bucket, drive.category)))
            if groups != (drive.bucket, drive.category):
                raise InputError(
                    f"report: expected scenario {drive.id} in one bucket and category, found {groups[0]}, {groups[1]}"
                    f" in {first.place} and {drive.bucket}, {drive.category} in {run.place}"
                )


def _check_scenarios(runs: Sequence[ReportRun]) -> None:
    """Raise InputError for runs of different scenarios: their means could not be compared."""
    first = {scenario.id for scenario in runs[0].results.scenarios}
    for run in runs[1:]:
        names = {scenario.id for scenario in run.results.scenarios}
        if names != first:
            example = min(first ^ names)
            only = runs[0].place if example in first else run.place
            raise InputError(
                f"report: expected runs of the same scenarios, found {len(first)} in {runs[0].place} and {len(names)}"
                f" in {run.place}; {example} is only in {only}"
            )
