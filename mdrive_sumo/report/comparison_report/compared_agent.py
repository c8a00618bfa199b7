"""ComparedAgent: one agent with one set of settings, the line of a table; its runs with different seeds are pooled."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from mdrive_sumo.contract import SensingTrack
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.report.comparison_report.drive_conditions import (
    COMM,
    DriveConditions,
    find_differing_conditions,
    list_conditions,
)
from mdrive_sumo.report.comparison_report.report_runs import ReportRun, check_report_runs
from mdrive_sumo.report.result_tables import describe_partial
from mdrive_sumo.runs.setting_differences import LIBRARY_CODE, compare_settings, format_setting
from mdrive_sumo.scoring import MeanIntervals, Results, ScenarioResult, compute_mean_intervals, summarize_run
from mdrive_sumo.scoring.labels import JOINT, NEGOTIATION, PRIVILEGED, SHARING, SHARING_TYPES

SINGLE_AGENT, MULTI_AGENT = "Single-agent", "Multi-agent"
SENSOR_SINGLE, SENSOR_MULTI = "Sensor track: single-agent", "Sensor track: multi-agent"
UPPER_BOUND = "Privileged: an upper bound, not ranked"
SECTIONS = (SINGLE_AGENT, MULTI_AGENT, SENSOR_SINGLE, SENSOR_MULTI, UPPER_BOUND)
"""Headings of a table's rows, the first two as in the paper's main table: these agents are given lists of objects."""


@dataclass(frozen=True)
class ComparedAgent:
    """An agent with its settings. Those of one report have different names."""

    name: str
    """The name of the agent, with the settings in which others of the same name differ."""
    results: Results
    """The results of all its runs and seeds as one run."""
    runs: tuple[ReportRun, ...]
    conditions: DriveConditions
    """The conditions under which it was driven."""

    @cached_property
    def intervals(self) -> Mapping[str, MeanIntervals]:
        """The intervals of DS and SR by bucket, `BUCKET_MEAN` and `SCENARIO_MEAN`."""
        return {means.group: means for means in compute_mean_intervals(self.results)}

    @property
    def section(self) -> str:
        """The heading of its row, by the labels that its messages and declarations give it."""
        labels = self.results.run.labels
        if PRIVILEGED in labels:
            return UPPER_BOUND
        is_multi = not {SHARING, NEGOTIATION, JOINT}.isdisjoint(labels)
        if self.track:
            return SENSOR_MULTI if is_multi else SENSOR_SINGLE
        return MULTI_AGENT if is_multi else SINGLE_AGENT

    @property
    def track(self) -> str:
        """The track in which it is ranked: "sensor", or "" for the object track and for results without a track."""
        sensor = SensingTrack.SENSOR.value
        return sensor if self.results.run.sensing_track == sensor else ""

    @property
    def rank_group(self) -> str:
        """Places are given among agents with the same text: of one track, driven under the same conditions."""
        return f"{self.track} {self.conditions.rank_group}"

    @property
    def is_ranked(self) -> bool:
        """Whether it competes: what knows everything is a bound, and no competitor."""
        return self.section != UPPER_BOUND

    @property
    def shares_perception(self) -> bool:
        """Whether its CAVs exchange what they see; agents that negotiate may do both."""
        return any(SHARING_TYPES & {*scenario.exchanged} for scenario in self.results.scenarios)

    @property
    def negotiates(self) -> bool:
        """Whether its CAVs exchange anything beyond CAMs, CPMs, DENMs and features."""
        return NEGOTIATION in self.results.run.labels

    @property
    def seeds(self) -> tuple[int, ...]:
        """The seeds of all its runs."""
        return self.results.run.all_seeds


def make_compared_agents(runs: Iterable[ReportRun]) -> tuple[ComparedAgent, ...]:
    """Pool runs that differ in seeds only, and name the others by what differs; sections in the order of `SECTIONS`.

    Raises InputError for runs that cannot stand in one report, and for a seed that occurs twice.
    """
    checked = tuple(runs)
    check_report_runs(checked)
    groups: list[list[ReportRun]] = []
    for run in checked:
        same = next((group for group in groups if not compare_settings(group[0].settings, run.settings)), None)
        if same is None:
            groups.append([run])
        else:
            _check_new_seeds(same, run)
            same.append(run)
    conditions = list_conditions(groups)
    names = name_agents([group[0] for group in groups], conditions)
    pooled = [pool_results([run.results for run in group]) for group in groups]
    agents = [
        ComparedAgent(_mark_partial(name, results), results, tuple(group), its_conditions)
        for name, results, group, its_conditions in zip(names, pooled, groups, conditions, strict=True)
    ]
    return tuple(sorted(agents, key=lambda agent: SECTIONS.index(agent.section)))


def _mark_partial(name: str, results: Results) -> str:
    return f"{name} ({partial})" if (partial := describe_partial(results)) else name


def make_agents_of_results(results: Iterable[Results], folders: Iterable[Path] = ()) -> tuple[ComparedAgent, ...]:
    """As `make_compared_agents`, of loaded results. folders: their run folders, in the same order, or none."""
    loaded, places = tuple(results), tuple(folders)
    folder_of = places or (None,) * len(loaded)
    return make_compared_agents(
        ReportRun.from_results(run, place) for run, place in zip(loaded, folder_of, strict=True)
    )


def _check_new_seeds(group: Sequence[ReportRun], run: ReportRun) -> None:
    for other in group:
        if common := {*other.results.run.all_seeds} & {*run.results.run.all_seeds}:
            raise InputError(
                f"report: expected an agent with the same settings and seed once, found {run.results.run.agent} with"
                f" seed {min(common)} in {other.place} and {run.place}"
            )


def pool_results(results: Sequence[Results]) -> Results:
    """Return the results of runs that differ in seeds only as one run; its seeds are sorted."""
    if len(results) == 1:
        return results[0]
    scenarios: list[ScenarioResult] = [scenario for run in results for scenario in run.scenarios]
    seeds = tuple(sorted(seed for run in results for seed in run.run.all_seeds))
    labels = tuple(dict.fromkeys(label for run in results for label in run.run.labels))
    info = results[0].run.model_copy(update={"seed": seeds[0], "seeds": seeds, "labels": labels})
    is_partial = any(run.planned is not None for run in results)
    planned = sum(run.planned or len(run.scenarios) for run in results) if is_partial else None
    pooled = summarize_run(info, sorted(scenarios, key=lambda scenario: (scenario.seed, scenario.id)))
    return pooled.model_copy(update={"planned": planned})


def name_agents(runs: Sequence[ReportRun], conditions: Sequence[DriveConditions]) -> list[str]:
    """Return a name for each run: its agent, and in brackets the conditions in which any runs differ.

    Runs of the same agent are also named by the agent's own settings that differ.
    """
    names = [_name_agent(i, runs, conditions, hidden=(LIBRARY_CODE,)) for i in range(len(runs))]
    if len(set(names)) < len(names):
        names = [_name_agent(i, runs, conditions) for i in range(len(runs))]
    return [name if (before := names[:i].count(name)) == 0 else f"{name} #{before + 1}" for i, name in enumerate(names)]


def _name_agent(
    i: int, runs: Sequence[ReportRun], conditions: Sequence[DriveConditions], hidden: Sequence[str] = ()
) -> str:
    run = runs[i]
    agent = run.results.run.agent
    parts = conditions[i].format(find_differing_conditions(conditions))
    same_agent = (other.settings for other in runs if other.results.run.agent == agent)
    differing = {difference.name for other in same_agent for difference in compare_settings(run.settings, other)} - {
        *hidden
    }
    parts += [
        f"{name.removeprefix('agent config ')} {format_setting(run.settings.get(name))}"
        for name in run.settings
        if name in differing and name not in conditions[i].values and not name.startswith(COMM)
    ]
    return f"{agent} ({', '.join(parts)})" if parts else agent


def describe_code(run: ReportRun) -> str:
    """Return the short checksum of the library's code that drove a run; "" if it is unknown."""
    code = run.settings.get(LIBRARY_CODE)
    return format_setting(code) if code else ""
