"""`paper.json`: all numbers of the study."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from mdrive_sumo.core.statistics import judge_interval
from mdrive_sumo.scoring import Means, Results, ScenarioResult
from mdrive_sumo.study.paper.paper_agents import find_role
from mdrive_sumo.study.paper.paper_facts import PaperRequest
from mdrive_sumo.study.paper.paper_numbers import PaperNumbers
from mdrive_sumo.v2x.comm_settings import describe_comm

FORMAT = "mdrive-sumo/paper/1"
EPISODE_FIELDS = {"id", "seed", "status", "reason", *Means.model_fields, "min_ttc", "scalars", "digest", "comm"}


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
        "gaps": [asdict(one) | {"shown": judge_interval(one.gap)} for one in numbers.gaps],
        "gains": [
            asdict(one) | {f"shown_{score}": judge_interval(getattr(one, score)) for score in ("ds", "sr")}
            for one in numbers.gains
        ],
        "open_closed": asdict(numbers.comparison)
        | {"lines": [asdict(one) | {"open": one.open.model_dump()} for one in numbers.comparison.lines]},
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
    return json.dumps(page, indent=1, allow_nan=False) + "\n"


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
