"""Read a plan of a study, YAML or JSON, and check it against the suite; every fault is one sentence."""

import json
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from mdrive_sumo.agents.registry import AGENTS, ASKING_AGENTS, HUMAN_AGENTS
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.input_files import read_text
from mdrive_sumo.core.installation_command import format_installation
from mdrive_sumo.core.suggestion import describe_unknown, suggest_name
from mdrive_sumo.scenario.scenario import describe_first_error
from mdrive_sumo.scenario.suite import Suite, load_suite
from mdrive_sumo.study.human.human_study_plan import PERSON, HumanStudyPlan, PlannedScenario
from mdrive_sumo.study.human.latin_square import build_latin_square

MAX_PLAN_BYTES = 1_000_000
MAX_DEPTH = 12
"""Nested lists and mappings of a YAML file; a plan has five."""


def load_plan(path: Path) -> HumanStudyPlan:
    """Return the plan of a file. Raises InputError with one sentence; `check_plan` compares it with its suite."""
    try:
        text = read_text(path, MAX_PLAN_BYTES)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise InputError(f"{path}: expected text in UTF-8, found other bytes") from None
    data = _parse_json(path, text) if path.suffix == ".json" else _parse_yaml(path, text)
    if not isinstance(data, Mapping):
        found = "nothing" if data is None else f"a {type(data).__name__}"
        raise InputError(f"{path}: expected the keys of a plan (title, consent, scenarios, ...), found {found}")
    try:
        return HumanStudyPlan.model_validate(data)
    except ValidationError as error:
        raise InputError(f"{path}: {describe_first_error(error)}") from None


def _parse_json(path: Path, text: str) -> Any:
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: expected JSON, found a fault: {error}") from None


def _parse_yaml(path: Path, text: str) -> Any:
    try:
        yaml = import_module("yaml")
    except ImportError:
        raise InputError(
            f"{path}: YAML needs an extra: {format_installation('server')}, or give the plan as .json"
        ) from None
    try:
        _check_events(path, yaml, text)
        return yaml.load(text, Loader=_make_loader(yaml))
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f" in line {mark.line + 1}" if mark is not None else ""
        problem = getattr(error, "problem", None) or "a character that YAML does not allow"
        raise InputError(f"{path}: expected YAML, found a fault{where}: {problem}") from None
    except ValueError as error:  # a date that does not exist, an integer of too many digits
        raise InputError(f"{path}: expected YAML, found a value that cannot be read: {error}") from None


def _check_events(path: Path, yaml: Any, text: str) -> None:
    """Refuse what a plan does not need and what could take any memory: aliases, and lists in lists in lists."""
    depth = 0
    for event in yaml.parse(text, Loader=yaml.CSafeLoader):
        if isinstance(event, yaml.AliasEvent):
            raise InputError(f"{path}: expected no aliases, found *{event.anchor}; write the value out")
        if isinstance(event, yaml.CollectionStartEvent):
            depth += 1
        elif isinstance(event, yaml.CollectionEndEvent):
            depth -= 1
        if depth > MAX_DEPTH:
            raise InputError(f"{path}: expected at most {MAX_DEPTH} levels of lists and mappings, found more")


def _make_loader(yaml: Any) -> Any:
    """Return PyYAML's safe loader that refuses a key given twice, of which it would silently take the last value."""

    class PlanLoader(yaml.CSafeLoader):
        def construct_mapping(self, node: Any, deep: bool = False) -> Any:
            keys: set[str] = set()
            for key, _ in node.value:
                if key.value in keys:
                    problem = f"the key {key.value!r:.60} stands twice"
                    raise yaml.constructor.ConstructorError(None, None, problem, key.start_mark)
                keys.add(str(key.value))
            return super().construct_mapping(node, deep=deep)

    return PlanLoader


def check_plan(plan: HumanStudyPlan, where: str) -> Suite:
    """Return the plan's suite. where: begins sentences. Raises InputError for what the suite or agents do not have."""
    suite = load_suite(plan.suite_name)
    cavs_by_id = {scenario.id: len(scenario.egos) for scenario in suite}
    for part, entries in (
        ("scenarios", plan.scenarios),
        ("practice", plan.practice.scenarios if plan.practice else ()),
    ):
        for entry in entries:
            _check_scenario(f"{where}: {part}", entry, cavs_by_id, suite.label)
    for condition in plan.conditions:
        place = f"{where}: conditions: {condition.name}: partner"
        if not condition.has_person:
            _check_agent(place, condition.partner, also=f"or {PERSON}")
            continue
        for entry in plan.scenarios:
            if cavs_by_id[entry.id] < entry.cav + 2:
                raise InputError(
                    f"{place}: expected a CAV after cav {entry.cav} for the partner, found {entry.id} with"
                    f" {cavs_by_id[entry.id]}"
                )
    for name in plan.compare:
        _check_agent(f"{where}: compare", name)
    return suite


def _check_scenario(where: str, entry: PlannedScenario, cavs_by_id: Mapping[str, int], suite: str) -> None:
    cavs = cavs_by_id.get(entry.id)
    if cavs is None:
        raise InputError(
            f"{where}: expected ids of the suite {suite}, found {entry.id!r}{suggest_name(entry.id, cavs_by_id)};"
            " mdrive-sumo list scenarios lists them"
        )
    if entry.cav >= cavs:
        raise InputError(f"{where}: {entry.id}: expected a cav from 0 to {cavs - 1}, found {entry.cav}")


def _check_agent(where: str, name: str, also: str = "") -> None:
    names = [agent for agent in AGENTS if agent not in ASKING_AGENTS and agent not in HUMAN_AGENTS]
    if name in ASKING_AGENTS:
        raise InputError(f"{where}: expected an agent that drives in real time, found {name!r}, which asks a model")
    if name not in names:
        raise InputError(f"{where}: {describe_unknown(name, names, also)}")


def describe_balance(plan: HumanStudyPlan) -> str:
    """Return what is not balanced with this number of participants; "" if every order is taken equally often."""
    groups = len(plan.codes) // (2 if plan.has_pairs else 1)
    unit = "pairs of participants" if plan.has_pairs else "participants"
    needed = count_orders(plan)
    if groups % needed == 0:
        return ""
    return f"{groups} {unit}: orders are balanced with a multiple of {needed}"


def count_orders(plan: HumanStudyPlan) -> int:
    """Return the number of participants, or pairs, after which all orders of conditions were taken equally often."""
    return len(build_latin_square(len(plan.conditions)))
