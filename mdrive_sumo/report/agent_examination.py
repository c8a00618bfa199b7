"""Examine an agent before it drives: what of its imports and sensors can be had here (`doctor --agent`)."""

import ast
import importlib.util
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from mdrive_sumo.agent_process.agent_file import (
    describe_missing_class,
    drives_one_vehicle,
    has_entry_point,
    list_agent_classes,
    parse_agent_file,
)
from mdrive_sumo.agent_process.agent_lookup import CARLA_PREFIX, find_carla_file, is_joint_locator
from mdrive_sumo.agent_process.carla_stubs import MODULES
from mdrive_sumo.contract import SensorSpec
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.tables import format_text, make_text_table
from mdrive_sumo.loop.agent_driver import AgentFailure
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.open_agents import declare_agent, find_unknown_sensor
from mdrive_sumo.sensing.camera.camera_renderer import check_renderer
from mdrive_sumo.sensing.sensor_kinds import BUDGET_MS, SENSOR_KINDS, price_sensor

CARLA_ROOTS = frozenset(("carla", "leaderboard", "agents", "srunner"))
"""Packages of CARLA, of its leaderboard and of its scenario runner."""
NO_SIMULATOR = "there is no CARLA here: no client, world, map or actor; what the agent knows comes by its sensors"
REPLACEMENTS = {
    "sensor.other.radar": "no radar here; LiDAR and cameras see the same road users",
    "sensor.lidar.ray_cast_semantic": "LiDAR without classes here: sensor.lidar.ray_cast",
    "sensor.opendrive_map": "no map here; set_global_plan() has the route",
}
"""What to say of sensors of CARLA that do not exist here."""


@dataclass(frozen=True, slots=True)
class AgentFinding:
    """One thing that an agent needs, and whether it can be had here."""

    what: str
    is_found: bool
    detail: str


def find_agent(text: str) -> AgentSpec:
    """Return the agent that `FILE[:Class]`, or anything that `--agent` takes, names. Raises InputError."""
    path = Path(text)
    if path.suffix != ".py" or find_carla_file(text) is not None:
        return AgentSpec(text).resolve()
    if path.is_file() and has_entry_point(path):
        return AgentSpec(f"{CARLA_PREFIX}{path}").resolve()
    classes = list_agent_classes(path)
    if len(classes) != 1:
        raise InputError(f"agent {text!r}: expected path.py:Class, {describe_missing_class(path)}")
    return AgentSpec(f"{path}:{classes[0]}").resolve()


def examine_agent(agent: AgentSpec) -> tuple[AgentFinding, ...]:
    """Read the file of an agent, create it in a process of its own, and return what can and cannot be had here.

    agent: as `find_agent` returns it. Raises InputError for an agent that is missing.
    """
    file = agent.find_file()
    if file is not None and not file.is_file():
        raise InputError(f"agent {agent.name}: expected a Python file, found none")
    findings = [AgentFinding("kind", True, _describe_kind(agent))]
    if file is not None:
        findings += _examine_imports(file, is_carla=find_carla_file(agent.name) is not None)
    return (*findings, *_examine_declaration(agent))


def _describe_kind(agent: AgentSpec) -> str:
    if agent.is_builtin:
        return "built in; drives in the worker's process"
    if is_joint_locator(agent.agent):
        return "CARLA leaderboard, one object for all CAVs: setup(config, ego_num), a list of controls; label joint"
    if (file := find_carla_file(agent.name)) is not None:
        how = "setup(config)" if drives_one_vehicle(file) else "named carla-single:"
        return f"CARLA leaderboard, one vehicle ({how}): every CAV gets an instance; no messages"
    return "Agent of mdrive-sumo: every CAV gets an instance"


def _examine_imports(file: Path, *, is_carla: bool) -> Iterator[AgentFinding]:
    """Yield a finding for every import that cannot be had here, and one for all others together."""
    module = parse_agent_file(file)
    if module is None:
        yield AgentFinding("file", False, f"{file.name}: expected Python {sys.version_info[0]}.{sys.version_info[1]}")
        return
    has_carla = _is_installed("carla", file)
    names = dict(sorted(_list_imports(module).items()))
    missing = 0
    for name, imported in names.items():
        if is_carla and not has_carla and name.split(".")[0] in CARLA_ROOTS and not _is_beside(name, file):
            findings = list(_examine_carla_names(name, imported))
        else:
            findings = [] if _is_installed(name, file) else [_make_missing_import(name)]
        missing += bool(findings)
        yield from findings
    if is_carla and not has_carla:
        yield from _examine_carla_names("carla", _list_attributes(module, "carla") - names.get("carla", set()))
    yield AgentFinding("imports", not missing, f"{len(names) - missing} of {len(names)} modules can be imported")


