"""`study_plan.json`: what a folder's study drives, so that another study never continues in it."""

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.input_files import read_bytes
from mdrive_sumo.core.output_files import make_folder, write_text
from mdrive_sumo.runs.evaluate import report_write_errors
from mdrive_sumo.runs.fingerprint import compute_code_checksum, read_versions
from mdrive_sumo.runs.run_config import RunConfig
from mdrive_sumo.scenario.suite import Suite
from mdrive_sumo.study.paper.paper_plan import PaperPlan

PLAN_FILE = "study_plan.json"
FORMAT = "mdrive-sumo/paper-plan/1"
FACTS = {
    "format": "format",
    "suite": "suite",
    "suite_checksum": "scenarios",
    "seeds": "seeds",
    "scale": "scale",
    "plan": "plan of scenarios",
    "code": "code of mdrive-sumo",
    "versions": "versions of packages",
}
"""What identifies a study, and its name in messages. Agents may be added, so they are not among it."""


def describe_study(config: RunConfig, suite: Suite, plan: PaperPlan) -> dict[str, Any]:
    """Return the content of `study_plan.json`."""
    facts = asdict(plan)
    return {
        "format": FORMAT,
        "suite": suite.name,
        "suite_checksum": suite.checksum(),
        "seeds": list(config.seeds),
        "scale": facts.pop("scale"),
        "plan": {part: list(scenarios) for part, scenarios in facts.items()},
        "code": compute_code_checksum(),
        "versions": read_versions(),
    }


def claim_folder(folder: Path, about: Mapping[str, Any], *, fresh: bool) -> None:
    """Write `study_plan.json` into a new folder, or check that the folder's study is this one.

    fresh: the folder may hold another study, whose runs are then started anew. Raises InputError.
    """
    path = folder / PLAN_FILE
    if path.exists():
        before = _read_plan(path)
        differing = [name for key, name in FACTS.items() if before.get(key) != about[key]]
        if differing and not fresh:
            raise InputError(
                f"{folder}: expected the study of this command, found one with another {', '.join(differing)};"
                " --fresh starts anew, --out names another folder"
            )
    elif folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        entry = next((path.name for path in sorted(folder.iterdir())), "") if folder.is_dir() else "a file"
        raise InputError(f"{folder}: expected an empty folder or one of `study paper`, found {entry} in it")
    with report_write_errors(path):
        make_folder(folder)
        write_text(path, json.dumps(about, indent=1) + "\n")


def _read_plan(path: Path) -> dict[str, Any]:
    try:
        plan = json.loads(read_bytes(path))
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: expected the plan of a study, found none ({error}); --fresh starts anew") from None
    if not isinstance(plan, dict):
        raise InputError(f"{path}: expected a JSON object, found a {type(plan).__name__}; --fresh starts anew")
    return plan
