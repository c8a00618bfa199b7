"""Who drives: built-in agents in this process, all others in children of their own, plain or boxed."""

import json
from collections.abc import Generator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from mdrive_sumo.agent_process.agent_connection import AgentConnection
from mdrive_sumo.agent_process.agent_lookup import find_carla_file, split_locator
from mdrive_sumo.agent_process.child_process import AgentProgram, BoxPlan
from mdrive_sumo.agent_process.joint_agent import JointAgentSession
from mdrive_sumo.agent_process.remote_driver import AgentLimits, RemoteDriver, open_agent_connection
from mdrive_sumo.agents.registry import AGENTS
from mdrive_sumo.contract import SensorSpec
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.loop.agent_driver import AgentDriver, LocalDriver
from mdrive_sumo.sensing.cameras import describe_camera_error
from mdrive_sumo.sensing.observation_builder import KINDS

PRIVILEGED = "privileged"
SCANNING, MOST_SCANNING = ("lidar", "bev"), 8
"""Sensors of large arrays, and how many of them an agent in a box may have: 64 of the largest would take 1 GB of the
evaluator's memory for each CAV."""
ANYBODY = "cav"
"""The CAV of an agent that is made to be asked what it declares."""


@dataclass(frozen=True, slots=True)
class Hiring:
    """Which agent, with which options and limits, where it lives, and where its output goes."""

    agent: str
    config: Mapping[str, Any]
    limits: AgentLimits
    box: str = ""
    """See `box_text`; "" is a plain child."""
    logs: str = ""
    """Path without ending: the CAV's id and `.log` are added, for boxes a record in `.json` too; "" for none."""


@dataclass(frozen=True, slots=True)
class Declaration:
    """What an agent says of itself."""

    label: str
    sensors: tuple[SensorSpec, ...]


class RejectedError(InputError):
    """An agent in a box asks for what does not exist or is not allowed; the text is for the participant."""


def box_text(plan: BoxPlan) -> str:
    """A box as plain text, for a `Job`."""
    return json.dumps(asdict(plan), sort_keys=True)


def box_plan(text: str) -> BoxPlan:
    """The inverse; raises InputError."""
    try:
        found = json.loads(text)
    except ValueError:
        raise InputError(f"box: expected JSON, found {text!r:.60}") from None
    known = {field.name for field in fields(BoxPlan)}
    if not isinstance(found, dict) or "folder" not in found or not found.keys() <= known:
        raise InputError(
            f"box: expected an object with folder and any of {', '.join(sorted(known))}, found {text!r:.60}"
        )
    return BoxPlan(**found)


def declaration(hiring: Hiring) -> Declaration:
    """Makes an agent to ask it who it is. Raises AgentFailure, and InputError for a sensor that does not exist."""
    drivers = opened(hiring, (ANYBODY,))
    driver = drivers[ANYBODY]
    try:
        found = Declaration(driver.label, driver.sensors())
    finally:
        driver.close()
    _existing(found.sensors)
    return found


def _existing(sensors: tuple[SensorSpec, ...]) -> None:
    for spec in sensors:
        if spec.kind not in KINDS:
            known = f"sensor {spec.kind!r:.60}: expected one of {', '.join(KINDS)}, found none of that kind"
            raise InputError(describe_camera_error(spec.kind) or known)


def _allowed(sensors: tuple[SensorSpec, ...]) -> None:
    """In a box lives who competes: nobody there is told the truth."""
    _existing(sensors)
    if any(spec.kind == PRIVILEGED for spec in sensors):
        raise InputError(
            f"sensor {PRIVILEGED!r}: expected sensors that a car can have, found one that knows everything"
        )
    if (scanning := sum(sensor.kind in SCANNING for sensor in sensors)) > MOST_SCANNING:
        raise InputError(f"sensors: expected at most {MOST_SCANNING} of {' and '.join(SCANNING)}, found {scanning}")


@contextmanager
def hired(hiring: Hiring, egos: Sequence[str]) -> Generator[dict[str, AgentDriver]]:
    """Drivers for all CAVs, which end with the block. Raises InputError, BoxError and OSError."""
    with ExitStack() as stack:
        yield opened(hiring, egos, stack)


def opened(hiring: Hiring, egos: Sequence[str], stack: ExitStack | None = None) -> dict[str, AgentDriver]:
    """Drivers for all CAVs; whoever asks closes them, or the stack does."""
    stack = stack or ExitStack()
    if hiring.agent in AGENTS:
        if hiring.box:
            raise InputError(f"agent {hiring.agent!r}: expected a third-party agent for a box, found a built-in one")
        return {ego: LocalDriver(AGENTS[hiring.agent](hiring.config)) for ego in egos}
    if find_carla_file(hiring.agent) is not None:
        return _crew(hiring, egos, stack)
    split_locator(hiring.agent)
    check = _allowed if hiring.box else None
    drivers: dict[str, AgentDriver] = {}
    for ego in egos:
        drivers[ego] = driver = RemoteDriver(_line(hiring, ego), hiring.config, check)
        stack.callback(_end, driver, hiring, ego)
    return drivers


def _crew(hiring: Hiring, egos: Sequence[str], stack: ExitStack) -> dict[str, AgentDriver]:
    crew = JointAgentSession(_line(hiring, "all"), hiring.config, egos, _allowed if hiring.box else None)
    stack.callback(_end, crew, hiring, "all")
    return dict(crew.drivers)


def _line(hiring: Hiring, name: str) -> AgentConnection:
    file = find_carla_file(hiring.agent)
    style, locator = ("agent", hiring.agent) if file is None else ("carla", str(file))
    log = Path(f"{hiring.logs}.{name}.log") if hiring.logs else None
    return open_agent_connection(
        AgentProgram(locator, style, log), hiring.limits, box_plan(hiring.box) if hiring.box else None
    )


def _end(driver: RemoteDriver | JointAgentSession, hiring: Hiring, name: str) -> None:
    driver.close()
    if hiring.logs and hiring.box:
        Path(f"{hiring.logs}.{name}.json").write_text(json.dumps(driver.usage_record()))
