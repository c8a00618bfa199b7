"""What `hard` and V2XPnP have to tell apart, and whether they do: tables of docs/hard.md and docs/results/v2xpnp.md."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise, product
from typing import Self

from mdrive_sumo.core.setting import Scalar
from mdrive_sumo.core.statistics import ConfidenceInterval, describe_comparisons
from mdrive_sumo.core.tables import Column, Table, format_cell, format_markdown, make_row, make_text_columns
from mdrive_sumo.generate.hard.candidate_probes import BLIND, BOTH, SHARING, SINGLE
from mdrive_sumo.generate.hard.cautious_drivers import CAUTIOUS_DRIVERS, SPEEDING_DRIVERS
from mdrive_sumo.generate.hard.suite_aims import LADDER
from mdrive_sumo.generate.hard.suite_requirements import GIVEN_RANGE, LEAST_REFERENCE, MOST_UNAIDED
from mdrive_sumo.report.comparison_report.compared_agent import make_agents_of_results
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.scenario.reference_times import REFERENCE_AGENT
from mdrive_sumo.scoring import Results, RunInfo
from mdrive_sumo.scoring.paired_intervals import (
    ResultTable,
    compute_difference_interval,
    compute_score_interval,
    group_by_scenario,
)
from mdrive_sumo.sensing.sensing_profile import SensingProfile
from mdrive_sumo.study.study_files import make_interval_cell, make_interval_column

MEMORY, MOST_BY_HEART = "memory", 3.0
"""What repeats drives of season 0, and how much more than blind driving it may have on other seasons."""
PERFECT = f"{SINGLE}, sensing {SensingProfile.PERFECT}"
MOST_BLIND_ON_LOGS, SINGLE_ON_LOGS, LEAST_GAIN_ON_LOGS, LEAST_REFERENCE_ON_LOGS = 60.0, (75.0, 92.0), 2.0, 98.0
"""Aims of V2XPnP: open loop and worse channels can change nothing where blind driving has 84 and every rule 98."""
PERTURBATIONS: Mapping[str, Mapping[str, Scalar]] = {
    "6 ticks of latency": {"latency_ticks": 6.0},
    "pose error of 0.6 m and 0.6°": {"pose_error_m": 0.6, "pose_error_deg": 0.6},
}
"""The paper's (RQ5), by name: what they change of the channel."""
DS, CHANGE = make_interval_column("ds", "DS"), make_interval_column("change", "DS", has_sign=True)


@dataclass(frozen=True, slots=True)
class SuiteFigure:
    """A figure that a suite must have; `interval` is None where it was not measured."""

    name: str
    aim: str
    interval: ConfidenceInterval | None
    is_met: bool | None
    is_change: bool = False

    @classmethod
    def of_score(
        cls, name: str, interval: ConfidenceInterval | None, least: float | None = None, most: float | None = None
    ) -> Self:
        """Return a mean that lies between bounds, of which one may be missing."""
        parts = (f"{least:g} or more" if least is not None else "", f"{most:g} or less" if most is not None else "")
        is_met = None
        if interval is not None:
            is_met = (least is None or interval.mean >= least) and (most is None or interval.mean <= most)
        return cls(name, ", ".join(filter(None, parts)), interval, is_met)

    @classmethod
    def of_gain(cls, name: str, interval: ConfidenceInterval | None, least: float = 0.0) -> Self:
        """Return a difference that is at least so much, with an interval above 0."""
        aim = f"+{least:g} or more, interval above 0" if least else "interval above 0"
        is_met = None if interval is None else interval.is_clear and interval.mean > 0 and interval.mean >= least
        return cls(name, aim, interval, is_met, is_change=True)


class MeasuredDrivers:
    """The drivers of some runs by name: agent, options, and the conditions in which they differ."""

    def __init__(self, runs: Sequence[Results]) -> None:
        """Raise InputError for runs that cannot stand in one table."""
        agents = make_agents_of_results(runs)
        base = min((agent.results.run.comm for agent in agents), key=_measure_channel)
        self.tables: Mapping[str, ResultTable] = {
            name_driver(agent.results.run, base): group_by_scenario(agent.results.scenarios) for agent in agents
        }

    def score(self, name: str) -> ConfidenceInterval | None:
        """Return the mean DS of a driver; None where it was not driven."""
        return compute_score_interval(self.tables[name], "ds") if name in self.tables else None

    def subtract(self, name: str, base: str) -> ConfidenceInterval | None:
        """Return the paired difference of two drivers' DS; None where one was not driven."""
        if name not in self.tables or base not in self.tables:
            return None
        return compute_difference_interval(self.tables[name], self.tables[base], "ds")


def _measure_channel(comm: Mapping[str, Scalar]) -> list[float]:
    """Return how much a channel disturbs what `PERTURBATIONS` change."""
    return [float(comm.get(name, 0.0)) for changed in PERTURBATIONS.values() for name in changed]