def _list_imports(module: ast.Module) -> dict[str, set[str]]:
    """Return the names that a file imports from each module; relative imports and those that it tries are left out."""
    names_by_module: dict[str, set[str]] = {}
    tried = {part for node in ast.walk(module) if isinstance(node, ast.Try) for part in ast.walk(node)}
    for node in (node for node in ast.walk(module) if node not in tried):
        if isinstance(node, ast.Import):
            for alias in node.names:
                names_by_module.setdefault(alias.name, set())
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names_by_module.setdefault(node.module, set()).update(alias.name for alias in node.names)
    return names_by_module


def _list_attributes(module: ast.Module, name: str) -> set[str]:
    """Return the attributes of an imported module that a file uses: `carla.X` somewhere in it."""
    return {
        node.attr
        for node in ast.walk(module)
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == name
    }


def _examine_carla_names(module: str, names: Iterable[str]) -> Iterator[AgentFinding]:
    """Yield a finding for each name of CARLA that the stubs do not have."""
    if module not in MODULES:
        yield AgentFinding(f"import {module}", False, NO_SIMULATOR)
        return
    provided = {cls.__name__ for cls in MODULES[module]} | {
        name.rpartition(".")[2] for name in MODULES if name.rpartition(".")[0] == module
    }
    for name in sorted(set(names) - provided - {"*"}):
        yield AgentFinding(f"{module}.{name}", False, NO_SIMULATOR)


def _is_beside(name: str, file: Path) -> bool:
    """Return whether a module is a file or folder beside the agent's."""
    place = file.parent / name.split(".")[0]
    return place.is_dir() or place.with_suffix(".py").is_file()


def _is_installed(name: str, file: Path) -> bool:
    """Return whether a module's package is installed or lies beside the agent. Nothing is imported."""
    root = name.split(".")[0]
    if root in sys.builtin_module_names or root in sys.stdlib_module_names or _is_beside(name, file):
        return True
    try:
        spec = importlib.util.find_spec(root)
    except (ImportError, ValueError):
        return False
    return spec is not None and (spec.origin is not None or root not in CARLA_ROOTS)


def _make_missing_import(name: str) -> AgentFinding:
    return AgentFinding(f"import {name}", False, "not installed in the environment of mdrive-sumo")


def _examine_declaration(agent: AgentSpec) -> Iterator[AgentFinding]:
    """Create the agent and yield its label and a finding for each sensor."""
    try:
        declared = declare_agent(agent)
    except AgentFailure as error:
        yield AgentFinding("creation", False, error.text)
        return
    yield AgentFinding("creation", True, f"label {declared.label}")
    for sensor in declared.sensors:
        yield _examine_sensor(sensor)
    price_ms = sum(price_sensor(sensor) for sensor in declared.sensors if not find_unknown_sensor((sensor,)))
    price = f"{price_ms:.1f} ms a tick; a challenge refuses more than {BUDGET_MS:g}"
    yield AgentFinding("price of sensors", True, price)


def _examine_sensor(sensor: SensorSpec) -> AgentFinding:
    what = f"sensor {sensor.id!r} ({sensor.kind})" if sensor.id else f"sensor {sensor.kind}"
    if unknown := find_unknown_sensor((sensor,)):
        return AgentFinding(what, False, REPLACEMENTS.get(sensor.kind, unknown.partition(": ")[2]))
    if SENSOR_KINDS[sensor.kind].knows_everything:
        return AgentFinding(what, True, "labels the run privileged; a challenge refuses it")
    try:
        check_renderer((sensor,))
    except InputError as error:
        return AgentFinding(what, False, str(error))
    return AgentFinding(what, True, "")


def format_agent_table(findings: Iterable[AgentFinding]) -> str:
    """Return the findings as a table for the terminal."""
    rows = [(finding.what, "yes" if finding.is_found else "NO", finding.detail) for finding in findings]
    return format_text(make_text_table(("agent", "here", "detail"), rows))
