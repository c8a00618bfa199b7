"""Differences of every agent to every other, or to a baseline: paired by scenario and seed."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.statistics import (
    METHOD_NOTE,
    TOO_FEW_NOTE,
    ConfidenceInterval,
    ResampledMean,
    describe_comparisons,
)
from mdrive_sumo.core.suggestion import suggest_name
from mdrive_sumo.core.tables import (
    Cell,
    CellValue,
    Column,
    IntervalStyle,
    Row,
    Table,
    make_row,
)
from mdrive_sumo.report.comparison_report.compared_agent import ComparedAgent
from mdrive_sumo.report.published_results import order_buckets
from mdrive_sumo.runs.compare import TIE, average_seeds
from mdrive_sumo.scoring import ScenarioResult
from mdrive_sumo.scoring.paired_intervals import (
    ResultTable,
    compute_difference_interval,
    group_by_scenario,
    list_results,
    resample_score,
)

DIFFERENCE_NOTE = (
    "Differences agent minus other, paired by scenario and, where both have it, by seed. Void scenarios are left out."
    f" {METHOD_NOTE} {TOO_FEW_NOTE}"
)
_LABELS = {"ds": "DS", "sr": "SR", "efficient_sr": "efficient SR", "time_ratio": "time ratio"}


@dataclass(frozen=True, slots=True)
class AgentDifference:
    """One agent minus another. Intervals are None where nothing can be paired."""

    agent: str
    other: str
    scenarios: int
    """Number of scenarios in which neither agent is void."""
    seeds: tuple[int, ...]
    """Seeds that both have, by which they are paired; empty: means over the seeds of each are."""
    ds: ConfidenceInterval | None
    """Over scenarios, as `mdrive-sumo compare` has it."""
    sr: ConfidenceInterval | None
    efficient_sr: ConfidenceInterval | None
    time_ratio: ConfidenceInterval | None
    """Over the scenarios in which every CAV arrives with both, with every seed."""
    buckets: dict[str, tuple[ConfidenceInterval | None, ConfidenceInterval | None]]
    """Differences of DS and SR [percentage points] by bucket."""
    bucket_mean: tuple[ConfidenceInterval | None, ConfidenceInterval | None]
    """Differences of DS and SR, means of the buckets [percentage points]."""
    wins: int
    """Number of scenarios in which the agent has a higher DS, as a mean over seeds."""
    losses: int


def compute_differences(agents: Sequence[ComparedAgent], baseline: str = "") -> tuple[AgentDifference, ...]:
    """Return the difference of every agent to the baseline, or of every pair: upper bounds first, then by DS.

    Raises InputError if no agent has the baseline's name.
    """
    resamples = _Resamples()
    if baseline:
        base = find_compared_agent(agents, baseline)
        return tuple(_compute_difference(agent, base, resamples) for agent in agents if agent is not base)
    ordered = sorted(agents, key=lambda agent: (agent.is_ranked, -agent.results.overall.bucket_mean.ds))
    pairs = ((agent, other) for i, agent in enumerate(ordered) for other in ordered[i + 1 :])
    return tuple(_compute_difference(agent, other, resamples) for agent, other in pairs)


def find_compared_agent(agents: Sequence[ComparedAgent], name: str) -> ComparedAgent:
    """Return the agent of a name, which may leave out that its run is partial. Raises InputError."""
    names = [agent.name for agent in agents]
    names = [full if name == full else full.partition(" (partial: ")[0] for full in names]
    if name not in names:
        suggestion = suggest_name(name, names)
        raise InputError(f"--baseline: expected one of {', '.join(names)}, found {name!r:.60}{suggestion}")
    return agents[names.index(name)]


def _compute_difference(agent: ComparedAgent, other: ComparedAgent, resamples: "_Resamples") -> AgentDifference:
    """Return agent minus other."""
    seeds = tuple(seed for seed in agent.seeds if seed in other.seeds)
    ours, theirs = (_build_result_table(side, seeds) for side in (agent, other))
    common = [scenario for scenario in ours if scenario in theirs]
    ours, theirs = (_select_common(table, other, common) for table, other in ((ours, theirs), (theirs, ours)))
    pair = _TablePair((agent.name, ours), (other.name, theirs), resamples)
    buckets = order_buckets({scenario.bucket for scenario in agent.results.scenarios})
    parts = {name: pair.select(lambda result, name=name: result.bucket == name) for name in buckets}
    timed = pair.select(lambda result: result.time_ratio is not None)
    gains = [_mean_ds(ours, scenario) - _mean_ds(theirs, scenario) for scenario in common]
    return AgentDifference(
        agent.name,
        other.name,
        scenarios=len(common),
        seeds=seeds,
        ds=pair.subtract("ds"),
        sr=pair.subtract("sr"),
        efficient_sr=pair.select(lambda result: result.efficient_sr is not None).subtract("efficient_sr"),
        time_ratio=compute_difference_interval(timed.ours[1], timed.theirs[1], "time_ratio"),  # seldom two pairs alike
        buckets={name: (part.subtract("ds"), part.subtract("sr")) for name, part in parts.items()},
        bucket_mean=(pair.subtract("ds", by_bucket=True), pair.subtract("sr", by_bucket=True)),
        wins=sum(gain > TIE for gain in gains),
        losses=sum(gain < -TIE for gain in gains),
    )


class _Resamples:
    """Resampled scores of tables that were asked for: most pairs of agents share all scenarios and seeds."""

    def __init__(self) -> None:
        self._known: dict[tuple[object, ...], ResampledMean | None] = {}

    def find(self, agent: str, table: ResultTable, score: str, *, by_bucket: bool) -> ResampledMean | None:
        key = (agent, score, by_bucket, *(result.label for result in list_results(table)))
        if key not in self._known:
            self._known[key] = resample_score(table, score, by_bucket=by_bucket)
        return self._known[key]


@dataclass(frozen=True, slots=True)
class _TablePair:
    """The results of two agents in the same scenarios and with the same seeds, each with the agent's name."""

    ours: tuple[str, ResultTable]
    theirs: tuple[str, ResultTable]
    resamples: _Resamples

    def select(self, is_chosen: Callable[[ScenarioResult], bool]) -> "_TablePair":
        """Return the scenarios in which all results of both are chosen."""
        chosen = [
            name
            for name in self.ours[1]
            if all(is_chosen(result) for table in (self.ours[1], self.theirs[1]) for result in table[name].values())
        ]
        ours, theirs = ((agent, {name: table[name] for name in chosen}) for agent, table in (self.ours, self.theirs))
        return _TablePair(ours, theirs, self.resamples)

    def subtract(self, score: str, *, by_bucket: bool = False) -> ConfidenceInterval | None:
        """Return mean and interval of the differences; None without a scenario."""
        ours, theirs = (self.resamples.find(*side, score, by_bucket=by_bucket) for side in (self.ours, self.theirs))
        return None if ours is None or theirs is None else ours.subtract(theirs)


