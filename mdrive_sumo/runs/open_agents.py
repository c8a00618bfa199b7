"""Start the agents of an episode: built-in ones in this process, all others in child processes, plain or boxed."""

import json
import re
from collections.abc import Generator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from types import MappingProxyType
from typing import Any, cast

from mdrive_sumo.agent_process.agent_connection import AgentConnection, ConnectionGroup
from mdrive_sumo.agent_process.agent_lookup import find_carla_file, is_joint_locator, split_locator
from mdrive_sumo.agent_process.child_process import PACKAGE, AgentProgram
from mdrive_sumo.agent_process.joint_agent import JointAgentSession
from mdrive_sumo.agent_process.remote_driver import RemoteDriver, open_agent_connection
from mdrive_sumo.agent_process.reply_decoding import AgentDeclaration
from mdrive_sumo.agent_process.sandbox import BoxKilledError
from mdrive_sumo.agents.registry import AGENTS, HUMAN_AGENTS
from mdrive_sumo.contract import SensorSpec
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.input_files import read_bytes
from mdrive_sumo.core.output_files import write_text
from mdrive_sumo.core.posix import check_posix
from mdrive_sumo.loop.agent_driver import AgentDriver, AgentFailure, LocalDriver, shorten
from mdrive_sumo.loop.human_actions import ActionSource
from mdrive_sumo.loop.human_driver import HumanDriver
from mdrive_sumo.runs.agent_spec import AgentSpec, pickle_agent
from mdrive_sumo.sensing.sensor_kinds import SENSOR_KINDS, check_sensor_budget, describe_camera_error

_TRACEBACK_PLACE = re.compile(r'^  File "(.+)", line (\d+)', re.MULTILINE)
MAX_LOG_BYTES = 2**16
"""The end of a log that is searched for the traceback of a failed agent; a traceback has a few KiB."""
MAX_ARRAY_SENSORS = 8
"""Sensors with large arrays that a boxed agent may have: 64 of the largest would take 1 GB of the evaluator's memory
for each CAV."""
SINGLE = "single"
"""Label of an agent of the CARLA leaderboard that drives one vehicle: it neither sends nor reads messages."""
NO_ACTIONS: Mapping[str, ActionSource] = MappingProxyType({})
DECLARING_CAV = "cav"
"""Id of the CAV of an agent that is created only to read its declaration."""


class RejectedError(InputError):
    """A boxed agent declares what does not exist or is not allowed; the text is for the participant."""


def declare_agent(spec: AgentSpec) -> AgentDeclaration:
    """Create an agent and return its label and sensors.

    Raises AgentFailure, BoxError, InputError; RejectedError for sensors that a boxed agent must not have.
    """
    try:
        return _declare_agent(spec)
    except BoxKilledError:
        return _declare_agent(spec.own_signals())


def _declare_agent(spec: AgentSpec) -> AgentDeclaration:
    with TemporaryDirectory(prefix="mdrive-declare-") as name:
        logs = Path(name) / "agent"
        try:
            with open_agents(spec, {DECLARING_CAV: DECLARING_CAV}, logs) as drivers:
                driver = drivers[DECLARING_CAV]
                return AgentDeclaration(driver.label, driver.sensors())
        except AgentFailure as error:
            place = _find_failing_line(logs)
            text = error.text if place in error.text else error.text + place  # a SyntaxError names its line itself
            raise AgentFailure(error.failure, text) from None


def _find_failing_line(logs: Path) -> str:
    """Return " (mine.py, line 12)": the innermost place of the traceback in an agent's log; "" without one."""
    for log in (_append(logs, f"{DECLARING_CAV}.log"), _append(logs, "all.log")):
        if log is not None and log.is_file():
            places = _TRACEBACK_PLACE.findall(read_bytes(log)[-MAX_LOG_BYTES:].decode("utf-8", "replace"))
            if places and PACKAGE not in Path(places[-1][0]).parents:
                return f" ({shorten(Path(places[-1][0]).name, 60)}, line {places[-1][1]})"
    return ""


def find_unknown_sensor(sensors: Sequence[SensorSpec]) -> str:
    """Return a sentence about the first sensor whose kind does not exist; "" if all exist."""
    for spec in sensors:
        if spec.kind not in SENSOR_KINDS:
            sentence = f"sensor {spec.kind!r:.60}: expected one of {', '.join(SENSOR_KINDS)}, found none of that kind"
            name = f" (id {spec.id!r:.40})" if spec.id else ""
            return (describe_camera_error(spec.kind) or sentence) + name
    return ""


def _check_boxed_sensors(sensors: tuple[SensorSpec, ...]) -> None:
    """Raise RejectedError for sensors that a competing agent must not have."""
    if unknown := find_unknown_sensor(sensors):
        raise RejectedError(unknown)
    for spec in sensors:
        if SENSOR_KINDS[spec.kind].knows_everything:
            raise RejectedError(
                f"sensor {spec.kind!r}: expected sensors that a car can have, found one that knows everything"
            )
    large = [name for name, kind in SENSOR_KINDS.items() if kind.has_large_arrays]
    if (count := sum(sensor.kind in large for sensor in sensors)) > MAX_ARRAY_SENSORS:
        raise RejectedError(f"sensors: expected at most {MAX_ARRAY_SENSORS} of {' and '.join(large)}, found {count}")
    try:
        check_sensor_budget(sensors)
    except InputError as error:
        raise RejectedError(str(error)) from None


