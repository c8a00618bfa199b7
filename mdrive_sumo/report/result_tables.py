"""Tables of a run's results, and its summary for the terminal, about 100 columns wide at most."""

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence

from mdrive_sumo.core.clean_text import clean_line
from mdrive_sumo.core.statistics import TOO_FEW_NOTE, ConfidenceInterval
from mdrive_sumo.core.tables import CellValue, Column, Table, format_text, make_row, make_text_columns
from mdrive_sumo.scoring import Means, Results, RunInfo, ScenarioResult, compute_mean_intervals
from mdrive_sumo.scoring.captured_cooperation import CapturedCooperation
from mdrive_sumo.scoring.summary import count_scenarios
from mdrive_sumo.v2x.message_counts import MessageRate

SCORE_COLUMNS = (
    Column("ds", "DS"),
    Column("sr", "SR"),
    Column("efficient_sr", "efficient SR"),
    Column("time_ratio", "time ratio"),
    Column("rc", "RC"),
    Column("ip", "IP", decimals=3),
)
"""DS, SR, efficient SR and RC are percentages, time ratio and IP factors."""
SCENARIOS_COLUMN = Column("scenarios", "scenarios", decimals=0)
TIMED_COLUMN = Column("timed", "timed", decimals=0)
"""Number of scenarios over which the time ratio is a mean."""
CAPTURED_COLUMN = Column("captured", "captured [%]", decimals=1, undefined="")
INTERVAL_COLUMNS = (
    Column("group", "mean over seeds"),
    *(
        Column(f"{key}{end}", label)
        for key, name in (("ds", "DS"), ("sr", "SR"))
        for end, label in (("", name), ("_low", "95 % from"), ("_high", "to"))
    ),
)
ROLE_COLUMNS = (
    *make_text_columns({"agent": "agent", "role": "role"}),
    Column("cavs", "CAVs", decimals=0),
    *SCORE_COLUMNS[:2],
    SCORE_COLUMNS[3],
)
COLLISION_PREFIX = "collision-"
SLOW_IMPACT, FAST_IMPACT = 1.0, 5.0
"""Impact speeds [m/s] that separate the classes of severity, chosen: a touch at walking pace, and what injures."""
UNKNOWN_SPEED = "unknown"
SEVERITIES = ("below 1 m/s", "1 to 5 m/s", "above 5 m/s", UNKNOWN_SPEED)


def list_scores(means: Means | ScenarioResult) -> tuple[CellValue, ...]:
    """Return the values below `SCORE_COLUMNS`."""
    return tuple(getattr(means, column.key) for column in SCORE_COLUMNS)


def list_bounds(interval: ConfidenceInterval | None) -> tuple[CellValue, ...]:
    """Return mean, lower and upper bound of an interval as values of three columns."""
    return (None,) * 3 if interval is None else (interval.mean, interval.low, interval.high)


def list_percent(shares: Iterable[float | None]) -> list[float | None]:
    """Return shares in percent."""
    return [None if share is None else 100 * share for share in shares]


def format_optional(value: float | None) -> str:
    """Return a number with two decimals; "-" where it is undefined."""
    return "-" if value is None else f"{value:.2f}"


def describe_missing_reference(results: Results) -> str:
    """Return how many scenarios lack reference times and what to do, in at most 87 characters; "" if none does."""
    missing = count_scenarios(scenario for scenario in results.scenarios if scenario.efficient_sr is None)
    what = f"none for {missing} scenarios: `mdrive-sumo validate SUITE --write`, `mdrive-sumo rescore RUN`"
    return what if missing else ""


def describe_seeds(run: RunInfo) -> str:
    """Return "seed 0" or "seeds 0, 1, 2"."""
    return f"seed{'s' if len(run.all_seeds) > 1 else ''} {', '.join(map(str, run.all_seeds))}"


def name_episode(run: RunInfo, result: ScenarioResult) -> str:
    """Return an episode's name: its scenario, and its seed if the run has several."""
    return clean_line(f"{result.id}, seed {result.seed}" if len(run.all_seeds) > 1 else result.id)


def list_void(results: Results) -> list[ScenarioResult]:
    """Return the void episodes."""
    return [result for result in results.scenarios if result.status == "void"]


def build_interval_table(results: Results) -> Table:
    """Return the means of a run of several seeds with their bounds; without rows for a run of one."""
    groups = compute_mean_intervals(results) if len(results.run.all_seeds) > 1 else ()
    rows = [make_row((means.group, *list_bounds(means.ds), *list_bounds(means.sr))) for means in groups]
    return Table("intervals", "Means over seeds", INTERVAL_COLUMNS, tuple(rows))


def describe_partial(results: Results) -> str:
    """Return "partial: 3 of 46" for the results of an unfinished run; "" for a finished one."""
    return "" if results.planned is None else f"partial: {len(results.scenarios)} of {results.planned}"