def _build_result_table(agent: ComparedAgent, seeds: Sequence[int]) -> ResultTable:
    """Return the results that are not void by scenario and common seed; their means over all seeds if there is none."""
    if not seeds:
        means = average_seeds(agent.results.scenarios).values()
        return {result.id: {0: result} for result in means if result.status == "ok"}
    table = group_by_scenario([result for result in agent.results.scenarios if result.seed in seeds])
    return {name: by_seed for name, by_seed in table.items() if len(by_seed) == len(seeds)}


def _select_common(table: ResultTable, other: ResultTable, names: Sequence[str]) -> ResultTable:
    """Return the results of some scenarios; those from before places were kept get the place that the other has."""
    return {
        name: {
            seed: result
            if result.place
            else result.model_copy(update={"place": next(iter(other[name].values())).place})
            for seed, result in table[name].items()
        }
        for name in names
    }


def _mean_ds(table: ResultTable, scenario: str) -> float:
    return sum(result.ds for result in table[scenario].values()) / len(table[scenario])


def build_difference_table(differences: Sequence[AgentDifference], name: str = "differences") -> Table:
    """Return the differences over all scenarios, with scenarios won and lost."""
    rows = [
        make_row(
            (
                difference.agent,
                difference.other,
                float(difference.scenarios),
                ", ".join(map(str, difference.seeds)) or "means",
                *map(_make_cell, (difference.ds, difference.sr, difference.efficient_sr, difference.time_ratio)),
                float(difference.wins),
                float(difference.losses),
            )
        )
        for difference in differences
    ]
    return Table(
        name,
        "Paired differences",
        (
            Column("agent", "Agent"),
            Column("other", "minus"),
            Column("scenarios", "scenarios", decimals=0),
            Column("seeds", "seeds"),
            *(_make_column(key, label) for key, label in _LABELS.items()),
            Column("wins", "better in", decimals=0),
            Column("losses", "worse in", decimals=0),
        ),
        tuple(rows),
        " ".join(
            filter(
                None,
                (
                    DIFFERENCE_NOTE,
                    "Means over scenarios, as mdrive-sumo compare has them.",
                    describe_comparisons([one for entry in differences for one in (entry.ds, entry.sr)]),
                ),
            )
        ),
    )


def build_bucket_difference_table(
    differences: Sequence[AgentDifference], name: str = "differences_by_bucket"
) -> Table | None:
    """Return the differences of DS and SR by bucket and of the mean of the buckets; None if there is one bucket."""
    if not differences or len(differences[0].buckets) < 2:
        return None
    columns = [Column("agent", "Agent"), Column("other", "minus")]
    for bucket in (*differences[0].buckets, "Overall"):
        key = bucket.lower()
        columns += [_make_column(f"{key}_ds", "DS", bucket), _make_column(f"{key}_sr", "SR", bucket)]
    rows = tuple(_make_bucket_row(difference) for difference in differences)
    counted = describe_comparisons([one for entry in differences for one in _list_bucket_intervals(entry)])
    note = f"{DIFFERENCE_NOTE} Overall: mean of the buckets, each drawn anew on its own. {counted}".rstrip()
    return Table(name, "Paired differences by bucket", tuple(columns), rows, note)


def _make_bucket_row(difference: AgentDifference) -> Row:
    cells: list[CellValue | Cell] = [difference.agent, difference.other]
    return make_row([*cells, *map(_make_cell, _list_bucket_intervals(difference))])


def _list_bucket_intervals(difference: AgentDifference) -> list[ConfidenceInterval | None]:
    return [interval for pair in (*difference.buckets.values(), difference.bucket_mean) for interval in pair]


def _make_column(key: str, label: str, group: str = "") -> Column:
    return Column(key, label, group, has_sign=True, intervals=IntervalStyle.ENDS)


def _make_cell(interval: ConfidenceInterval | None) -> Cell:
    return Cell(None if interval is None else interval.mean, interval)