@contextmanager
def open_agents(
    spec: AgentSpec,
    pseudonyms: Mapping[str, str],
    logs: Path | None = None,
    group: ConnectionGroup | None = None,
    actions: Mapping[str, ActionSource] = NO_ACTIONS,
) -> Generator[dict[str, AgentDriver]]:
    """Start an agent for every CAV and yield driver by CAV id; the agents end with the block.

    pseudonyms: the id by which agents know each CAV, by CAV in the order of the scenario. Other processes are started
    in the order of the pseudonyms and see no other id of their CAV, because their number and the names of their files
    are no secret. logs: path without ending for the output of child processes: the CAV's id and `.log` are appended,
    for boxes also a record in `.json`; None discards the output. group: of all agents of the episode, if these are
    not all. actions: of people, by CAV, for `human` and `human-replay`. Raises InputError, BoxError and OSError.
    """
    if isinstance(spec.agent, str) and spec.agent in HUMAN_AGENTS:
        yield {ego: open_human_driver(ego, actions.get(ego), spec) for ego in pseudonyms}
        return
    with ExitStack() as stack:
        yield _open(spec, pseudonyms, logs, group if group is not None else ConnectionGroup(), stack)


def _open(
    spec: AgentSpec, pseudonyms: Mapping[str, str], logs: Path | None, group: ConnectionGroup, stack: ExitStack
) -> dict[str, AgentDriver]:
    if isinstance(spec.agent, str) and spec.agent in AGENTS:
        if spec.box:
            raise InputError(f"agent {spec.agent!r}: expected a third-party agent for a box, found a built-in one")
        return {ego: LocalDriver(AGENTS[spec.agent](spec.config)) for ego in pseudonyms}
    check_posix(f"agent {spec.name!r}: a process of its own")
    check = _check_boxed_sensors if spec.box else None
    if is_joint_locator(spec.agent):
        session = JointAgentSession(_connect(spec, "all", logs, group), spec.config, pseudonyms, check)
        stack.callback(_close, session, spec, _append(logs, "all.json"))
        return {**session.drivers}
    drivers: dict[str, AgentDriver] = {}
    for ego, told in sorted(pseudonyms.items(), key=lambda pair: pair[1]):
        line = _connect(spec, told, logs, group)
        if isinstance(spec.agent, str) and find_carla_file(spec.agent) is not None:
            closed = JointAgentSession(line, spec.config, {ego: told}, check, label=SINGLE)
            drivers |= closed.drivers
        else:
            closed = drivers[ego] = RemoteDriver(line, spec.config, check)
        stack.callback(_rename, _append(logs, f"{told}.log"), _append(logs, f"{ego}.log"))
        stack.callback(_close, closed, spec, _append(logs, f"{ego}.json"))
    return drivers


def open_human_driver(
    ego: str, actions: ActionSource | None, spec: AgentSpec, watching: tuple[SensorSpec, ...] = ()
) -> HumanDriver:
    """Return the driver of a CAV that people drive. Raises InputError.

    spec: `human` or `human-replay`. watching: sensors besides those that drivers need.
    """
    return HumanDriver(ego, actions, cast(Any, HUMAN_AGENTS[str(spec.agent)](spec.config)), watching)


def _rename(log: Path | None, name: Path | None) -> None:
    """Give the log of an ended process its final name: a process can read the name of the file that it writes to."""
    if log is not None and name is not None and log.exists():
        log.rename(name)


def _connect(spec: AgentSpec, name: str, logs: Path | None, group: ConnectionGroup) -> AgentConnection:
    return open_agent_connection(_make_program(spec, _append(logs, f"{name}.log")), spec.limits, spec.box, group)


def _make_program(spec: AgentSpec, log: Path | None) -> AgentProgram:
    if not isinstance(spec.agent, str):
        if spec.box:
            raise InputError(f"agent {spec.name!r}: expected a locator for a box, found a class")
        return AgentProgram("", "pickle", log, pickle_agent(spec.agent))
    if (file := find_carla_file(spec.agent)) is not None:
        return AgentProgram(str(file), "carla" if is_joint_locator(spec.agent) else "carla-single", log)
    split_locator(spec.agent)
    return AgentProgram(spec.agent, "agent", log)


def _append(path: Path | None, ending: str) -> Path | None:
    return None if path is None else path.with_name(f"{path.name}.{ending}")


def _close(driver: RemoteDriver | JointAgentSession, spec: AgentSpec, record: Path | None) -> None:
    driver.close()
    if record is not None and spec.box is not None:
        write_text(record, json.dumps(driver.usage_record()))
