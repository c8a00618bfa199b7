"""The main table of a report, in the form of the paper's, and all scores by bucket."""

from collections.abc import Sequence

from mdrive_sumo.core.statistics import METHOD_NOTE, TOO_FEW_NOTE
from mdrive_sumo.core.tables import (
    BestValue,
    Cell,
    CellValue,
    Column,
    IntervalStyle,
    Row,
    Table,
    make_row,
)
from mdrive_sumo.report.comparison_report.compared_agent import ComparedAgent
from mdrive_sumo.report.published_results import AS_PUBLISHED, MAIN_TABLE_LABEL, PublishedMethod, order_buckets
from mdrive_sumo.scoring import MeanIntervals, Means
from mdrive_sumo.scoring.intervals import BUCKET_MEAN, SCENARIO_MEAN
from mdrive_sumo.scoring.summary import count_scenarios

OVERALL = "Overall"
MAIN_NOTE = (
    "DS, SR and efficient SR in percent. Time ratio: time needed divided by that of omniscient, where every CAV"
    " arrives; efficient SR counts successes with a time ratio of at most 2."
    " Time ratios are means over different scenarios, hence not ranked."
)
OVERALL_NOTE = (
    "Overall: mean of the buckets, as the numbers of the paper's table are (its caption says mean over scenarios)."
)
SEEDS_NOTE = (
    "±: half of the 95 % interval of a nested bootstrap: places (networks) are drawn anew, then the scenarios of each,"
    f" then their seeds. {TOO_FEW_NOTE}"
)
INTERVAL_NOTE = f"{METHOD_NOTE} {TOO_FEW_NOTE}"
TRACK_NOTE = (
    "Agents of the sensor track have no lists of objects, only what a car carries; they are ranked apart from the"
    " object track, to which all other agents belong."
)
PUBLISHED_NOTE = (
    f"CARLA rows as published (mdrive.tex, {MAIN_TABLE_LABEL}): another simulator, other scenario files, methods"
    " with learned perception; they are not ranked."
)
AGENT_COLUMNS = (
    Column("agent", "Agent"),
    Column("perception_sharing", "Sharing"),
    Column("negotiation", "Negotiation"),
)


def make_score_columns(group: str, *, with_times: bool) -> tuple[Column, ...]:
    """Return the columns DS and SR of a group, with efficient SR and time ratio if asked for."""
    key = group.lower().replace(" ", "_")
    times = (
        Column(f"{key}_efficient_sr", "eff. SR", group, best=BestValue.HIGHEST),
        Column(f"{key}_time_ratio", "time ratio", group),
    )
    return (
        Column(f"{key}_ds", "DS", group, best=BestValue.HIGHEST),
        Column(f"{key}_sr", "SR", group, best=BestValue.HIGHEST),
        *(times if with_times else ()),
    )


def build_main_table(
    agents: Sequence[ComparedAgent], published: Sequence[PublishedMethod] = (), name: str = "main"
) -> Table:
    """Return DS and SR by bucket and overall, with efficient SR and time ratio; the best three of each column marked.

    published: rows of the paper's main table, set apart and never ranked. Agents of one bucket have no overall column.
    """
    buckets = order_buckets(agents[0].results.buckets)
    is_one = len(buckets) == 1
    columns = [*AGENT_COLUMNS]
    for bucket in buckets:
        columns += make_score_columns(bucket, with_times=is_one)
    columns += [] if is_one else make_score_columns(OVERALL, with_times=True)
    notes = (
        MAIN_NOTE,
        "" if is_one else OVERALL_NOTE,
        SEEDS_NOTE if any(len(agent.seeds) > 1 for agent in agents) else "",
        TRACK_NOTE if any(agent.track for agent in agents) else "",
        PUBLISHED_NOTE if published else "",
    )
    return Table(
        name,
        f"Scores by bucket: {agents[0].results.run.suite_label}",
        tuple(columns),
        (
            *(_make_main_row(agent, buckets) for agent in agents),
            *(_make_published_row(method, buckets) for method in published),
        ),
        " ".join(note for note in notes if note),
    ).mark_columns()