def describe_agent(results: Results) -> str:
    """Return the agent with its labels, e.g. "omniscient [privileged, object track]"; with the other agent of two.

    Results of an unfinished run are marked: "idm [single, sensor track, partial: 3 of 46]".
    """
    run = results.run
    track = describe_sensing_track(run) if run.sensing_track else ""
    labels = ", ".join(filter(None, (*run.labels, track, describe_partial(results))))
    share = "one CAV" if run.penetration is None else f"{run.penetration} % of the CAVs"
    name = f"{run.agent} ({share}) among {run.others}" if run.others else run.agent
    return clean_line(f"{name} [{labels}]" if labels else name)


def describe_sensing_track(run: RunInfo) -> str:
    """Return "sensor track" or "object track"; "-" for results from before tracks existed."""
    return f"{run.sensing_track} track" if run.sensing_track else "-"


def build_role_table(results: Results) -> Table:
    """Return the scores of each agent of a run of two; without rows for a run of one."""
    roles, run = results.overall.roles, results.run
    parts = () if roles is None else ((run.agent, "under test", roles.tested), (run.others, "other", roles.others))
    rows = [
        make_row((agent, role, means.cavs, means.ds, means.sr, means.time_ratio))
        for agent, role, means in parts
        if means is not None
    ]
    return Table("roles", "Scores by agent", ROLE_COLUMNS, tuple(rows), left=1)


def count_outcomes(results: Results) -> Counter[str]:
    """Count the outcomes of the CAVs, most frequent first; a failed agent counts with its reason."""
    return _sorted(
        f"{ego.outcome} ({ego.reason})" if ego.outcome == "agent-failed" else ego.outcome
        for scenario in results.scenarios
        for ego in scenario.egos
    )


def count_infractions(results: Results) -> Counter[str]:
    """Count the infractions by kind, most frequent first, without those that cost nothing."""
    return _sorted(
        infraction.kind
        for scenario in results.scenarios
        for ego in scenario.egos
        for infraction in ego.infractions
        if infraction.factor < 1.0
    )


def count_collisions_by_severity(results: Results) -> dict[str, int]:
    """Count the collisions by impact speed, the slowest class first; empty if there are none.

    Collisions of result files without impact speeds are "unknown".
    """
    speeds = [
        infraction.impact_speed
        for scenario in results.scenarios
        for ego in scenario.egos
        for infraction in ego.infractions
        if infraction.kind.startswith(COLLISION_PREFIX)
    ]
    counts = Counter(_name_severity(speed) for speed in speeds)
    return {name: counts[name] for name in SEVERITIES if speeds and (counts[name] or name != UNKNOWN_SPEED)}


def _name_severity(speed: float | None) -> str:
    below, between, above, unknown = SEVERITIES
    if speed is None:
        return unknown
    return below if speed < SLOW_IMPACT else above if speed > FAST_IMPACT else between


def count_notes(results: Results) -> Counter[str]:
    """Count the notes of the agents by kind, most frequent first, e.g. fallbacks of a language model."""
    return _sorted(kind for scenario in results.scenarios for kind in Counter(scenario.notes).elements())


def describe_malformed(results: Results) -> str:
    """Return "200 messages, dropped: cam: expected at least 18 bytes (200)"; "" if none is malformed."""
    counts = _sorted(problem for result in results.scenarios for problem in Counter(result.malformed).elements())
    if not counts:
        return ""
    kinds = "; ".join(f"{problem} ({count})" for problem, count in counts.items())
    return f"{counts.total()} messages, dropped: {kinds}"


def compute_mean_rates(results: Results) -> dict[str, MessageRate]:
    """Return what was sent in a second by type, over the time of all episodes; empty at fixed intervals."""
    episodes = [result for result in results.scenarios if result.sent_rates]
    ticks = float(sum(result.ticks for result in episodes))
    types = sorted({name for result in episodes for name in result.sent_rates})
    return {name: _compute_mean_rate(name, episodes, ticks) for name in types}


def _compute_mean_rate(name: str, episodes: Sequence[ScenarioResult], ticks: float) -> MessageRate:
    rates = [(one.ticks, one.sent_rates[name]) for one in episodes if name in one.sent_rates]
    messages = math.fsum(count * rate.messages_s for count, rate in rates)
    return MessageRate(messages / ticks, math.fsum(count * rate.bytes_s for count, rate in rates) / ticks)


def describe_rates(results: Results) -> str:
    """Return "cam 9.3/s 429 B/s, cpm 17.1/s 1088 B/s"; "" at fixed intervals."""
    rates = compute_mean_rates(results).items()
    return ", ".join(f"{name} {messages:.1f}/s {size:.0f} B/s" for name, (messages, size) in rates)


