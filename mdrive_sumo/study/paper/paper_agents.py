"""The agents of the study: which of the built-in ones can be started here, and what each counts as."""

from collections.abc import Callable, Mapping, Sequence
from enum import StrEnum

from mdrive_sumo.agents.registry import AGENTS, HUMAN_AGENTS
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.private_paths import hide_paths_in_text
from mdrive_sumo.runs.prepared_run import PreparedRun
from mdrive_sumo.scoring import Results
from mdrive_sumo.scoring.labels import JOINT, NEGOTIATION, PRIVILEGED, SHARING
from mdrive_sumo.study.paper.paper_study import DETECTOR_PREFIX, SURROGATE_SUFFIX, is_surrogate

BOUNDS = ("stationary", "constant-speed", "take-turns")
"""Built-in agents that are no driving model: they bound the scores from below."""


class AgentRole(StrEnum):
    """What an agent counts as in comparisons of single-agent and multi-agent systems (RQ1)."""

    SINGLE = "single-agent"
    MULTI = "multi-agent"
    DETECTOR = "perception-swap"
    BOUND = "bound"


def prepare_installed_agents(
    prepare_agent: Callable[[str], PreparedRun], names: Sequence[str] = ()
) -> tuple[dict[str, PreparedRun], dict[str, str]]:
    """Return the prepared runs by agent, and why built-in agents are left out; names: only these agents.

    Raises InputError if an agent that is named cannot be started, or if all of them are surrogates of detectors.
    """
    if names and all(map(is_surrogate, names)):
        raise InputError(
            f"study paper: expected an agent besides {DETECTOR_PREFIX}*{SURROGATE_SUFFIX}, which drive in RQ3 only,"
            f" found {', '.join(names)}"
        )
    if names:
        return {name: prepare_agent(name) for name in names}, {}
    prepared: dict[str, PreparedRun] = {}
    left_out: dict[str, str] = {}
    for name in (one for one in AGENTS if one not in HUMAN_AGENTS):
        try:
            prepared[name] = prepare_agent(name)
        except InputError as error:
            left_out[name] = hide_paths_in_text(str(error))  # it stands in files that leave the machine
    return prepared, left_out


def find_role(results: Results) -> AgentRole:
    """Return what the agent of a run counts as, by name for the built-in bounds and detectors, else by its labels."""
    run = results.run
    if run.agent in BOUNDS or PRIVILEGED in run.labels:
        return AgentRole.BOUND
    if run.agent.startswith(DETECTOR_PREFIX):
        return AgentRole.DETECTOR
    return AgentRole.MULTI if {JOINT, SHARING, NEGOTIATION} & {*run.labels} else AgentRole.SINGLE


def select_by_role(runs: Mapping[str, Results], role: AgentRole) -> dict[str, Results]:
    """Return the runs of the agents with a role."""
    return {name: results for name, results in runs.items() if find_role(results) is role}