def _make_main_row(agent: ComparedAgent, buckets: Sequence[str]) -> Row:
    intervals = agent.intervals if len(agent.seeds) > 1 else {}
    is_one = len(buckets) == 1
    cells: list[CellValue | Cell] = [agent.name, agent.shares_perception, agent.negotiates]
    for bucket in buckets:
        cells += make_score_cells(agent.results.buckets[bucket], intervals.get(bucket), with_times=is_one)
    if not is_one:
        cells += make_score_cells(agent.results.overall.bucket_mean, intervals.get(BUCKET_MEAN), with_times=True)
    return make_row(cells, agent.section, is_ranked=agent.is_ranked, rank_group=agent.rank_group)


def _make_published_row(method: PublishedMethod, buckets: Sequence[str]) -> Row:
    cells: list[CellValue] = [method.method, method.shares_perception, method.negotiates]
    for bucket in buckets:
        cells += method.scores.get(bucket, (None, None))
    if len(buckets) > 1:
        cells += method.average
    return make_row((*cells, None, None), AS_PUBLISHED, is_ranked=False)


def make_score_cells(means: Means, intervals: MeanIntervals | None, *, with_times: bool) -> list[CellValue | Cell]:
    """Return the cells below `make_score_columns`."""
    ds, sr = (None, None) if intervals is None else (intervals.ds, intervals.sr)
    scores: list[CellValue | Cell] = [Cell(means.ds, ds), Cell(means.sr, sr)]
    return [*scores, means.efficient_sr, means.time_ratio] if with_times else scores


def build_bucket_table(agents: Sequence[ComparedAgent], name: str = "buckets") -> Table:
    """Return every score of each agent by bucket, as bucket mean and as scenario mean, with intervals of DS and SR."""
    buckets = order_buckets(agents[0].results.buckets)
    groups = (*buckets, BUCKET_MEAN, SCENARIO_MEAN) if len(buckets) > 1 else buckets
    rows = [_make_bucket_row(agent, group, agent.intervals[group]) for group in groups for agent in agents]
    return Table(
        name,
        "All scores by bucket",
        (
            Column("agent", "Agent"),
            Column("scenarios", "scenarios", decimals=0),
            Column("ds", "DS", best=BestValue.HIGHEST, intervals=IntervalStyle.ENDS),
            Column("sr", "SR", best=BestValue.HIGHEST, intervals=IntervalStyle.ENDS),
            Column("efficient_sr", "efficient SR", best=BestValue.HIGHEST),
            Column("time_ratio", "time ratio"),
            Column("timed", "timed episodes", decimals=0),
            Column("rc", "RC", best=BestValue.HIGHEST),
            Column("ip", "IP", decimals=3, best=BestValue.HIGHEST),
        ),
        tuple(rows),
        f"{MAIN_NOTE} {INTERVAL_NOTE} Privileged agents are an upper bound and not ranked.",
    ).mark_sections()


def _make_bucket_row(agent: ComparedAgent, group: str, intervals: MeanIntervals) -> Row:
    results = agent.results
    overall = results.overall
    if group in results.buckets:
        means: Means = results.buckets[group]
        count, timed = results.buckets[group].scenarios, results.buckets[group].timed
    else:
        means = overall.bucket_mean if group == BUCKET_MEAN else overall.scenario_mean
        count, timed = count_scenarios(results.scenarios), overall.timed
    cells: tuple[CellValue | Cell, ...] = (
        agent.name,
        float(count),
        Cell(means.ds, intervals.ds),
        Cell(means.sr, intervals.sr),
        means.efficient_sr,
        means.time_ratio,
        float(timed),
        means.rc,
        means.ip,
    )
    return make_row(cells, group, is_ranked=agent.is_ranked, rank_group=agent.rank_group)
