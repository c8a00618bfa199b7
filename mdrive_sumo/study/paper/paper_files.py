"""The files of the study beside its runs: pages, tables, figures and `paper.json` with all numbers."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from mdrive_sumo.core.output_files import make_parents, write_bytes
from mdrive_sumo.core.statistics import judge_intervals
from mdrive_sumo.report.comparison_report.write_comparison_report import render_report_files
from mdrive_sumo.runs.evaluate import report_write_errors
from mdrive_sumo.scoring import Means, Results, ScenarioResult
from mdrive_sumo.study.human.human_results import build_human_json
from mdrive_sumo.study.paper.cooperation_gain import PairGain, RoleGap
from mdrive_sumo.study.paper.paper_agents import find_role
from mdrive_sumo.study.paper.paper_numbers import PaperNumbers
from mdrive_sumo.study.paper.paper_report import PaperRequest, build_paper_report
from mdrive_sumo.study.study_files import dump_page
from mdrive_sumo.v2x.comm_settings import describe_comm

FORMAT = "mdrive-sumo/paper/1"
EPISODE_FIELDS = {"id", "seed", "status", "reason", *Means.model_fields, "min_ttc", "scalars", "digest", "comm"}
PAGE_FILE, MARKDOWN_FILE, JSON_FILE = "paper.html", "paper.md", "paper.json"


def build_paper_json(numbers: PaperNumbers, request: PaperRequest, about: Mapping[str, Any]) -> str:
    """Return all numbers as JSON. about: the content of `study_plan.json`."""
    run = numbers.compared[0].results.run
    page = {
        **about,
        "format": FORMAT,
        "command": list(request.command),
        "left_out": dict(request.left_out),
        "score_mode": run.score_mode,
        "closed": {name: _describe_run(results) for name, results in numbers.closed.items()},
        "open": {name: results.overall.model_dump() for name, results in numbers.open.items()},
        "gaps": _describe_gaps(numbers.gaps),
        "learned_gaps": _describe_gaps(numbers.learned_gaps),
        "gains": _describe_gains(numbers.gains),
        "learned_gains": _describe_gains(numbers.learned_gains),
        "open_closed": asdict(numbers.comparison)
        | {"lines": [asdict(entry) | {"open": entry.open.model_dump()} for entry in numbers.comparison.lines]},
        "precisions": {name: dict(values) for name, values in numbers.precisions.items()},
        "precision_correlations": [asdict(one) for one in numbers.precision_correlations],
        "humans": None if request.humans is None else build_human_json(request.humans),
        "channel": [
            {
                "agent": row.agent,
                "condition": row.condition.name,
                "comm": describe_comm(row.condition.comm),
                "episodes": _describe_episodes(row.scenarios),
            }
            for row in numbers.channel
        ],
    }
    return dump_page(page)


def _describe_gaps(gaps: Sequence[RoleGap]) -> list[dict[str, Any]]:
    verdicts = judge_intervals([one.gap for one in gaps])
    return [asdict(entry) | {"shown": shown} for entry, shown in zip(gaps, verdicts, strict=True)]


def _describe_gains(gains: Sequence[PairGain]) -> list[dict[str, Any]]:
    ds, sr = (judge_intervals([getattr(one, score) for one in gains]) for score in ("ds", "sr"))
    return [
        asdict(entry) | {"shown_ds": shown_ds, "shown_sr": shown_sr}
        for entry, shown_ds, shown_sr in zip(gains, ds, sr, strict=True)
    ]


def _describe_run(results: Results) -> dict[str, Any]:
    return {
        "labels": results.run.labels,
        "sensing_track": results.run.sensing_track,
        "role": find_role(results),
        "buckets": {name: bucket.model_dump() for name, bucket in results.buckets.items()},
        "overall": results.overall.model_dump(),
        "episodes": _describe_episodes(results.scenarios),
    }


def _describe_episodes(scenarios: Sequence[ScenarioResult]) -> list[dict[str, Any]]:
    return [scenario.model_dump(mode="json", include=EPISODE_FIELDS) for scenario in scenarios]


def write_paper(
    folder: Path, numbers: PaperNumbers, request: PaperRequest, about: Mapping[str, Any]
) -> tuple[Path, ...]:
    """Write all files of a finished study and return the pages. about: the content of `study_plan.json`.

    Raises InputError if that is not possible.
    """
    contents = render_report_files(build_paper_report(numbers, request), PAGE_FILE, MARKDOWN_FILE, folder)
    contents[JSON_FILE] = build_paper_json(numbers, request, about).encode()
    for name, content in contents.items():
        path = folder / name
        with report_write_errors(path):
            make_parents(path)
            write_bytes(path, content)
    return tuple(folder / name for name in (PAGE_FILE, MARKDOWN_FILE, JSON_FILE))
