"""A finished run, opened again: for `verify` and `rescore`."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mdrive_sumo.actors import ActorMode
from mdrive_sumo.core.clock import parse_clock
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.runs.evaluate import RESULTS_FILE
from mdrive_sumo.runs.fingerprint import compute_code_checksum, read_versions
from mdrive_sumo.runs.journal import JOURNAL_FILE, read_fingerprint
from mdrive_sumo.runs.preparation import PreparedRun
from mdrive_sumo.runs.run_config import RunConfig
from mdrive_sumo.scenario.suite import load_suite
from mdrive_sumo.scenario.weather import FrictionMode
from mdrive_sumo.scoring import Results, ScoreMode, load_results
from mdrive_sumo.v2x.comm_settings import parse_comm


def open_run(folder: Path, suite: str | None = None) -> tuple[PreparedRun, Results]:
    """The evaluation and its results; `suite`: where the suite is now, if it has moved. Raises InputError."""
    results = load_results(folder / RESULTS_FILE)
    fingerprint = read_fingerprint(folder)
    settings = _settings(folder, fingerprint)
    loaded = load_suite(suite or settings.suite)
    if loaded.checksum() != results.run.suite_checksum:
        raise InputError(
            f"suite {loaded.name}: expected the checksum of {folder}, {results.run.suite_checksum},"
            f" found {loaded.checksum()}"
        )
    ids = {result.id for result in results.scenarios}
    scenarios = tuple(scenario for scenario in loaded.scenarios if scenario.id in ids)
    return PreparedRun(settings, loaded, scenarios, folder, results.run, fingerprint), results


def describe_version_changes(run: PreparedRun) -> str:
    """What differs between the run and this installation, as far as results depend on it; "" if nothing."""
    now = read_versions() | {"code": compute_code_checksum()}
    then = run.fingerprint
    found = [name if name == "code" else f"{name} {then.get(name)}" for name in now if now[name] != then.get(name)]
    return ", ".join(found)


def _settings(folder: Path, fingerprint: Mapping[str, Any]) -> RunConfig:
    try:
        return RunConfig(
            suite=fingerprint["suite"],
            scenario=fingerprint["scenario"],
            agent=fingerprint["agent"],
            agent_config=json.loads(fingerprint["agent_config"]),
            seed=fingerprint["seed"],
            score_mode=ScoreMode(fingerprint["score_mode"]),
            comm=parse_comm(json.loads(fingerprint["comm"])),
            clock=parse_clock(fingerprint["agent_clock"]),
            actors=ActorMode(fingerprint["actors"]),
            friction=FrictionMode(fingerprint.get("friction", FrictionMode.DRY)),
            record=fingerprint["record"],
            out=folder,
        )
    except (KeyError, ValueError, TypeError) as error:
        raise InputError(
            f"{folder / JOURNAL_FILE}: expected the fingerprint of a run, found a corrupt one ({error})"
        ) from None
