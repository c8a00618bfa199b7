"""`report.md`: a run's results as a page to read and to publish."""

import re
import shlex
from collections.abc import Iterable

from mdrive_sumo.report.tables import (
    SCORE_HEADER,
    agent_name,
    infraction_counts,
    outcome_counts,
    score_cells,
)
from mdrive_sumo.report.text import Row
from mdrive_sumo.score import Results, ScenarioResult, ScoreMode, categories, harmonic, interdrive_groups

HOW_TO_READ = """\
DS, RC and SR are percentages, IP is a factor: the driving score of a CAV is DS = RC x IP, it succeeds with
DS > 99.95. In score mode `mdrive` a scenario counts the mean over its CAVs; a bucket is the mean over its
scenarios. The bucket mean weighs every bucket alike, the scenario mean every scenario. Void scenarios (our
failure or the simulator's, never the agent's) count as DS 0 and are listed apart. H is the harmonic mean
of DS and SR. IC, LM and LC are InterDrive's groups: intersection crossing, lane merge, lane change."""


def report_markdown(results: Results) -> str:
    """The whole report: what ran, scores overall, per category and per scenario, and how to look closer."""
    parts = (
        f"# {_escaped(results.run.suite)}: {_escaped(agent_name(results))}",
        _facts(results),
        HOW_TO_READ,
        "## Scores",
        _score_table(results),
        "## How it ended",
        _counts("outcome", "CAVs", outcome_counts(results).items()),
        _counts("infraction", "times", infraction_counts(results).items()),
        _void_list(results),
        "## Categories",
        _category_table(results),
        "## Scenarios",
        _scenario_table(results),
        "## Look closer",
        _commands(),
    )
    return "\n\n".join(part for part in parts if part) + "\n"


def _facts(results: Results) -> str:
    run = results.run
    facts = {
        "suite": f"{run.suite}, checksum `{run.suite_checksum}`",
        "seed": str(run.seed),
        "score mode": run.score_mode,
        "command": f"`{shlex.join(run.command)}`",
        "versions": ", ".join(f"{name} {version}" for name, version in sorted(run.versions.items())),
    }
    return "\n".join(f"- {name}: {value}" for name, value in facts.items())


def _score_table(results: Results) -> str:
    overall = results.overall
    rows: list[Row] = [(name, str(b.scenarios), *score_cells(b)) for name, b in results.buckets.items()]
    rows.append(("**bucket mean**", str(len(results.buckets)), *score_cells(overall.bucket_mean)))
    rows.append(("**scenario mean**", str(len(results.scenarios)), *score_cells(overall.scenario_mean)))
    return _table(("bucket", "scenarios", *SCORE_HEADER), rows)


def _counts(name: str, unit: str, counts: Iterable[tuple[str, int]]) -> str:
    rows = [(kind, str(count)) for kind, count in counts]
    return _table((name, unit), rows) if rows else f"No {name}s."


def _void_list(results: Results) -> str:
    return "\n".join(f"- void: {s.id}: {_escaped(s.reason)}" for s in results.scenarios if s.status == "void")


def _category_table(results: Results) -> str:
    groups = interdrive_groups(results.scenarios, ScoreMode(results.run.score_mode))
    rows = [
        (name, str(group.scenarios), *score_cells(group), f"{harmonic(group):.2f}")
        for name, group in (categories(results.scenarios) | groups).items()
    ]
    return _table(("category", "scenarios", *SCORE_HEADER, "H"), rows)


def _scenario_table(results: Results) -> str:
    rows = [
        (s.id, s.category, *score_cells(s), _seconds(s.min_ttc), str(s.ticks), _endings(s)) for s in results.scenarios
    ]
    header = ("scenario", "category", *SCORE_HEADER, "min TTC [s]", "ticks", "CAVs")
    return _table(header, rows, left=2)


def _seconds(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"


def _endings(scenario: ScenarioResult) -> str:
    if scenario.status == "void":
        return "void"
    return ", ".join(f"{ego.id} {ego.outcome}" for ego in scenario.egos)


def _commands() -> str:
    return "\n".join(
        (
            "    mdrive-sumo view RUN --scenario ID     watch an episode in the browser",
            "    mdrive-sumo verify RUN                 execute it again and compare every tick",
            "    mdrive-sumo rescore RUN                score the recordings again, without simulation",
            "    mdrive-sumo compare RUN OTHER_RUN      two runs side by side",
        )
    )


def _table(header: Row, rows: Iterable[Row], left: int = 1) -> str:
    rule = ["---" if i < left else "---:" for i in range(len(header))]
    body = [[_escaped(cell) for cell in row] for row in rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in (header, rule, *body))


def _escaped(text: str) -> str:
    """Text of files as text of a Markdown page: no table break, no HTML, no line break."""
    return re.sub(r"\s+", " ", text.replace("&", "&amp;").replace("<", "&lt;").replace("|", "\\|"))
