"""Tables of a run's results for the terminal, about 100 columns wide at most."""

from collections import Counter
from collections.abc import Iterable, Mapping

from mdrive_sumo.core.clean_text import clean_line
from mdrive_sumo.core.statistics import TOO_FEW_NOTE, format_interval_cells
from mdrive_sumo.core.tables import TableRow, format_text_table
from mdrive_sumo.scoring import Means, Results, RunInfo, ScenarioResult, compute_mean_intervals
from mdrive_sumo.scoring.captured_cooperation import CapturedCooperation
from mdrive_sumo.scoring.summary import count_scenarios

SCORE_HEADER: TableRow = ("DS", "SR", "efficient SR", "time ratio", "RC", "IP")
INTERVAL_HEADER: TableRow = ("mean over seeds", "DS", "95 % from", "to", "SR", "95 % from", "to")
ROLE_HEADER: TableRow = ("agent", "role", "CAVs", "DS", "SR", "time ratio")
TIMED_HEADER = "timed"
"""Scenarios over which the time ratio is a mean."""
CAPTURED_HEADER = "captured [%]"
COLLISION_PREFIX = "collision-"
SLOW_IMPACT, FAST_IMPACT = 1.0, 5.0
"""Impact speeds [m/s] that separate the classes of severity (issue G): a touch at walking pace, and what injures."""
UNKNOWN_SPEED = "unknown"
SEVERITIES = ("below 1 m/s", "1 to 5 m/s", "above 5 m/s", UNKNOWN_SPEED)


def format_captured(value: float | None) -> str:
    """Return a share as percent; "" for None."""
    return "" if value is None else f"{100 * value:.1f}"


def format_scores(means: Means | ScenarioResult) -> TableRow:
    """Return the cells below `SCORE_HEADER`: DS, SR, efficient SR and RC in percent, time ratio and IP as factors."""
    times = (format_optional(means.efficient_sr), format_optional(means.time_ratio))
    return (f"{means.ds:.2f}", f"{means.sr:.2f}", *times, f"{means.rc:.2f}", f"{means.ip:.3f}")


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


def build_interval_rows(results: Results) -> list[TableRow]:
    """Return the rows below `INTERVAL_HEADER` of a run of several seeds; none for a run of one."""
    if len(results.run.all_seeds) == 1:
        return []
    found = compute_mean_intervals(results)
    return [(one.group, *format_interval_cells(one.ds), *format_interval_cells(one.sr)) for one in found]


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


def build_role_rows(results: Results) -> list[TableRow]:
    """Return the rows below `ROLE_HEADER` of a run of two agents; none for a run of one."""
    roles = results.overall.roles
    if roles is None:
        return []
    found = ((results.run.agent, "under test", roles.tested), (results.run.others, "other", roles.others))
    return [
        (name, role, str(one.cavs), f"{one.ds:.2f}", f"{one.sr:.2f}", format_optional(one.time_ratio))
        for name, role, one in found
        if one is not None
    ]


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
    counts = _sorted(problem for one in results.scenarios for problem in Counter(one.malformed).elements())
    if not counts:
        return ""
    kinds = "; ".join(f"{problem} ({count})" for problem, count in counts.items())
    return f"{counts.total()} messages, dropped: {kinds}"


def _sorted(names: Iterable[str]) -> Counter[str]:
    counts = Counter(names)
    return Counter(dict(sorted(counts.items(), key=lambda item: (-item[1], item[0]))))


def build_score_rows(results: Results, captured: CapturedCooperation | None = None) -> tuple[TableRow, list[TableRow]]:
    """Return header and rows: the buckets, then both overall means; with captured cooperation if given."""
    overall = results.overall
    rows: list[TableRow] = [
        (name, str(bucket.scenarios), *format_scores(bucket), str(bucket.timed))
        for name, bucket in results.buckets.items()
    ]
    timed = str(overall.timed)
    rows.append(("bucket mean", str(len(results.buckets)), *format_scores(overall.bucket_mean), timed))
    rows.append(
        ("scenario mean", str(count_scenarios(results.scenarios)), *format_scores(overall.scenario_mean), timed)
    )
    header: TableRow = ("bucket", "scenarios", *SCORE_HEADER, TIMED_HEADER)
    if captured is None:
        return header, rows
    shares = (*(captured.buckets.get(name) for name in results.buckets), captured.bucket_mean, captured.scenario_mean)
    return (*header, CAPTURED_HEADER), [(*row, format_captured(share)) for row, share in zip(rows, shares, strict=True)]


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
        *((("malformed", malformed),) if (malformed := describe_malformed(results)) else ()),
        *((("times", missing),) if (missing := describe_missing_reference(results)) else ()),
    )
    return "\n".join(
        (
            clean_line(f"suite {run.suite}, agent {describe_agent(results)}, {describe_seeds(run)}, {mode}"),
            "",
            format_text_table(*build_score_rows(results, captured)),
            "",
            *_format_intervals(build_interval_rows(results)),
            *((format_text_table(ROLE_HEADER, rows), "") if (rows := build_role_rows(results)) else ()),
            *(f"{name:<13}{value}" for name, value in facts),
            *(
                f"  {name_episode(run, s)}: {' '.join(s.reason.split())}"
                for s in results.scenarios
                if s.status == "void"
            ),
        )
    )


def _format_intervals(rows: list[TableRow]) -> list[str]:
    """Return the lines of the table of intervals; none without rows."""
    if not rows:
        return []
    note = [TOO_FEW_NOTE] if any("-" in row for row in rows) else []
    return [format_text_table(INTERVAL_HEADER, rows), *note, ""]


def _listed(counts: Mapping[str, int]) -> str:
    return clean_line(", ".join(f"{name} {count}" for name, count in counts.items())) or "none"
