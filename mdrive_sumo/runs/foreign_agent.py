"""Permission to run the agent of a stored run: its code comes with the run folder, which may be a stranger's.

`verify` and `study ablate` execute episodes again, and with them the file that the journal names. Built-in agents need
no permission; the code of others runs only if the user trusts it, or in a box.
"""

from collections.abc import Callable
from dataclasses import replace

from mdrive_sumo.core.checksum import compute_file_checksum
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.runs.agent_boxing import find_boxed_file
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.prepared_run import PreparedRun

CODE_KEYS = ("agent_code", "others_code")
"""Where a fingerprint has the checksums of the agents of a run, in their order."""
REMEDY = "read it, then add --trust-agent, or --sandbox to run it in a box"


def permit_agent(
    run: PreparedRun,
    *,
    trusted: bool = False,
    sandbox: bool = False,
    place: str | None = None,
    ask: Callable[[str], bool] | None = None,
) -> PreparedRun:
    """Return the stored run as it may be executed again.

    trusted: the user trusts the code of all agents of the run. sandbox: run them in boxes, as a run made with
    `eval --sandbox` always is. place: where the agent under test is now, if it has moved. ask: puts a question to the
    user. Raises InputError if an agent may not run, is missing, or is not the one of the run.
    """
    agent = run.config.agent if place is None else replace(run.config.agent, agent=place).resolve()
    if agent.is_builtin and not run.config.agent.is_builtin:
        raise InputError(f"--agent: expected where {run.config.agent.name} is now, found the built-in {agent.name}")
    config = replace(run.config, agent=agent)
    if config.is_builtin:
        return run
    boxed = sandbox or run.config.sandbox
    foreign = [
        (foreign_agent, key)
        for foreign_agent, key in zip(config.agents, CODE_KEYS, strict=False)
        if not foreign_agent.is_builtin
    ]
    for foreign_agent, _ in foreign if boxed else ():
        find_boxed_file(foreign_agent)  # before anything else: a module cannot run in a box
    for foreign_agent, key in foreign:
        _permit_code(run, foreign_agent, key, ask, permitted=boxed or trusted)
    return replace(run, config=replace(config, sandbox=boxed))


def _permit_code(
    run: PreparedRun, agent: AgentSpec, key: str, ask: Callable[[str], bool] | None, *, permitted: bool
) -> None:
    """Raise InputError unless an agent's code is that of the run and may run. key: of its checksum."""
    check_agent_unchanged(run, agent, key)  # reads the file only
    if not permitted:
        what = f"{run.folder}: this would run {describe_foreign_agent(agent)} with all your permissions"
        if ask is None or not ask(f"{what}. Run it?"):
            raise InputError(f"{what}; {REMEDY}")


def describe_foreign_agent(agent: AgentSpec) -> str:
    """Return which code an agent is, as far as it is known without running it."""
    file = agent.find_file()
    if file is None:
        return f"the agent {agent.name}, a module that Python finds"
    return f"the agent {agent.name} (sha256 {compute_file_checksum(file)[7:23]})"


def check_agent_unchanged(run: PreparedRun, agent: AgentSpec, key: str = CODE_KEYS[0]) -> None:
    """Raise InputError if an agent's code is missing or is not that of the run. key: of its checksum."""
    file = agent.find_file()
    expected = run.fingerprint.get(key, "")
    if file is not None and not file.is_file():
        raise InputError(
            f"{run.folder}: expected the run's agent at {file}, found no file; --agent PATH:CLASS says where it is now"
        )
    checksum = agent.code_checksum()
    if expected != checksum:
        raise InputError(
            f"{run.folder}: the agent has changed since this run: expected {agent.name} with the checksum"
            f" {str(expected)[:23]}..., found {checksum[:23]}...; restore it, or give its copy with --agent PATH:CLASS"
        )
