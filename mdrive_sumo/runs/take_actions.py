"""The actions of a recorded take as those of an agent: `human-replay` with the option `take`, a run folder."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from mdrive_sumo.contract.human_options import HUMAN, HUMAN_REPLAY, SUBSTITUTES_OPTION, TAKE_OPTION
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.episode import load_episode
from mdrive_sumo.loop.human_actions import ActionSource
from mdrive_sumo.loop.recorded_actions import RecordedActions
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.journal import JOURNAL_FILE, read_fingerprint
from mdrive_sumo.runs.run_paths import recording_path
from mdrive_sumo.scenario.scenario import Scenario

TAKEN_OPTIONS = (SUBSTITUTES_OPTION, "v2x", "device")
"""Options of `human-replay` that are those of the take unless they are given."""


def complete_replay(agent: AgentSpec) -> AgentSpec:
    """Return the agent with the options of the take that it repeats, and its absolute path. Others stay as they are.

    Raises InputError without a take, or for a run that is none.
    """
    if agent.agent != HUMAN_REPLAY:
        return agent
    folder = find_take(agent)
    if not (folder / JOURNAL_FILE).is_file():
        raise InputError(
            f"agent {HUMAN_REPLAY}: option {TAKE_OPTION}: expected the run folder of a take, found no"
            f" {folder / JOURNAL_FILE}"
        )
    fingerprint = read_fingerprint(folder)
    if fingerprint.get("agent") not in (HUMAN, HUMAN_REPLAY):
        raise InputError(
            f"agent {HUMAN_REPLAY}: option {TAKE_OPTION}: expected a take, found {folder}, a run of the agent"
            f" {fingerprint.get('agent')!r:.60}"
        )
    taken = {key: value for key, value in _read_options(fingerprint).items() if key in TAKEN_OPTIONS}
    return replace(agent, config={**taken, **agent.config, TAKE_OPTION: str(folder.resolve())})


def _read_options(fingerprint: Mapping[str, Any]) -> dict[str, Any]:
    """Return the options of the agent of a take; none if they are damaged."""
    try:
        options = json.loads(fingerprint.get("agent_config") or "{}")
    except (TypeError, ValueError, RecursionError):
        return {}
    return options if isinstance(options, dict) else {}


def find_take(agent: AgentSpec) -> Path:
    """Return the run folder that the option `take` names. Raises InputError without one."""
    value = agent.config.get(TAKE_OPTION)
    if not isinstance(value, str) or not value or "\0" in value:
        raise InputError(
            f"agent {HUMAN_REPLAY}: option {TAKE_OPTION}: expected the run folder of a take, e.g."
            f' {{"{TAKE_OPTION}": "runs/drive-.../takes/1"}}, found {"none" if value is None else repr(value)[:60]}'
        )
    return Path(value)


def load_take_actions(agent: AgentSpec, scenario: Scenario) -> dict[str, ActionSource]:
    """Return the recorded actions of every CAV of a scenario; none for other agents than `human-replay`.

    Raises InputError for a take of another scenario, and for a recording that is missing or damaged.
    """
    if agent.agent != HUMAN_REPLAY:
        return {}
    folder = find_take(agent)
    path = recording_path(folder, scenario.id)
    if not path.is_file():
        found = sorted(file.stem for file in path.parent.glob("*.npz"))[:3] if path.parent.is_dir() else []
        raise InputError(
            f"agent {HUMAN_REPLAY}: option {TAKE_OPTION}: expected a take of {scenario.id} in {folder}, found"
            f" {', '.join(found) or 'no recording'}"
        )
    record = load_episode(path)
    egos = tuple(ego.id for ego in scenario.egos)
    if record.scenario != scenario.id or record.ego_ids != egos:
        raise InputError(
            f"{path}: expected a take of {scenario.id} with CAVs {', '.join(egos)}, found one of"
            f" {record.scenario!r:.60} with {', '.join(record.ego_ids)[:60]}"
        )
    return {ego: RecordedActions(record, ego) for ego in egos}


def check_takes(agents: Sequence[AgentSpec], scenarios: Sequence[Scenario]) -> None:
    """Raise InputError unless there is a sound take of every scenario that an agent shall repeat."""
    for agent in agents:
        for scenario in scenarios:
            load_take_actions(agent, scenario)
