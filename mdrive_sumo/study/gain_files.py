"""The study of the gain as files: `gain.json` with all numbers, `gain.csv` for tables, `gain.md` to read."""

import csv
import io
import json
import shlex
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from mdrive_sumo.core.tables import TableRow, format_markdown_table
from mdrive_sumo.study.gain import METRICS, PARTS, GainRow, GainSummary, judge
from mdrive_sumo.study.study_files import StudyDescription, format_interval, run_to_dict

FORMAT = "mdrive-sumo/gain/1"
SCORE_HEADER = ("scenarios", "sensing", "agent", "DS", "SR")
GAIN_HEADER = ("scenarios", "part", "DS", "SR", "shown by DS", "shown by SR")
HOW_TO_READ = """\
Numbers are points of DS and SR (percent), means over scenarios and seeds. In brackets are 95 % bootstrap
confidence intervals of paired differences: scenarios are drawn anew, with more than one seed also the seeds within
each. An interval that contains 0 shows no difference, neither a gain nor that there is none."""


def gain_json(about: StudyDescription, rows: Sequence[GainRow], summary: GainSummary) -> str:
    """Return all numbers as JSON."""
    run = rows[0].results[0].run
    page: dict[str, Any] = {
        "format": FORMAT,
        "suite": about.suite,
        "scenario": about.scenario,
        "seeds": list(about.seeds),
        "command": list(about.command),
        "suite_checksum": run.suite_checksum,
        "score_mode": run.score_mode,
        "comm": run.comm,
        "versions": run.versions,
        "void": summary.void,
        "scores": [
            {"group": one.group, "scenarios": one.scenarios, "sensing": one.sensing, "agent": one.agent}
            | {metric: asdict(one.score[metric]) for metric in METRICS}
            for one in summary.scores
        ],
        "gains": [
            {"group": one.group, "scenarios": one.scenarios, "part": one.part.name}
            | {metric: asdict(one.gain[metric]) | {"shown": judge(one.gain[metric])} for metric in METRICS}
            for one in summary.gains
        ],
        "rows": [
            {"sensing": row.sensing, "agent": row.agent, "runs": [run_to_dict(one) for one in row.results]}
            for row in rows
        ],
    }
    return json.dumps(page, indent=1, allow_nan=False) + "\n"


def gain_csv(summary: GainSummary) -> str:
    """Return one line for each group, part and metric."""
    page = io.StringIO()
    writer = csv.writer(page, lineterminator="\n")
    writer.writerow(("group", "scenarios", "part", "metric", "mean", "low", "high", "shown"))
    for line in summary.gains:
        for metric in METRICS:
            gain = line.gain[metric]
            numbers = (f"{value:.6f}" for value in (gain.mean, gain.low, gain.high))
            writer.writerow((line.group, line.scenarios, line.part.name, metric, *numbers, judge(gain)))
    return page.getvalue()


def gain_markdown(about: StudyDescription, rows: Sequence[GainRow], summary: GainSummary) -> str:
    """Return the study as a page."""
    run = rows[0].results[0].run
    facts = {
        "suite": f"{about.suite}, checksum `{run.suite_checksum}`, scenarios `{about.scenario}`",
        "left out as void": str(summary.void),
        "seeds": ", ".join(map(str, about.seeds)),
        "channel": ", ".join(f"{name} {value}" for name, value in run.comm.items()),
        "command": f"`{shlex.join(about.command)}`",
        "versions": ", ".join(f"{name} {version}" for name, version in sorted(run.versions.items())),
    }
    parts = (
        f"# {about.suite}: what sharing gains, and by what",
        "\n".join(f"- {name}: {value}" for name, value in facts.items()),
        HOW_TO_READ,
        "\n".join(f"- **{part.name}**: {part.meaning}" for part in PARTS),
        format_markdown_table(GAIN_HEADER, make_gain_table(summary), left=2),
        "The scores behind it:",
        format_markdown_table(SCORE_HEADER, _make_score_table(summary), left=3),
    )
    return "\n\n".join(parts) + "\n"


def make_gain_table(summary: GainSummary) -> list[TableRow]:
    """Return a row for each group and part."""
    return [
        (
            f"{line.group} ({line.scenarios})",
            line.part.name,
            *(format_interval(line.gain[metric], "+") for metric in METRICS),
            *(judge(line.gain[metric]) for metric in METRICS),
        )
        for line in summary.gains
    ]


def _make_score_table(summary: GainSummary) -> list[TableRow]:
    return [
        (
            f"{line.group} ({line.scenarios})",
            str(line.sensing),
            line.agent,
            *(format_interval(line.score[metric]) for metric in METRICS),
        )
        for line in summary.scores
    ]