def name_driver(run: RunInfo, base: Mapping[str, Scalar]) -> str:
    """Return the name of an agent with its options, sensing that is not realistic, and how its channel differs."""
    drivers = (*SPEEDING_DRIVERS, *CAUTIOUS_DRIVERS)
    names = {(one.agent, AgentSpec(one.agent, one.config).config_hash()): one.name for one in drivers}
    sensing = str(run.conditions["sensing"])
    changed = {name: value for name, value in run.comm.items() if name != "preset" and value != base.get(name)}
    known = [name for name, changes in PERTURBATIONS.items() if changes == changed]
    parts = (
        names.get((run.agent, run.agent_config), run.agent),
        "" if sensing == SensingProfile.REALISTIC else f"sensing {sensing}",
        *(known or (f"{name} {value}" for name, value in changed.items())),
    )
    return ", ".join(filter(None, parts))


def list_hard_figures(drivers: MeasuredDrivers) -> Iterator[SuiteFigure]:
    """Yield what a season of the hard tier has to have (docs/hard.md)."""
    of_score, score = SuiteFigure.of_score, drivers.score
    yield of_score(REFERENCE_AGENT, score(REFERENCE_AGENT), LEAST_REFERENCE)
    means = {name: found.mean for name in (SHARING, BOTH) if (found := score(name)) is not None}
    best = max(means, key=means.__getitem__, default=BOTH)
    yield of_score(f"{best}, the best rule", score(best), *GIVEN_RANGE)
    for name in (SINGLE, PERFECT, *(one.name for one in (*SPEEDING_DRIVERS, *CAUTIOUS_DRIVERS))):
        yield of_score(name, score(name), most=MOST_UNAIDED)
    by_heart = drivers.subtract(MEMORY, BLIND)
    yield SuiteFigure(
        f"{MEMORY} - {BLIND}", f"+{MOST_BY_HEART:g} or less", by_heart,
        None if by_heart is None else by_heart.mean <= MOST_BY_HEART, is_change=True,
    )  # fmt: skip
    for worse, better in pairwise(LADDER):
        yield SuiteFigure.of_gain(f"{better} - {worse}", drivers.subtract(better, worse))


def list_log_figures(drivers: MeasuredDrivers) -> Iterator[SuiteFigure]:
    """Yield what V2XPnP has to have (docs/results/v2xpnp.md)."""
    of_score, score = SuiteFigure.of_score, drivers.score
    yield of_score(BLIND, score(BLIND), most=MOST_BLIND_ON_LOGS)
    yield of_score(SINGLE, score(SINGLE), *SINGLE_ON_LOGS)
    for agent in (SHARING, BOTH):
        gain = drivers.subtract(agent, SINGLE)
        yield SuiteFigure.of_gain(f"{agent} - {SINGLE}", gain, LEAST_GAIN_ON_LOGS)
    yield of_score(REFERENCE_AGENT, score(REFERENCE_AGENT), LEAST_REFERENCE_ON_LOGS)
    effects = {
        (what, agent): drivers.subtract(f"{agent}, {what}", agent)
        for what, agent in product(PERTURBATIONS, (SHARING, BOTH))
    }
    for (what, agent), effect in effects.items():
        both = [effects[what, other] for other in (SHARING, BOTH)]
        is_met = None if effect is None else any(one is not None and one.is_clear for one in both)
        yield SuiteFigure(f"{agent}, {what}", "interval without 0 for one of the two", effect, is_met, is_change=True)


def format_figures(figures: Sequence[SuiteFigure]) -> tuple[str, str]:
    """Return a table of figures in Markdown, and how many of its differences chance explains."""
    columns = make_text_columns({"figure": "DS", "aim": "aim", "found": "measured", "met": "met"})
    rows = [
        make_row(
            (
                one.name,
                one.aim,
                "not measured"
                if one.interval is None
                else format_cell(make_interval_cell(one.interval), CHANGE if one.is_change else DS),
                "" if one.is_met is None else "yes" if one.is_met else "no",
            )
        )
        for one in figures
    ]
    table = format_markdown(Table("figures", "", columns, tuple(rows)))
    return table, describe_comparisons([one.interval for one in figures if one.is_change])


def format_drivers(drivers: MeasuredDrivers) -> str:
    """Return DS and SR of every driver in Markdown, the least DS first."""
    columns = (
        *make_text_columns({"driver": "driver"}),
        Column("scenarios", "scenarios", decimals=0),
        DS,
        make_interval_column("sr", "SR"),
    )
    scores = {
        name: [compute_score_interval(table, metric) for metric in ("ds", "sr")]
        for name, table in drivers.tables.items()
    }
    rows = [make_row((name, len(drivers.tables[name]), *map(make_interval_cell, scores[name]))) for name in scores]
    rows.sort(key=lambda row: row.cells[2].number or 0.0)
    return format_markdown(Table("drivers", "", columns, tuple(rows)))