def build_rate_table(results: Results) -> Table:
    """Return messages and bytes in a second by type; without rows at fixed intervals."""
    columns = (
        *make_text_columns({"type": "type"}),
        Column("messages_s", "messages/s"),
        Column("bytes_s", "bytes/s", decimals=0),
    )
    rates = compute_mean_rates(results).items()
    return Table("sent", "Messages", columns, tuple(make_row((name, *numbers)) for name, numbers in rates))


def describe_busy_ratio(results: Results) -> str:
    """Return "mean 0.021, greatest 0.066": of the channel at the CAVs, over the time of all episodes; "" without."""
    measured = [(one.ticks, one.busy_ratio) for one in results.scenarios if one.busy_ratio is not None]
    ticks = sum(ticks for ticks, _ in measured)
    if not ticks:
        return ""
    mean = math.fsum(ticks * ratio.mean for ticks, ratio in measured) / ticks
    return f"mean {mean:.3f}, greatest {max(ratio.greatest for _, ratio in measured):.3f}"


def _sorted(names: Iterable[str]) -> Counter[str]:
    counts = Counter(names)
    return Counter(dict(sorted(counts.items(), key=lambda item: (-item[1], item[0]))))


def build_score_table(results: Results, captured: CapturedCooperation | None = None) -> Table:
    """Return the scores of the buckets, then both overall means; with captured cooperation if given."""
    overall = results.overall
    groups: list[tuple[str, float, Means, float]] = [
        (name, bucket.scenarios, bucket, bucket.timed) for name, bucket in results.buckets.items()
    ]
    groups.append(("bucket mean", len(results.buckets), overall.bucket_mean, overall.timed))
    groups.append(("scenario mean", count_scenarios(results.scenarios), overall.scenario_mean, overall.timed))
    shares = [] if captured is None else [captured.buckets.get(name) for name in results.buckets]
    shares += [] if captured is None else [captured.bucket_mean, captured.scenario_mean]
    rows = [(name, scenarios, *list_scores(means), timed) for name, scenarios, means, timed in groups]
    return make_score_table("bucket", rows, shares)


def make_score_table(group: str, rows: Sequence[Sequence[CellValue]], captured: Sequence[float | None] = ()) -> Table:
    """Return a table of scores by group from rows of name, scenarios, scores and timed scenarios.

    captured: the share of captured cooperation of each row, if there is one.
    """
    columns = (Column("group", group), SCENARIOS_COLUMN, *SCORE_COLUMNS, TIMED_COLUMN)
    if not captured:
        return Table("scores", "Scores", columns, tuple(map(make_row, rows)))
    whole = [make_row((*row, share)) for row, share in zip(rows, list_percent(captured), strict=True)]
    return Table("scores", "Scores", (*columns, CAPTURED_COLUMN), tuple(whole))


def format_summary(results: Results, captured: CapturedCooperation | None = None) -> str:
    """Return the summary of a run: scores per bucket and overall, outcomes, infractions, void scenarios."""
    run, mode = results.run, f"score mode {results.run.score_mode}"
    notes = count_notes(results)
    facts = (
        ("outcomes", _listed(count_outcomes(results))),
        ("infractions", _listed(count_infractions(results))),
        ("severity", _listed(count_collisions_by_severity(results))),
        ("void", str(results.void)),
        *((("notes", _listed(notes)),) if notes else ()),
        *((("messages", rates),) if (rates := describe_rates(results)) else ()),
        *((("busy ratio", busy),) if (busy := describe_busy_ratio(results)) else ()),
        *((("malformed", malformed),) if (malformed := describe_malformed(results)) else ()),
        *((("times", missing),) if (missing := describe_missing_reference(results)) else ()),
    )
    return "\n".join(
        (
            clean_line(f"suite {run.describe_suite()}, agent {describe_agent(results)}, {describe_seeds(run)}, {mode}"),
            "",
            format_text(build_score_table(results, captured)),
            "",
            *_format_intervals(build_interval_table(results)),
            *((format_text(roles), "") if (roles := build_role_table(results)).rows else ()),
            *(f"{name:<13}{value}" for name, value in facts),
            *(
                f"  {name_episode(run, s)}: {' '.join(s.reason.split())}"
                for s in results.scenarios
                if s.status == "void"
            ),
        )
    )


def _format_intervals(table: Table) -> list[str]:
    """Return the lines of the table of intervals; none without rows."""
    if not table.rows:
        return []
    note = [TOO_FEW_NOTE] if any(cell.value is None for row in table.rows for cell in row.cells) else []
    return [format_text(table), *note, ""]


def _listed(counts: Mapping[str, int]) -> str:
    return clean_line(", ".join(f"{name} {count}" for name, count in counts.items())) or "none"
