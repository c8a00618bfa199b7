"""Reference times: after how many ticks each CAV of `omniscient` arrived, measured and kept beside a suite.

Time ratio and efficient SR compare an agent with them (`scoring.efficiency`, docs/scoring.md). Two commands write the
file, `mdrive-sumo validate SUITE --write` and `mdrive-sumo reference-times RUN`; every reader calls
`find_reference_times`. An entry belongs to one state of its scenario, so that a changed scenario loses only its own.
"""

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from mdrive_sumo.core.input_files import read_bytes
from mdrive_sumo.core.output_files import write_text
from mdrive_sumo.scenario.scenario import Scenario, load_model
from mdrive_sumo.scenario.scenario_part import Identifier
from mdrive_sumo.scenario.suite import NETWORKS_FOLDER, Suite

REFERENCE_TIMES_FILE = "reference_times.json"
REFERENCE_AGENT = "omniscient"
REFERENCE_SEED = 0
"""The scenario as written; other seeds draw other starts and drivers, but share its times."""

ReferenceTicks = Mapping[str, int]
"""Ticks from the start to the arrival, by CAV id; a CAV that did not arrive is missing."""
NO_REFERENCE: ReferenceTicks = {}


class _FilePart(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)


class ScenarioReferenceTimes(_FilePart):
    """The reference of one scenario."""

    scenario: Identifier
    checksum: str
    """Of the scenario that was driven, see `compute_scenario_checksum`."""
    ticks: Mapping[str, Annotated[int, Field(ge=1)]]
    """Ticks to the arrival by CAV id, without CAVs that did not arrive."""


class ReferenceTimesFile(_FilePart):
    """`reference_times.json` of a suite."""

    format: Literal["mdrive-sumo/reference-times/1"] = "mdrive-sumo/reference-times/1"
    agent: Literal["omniscient"] = REFERENCE_AGENT
    seed: Literal[0] = REFERENCE_SEED
    scenarios: tuple[ScenarioReferenceTimes, ...]


def compute_scenario_checksum(scenario: Scenario, folder: Path) -> str:
    """Return SHA-256 over a scenario, formatting aside, and over its network if the suite in `folder` has it."""
    digest = hashlib.sha256(scenario.model_dump_json().encode())
    for path in sorted((folder / NETWORKS_FOLDER / scenario.network).glob("*")):
        digest.update(path.name.encode() + b"\0" + read_bytes(path))
    return "sha256:" + digest.hexdigest()


def find_reference_times(scenario: Scenario, folder: Path) -> ReferenceTicks:
    """Return the reference of a scenario of the suite in `folder`, for every CAV or for none.

    None: it was not measured, belongs to another state of the scenario, or not every CAV of `omniscient` arrived. A
    scenario that a seed drew has the reference of the scenario as written. Raises InputError for an unreadable file.
    """
    scenario = scenario.as_written
    entry = _find_entry(scenario, folder)
    if entry is None or entry.checksum != compute_scenario_checksum(scenario, folder):
        return NO_REFERENCE
    return entry.ticks if {ego.id for ego in scenario.egos} <= set(entry.ticks) else NO_REFERENCE


def find_noted_ticks(scenario: Scenario, folder: Path) -> ReferenceTicks:
    """Return the ticks that the file has for a scenario of that name, which may belong to another state of it.

    Enough to guess how long an episode takes. Raises InputError for an unreadable file.
    """
    entry = _find_entry(scenario, folder)
    return NO_REFERENCE if entry is None else entry.ticks


def describe_stored_times(scenario: Scenario, folder: Path) -> str:
    """Return in words what the file has for a scenario whose reference is not there. Raises InputError."""
    entry = _find_entry(scenario, folder)
    if entry is None:
        return "none"
    if entry.checksum != compute_scenario_checksum(scenario, folder):
        return "those of another version of the scenario"
    late = next(ego.id for ego in scenario.egos if ego.id not in entry.ticks)
    return f"none of CAV {late}, which did not arrive"


def _find_entry(scenario: Scenario, folder: Path) -> ScenarioReferenceTimes | None:
    path = folder / REFERENCE_TIMES_FILE
    if not path.is_file():
        return None
    return _read_entries_once(path, path.stat().st_mtime_ns).get(scenario.id)


def read_reference_times(folder: Path) -> ReferenceTimesFile | None:
    """Return the file in a suite's folder, also with entries of other states of it. Raises InputError."""
    path = folder / REFERENCE_TIMES_FILE
    if not path.is_file():
        return None
    return load_model(path, ReferenceTimesFile)


def save_reference_times(suite: Suite, measured: Mapping[str, ReferenceTicks]) -> int:
    """Write the file of a suite without parts and return its number of entries.

    measured: the ticks of scenarios that were driven now; the entries of all others are kept as they are.
    """
    kept = {entry.scenario: entry for entry in _list_entries(read_reference_times(suite.folder))}
    for scenario in suite.scenarios:
        if scenario.id in measured:
            checksum = compute_scenario_checksum(scenario, suite.folder)
            ticks = dict(measured[scenario.id])
            kept[scenario.id] = ScenarioReferenceTimes(scenario=scenario.id, checksum=checksum, ticks=ticks)
    entries = [kept[scenario.id] for scenario in suite.scenarios if scenario.id in kept]
    _write(suite.folder / REFERENCE_TIMES_FILE, entries)
    return len(entries)


def list_unmeasured(suite: Suite) -> tuple[str, ...]:
    """Return the scenarios of a suite without parts that have no entry, or one of another state. Raises InputError."""
    kept = {entry.scenario: entry.checksum for entry in _list_entries(read_reference_times(suite.folder))}
    return tuple(one.id for one in suite.scenarios if kept.get(one.id) != compute_scenario_checksum(one, suite.folder))


@lru_cache(maxsize=8)
def _read_entries_once(path: Path, modified_ns: int) -> Mapping[str, ScenarioReferenceTimes]:  # noqa: ARG001 (the key of a file's state)
    return {entry.scenario: entry for entry in _list_entries(read_reference_times(path.parent))}


def _list_entries(file: ReferenceTimesFile | None) -> Iterable[ScenarioReferenceTimes]:
    return file.scenarios if file is not None else ()


def _write(path: Path, entries: Sequence[ScenarioReferenceTimes]) -> None:
    """Write the entries, one a line, so that a change shows the scenario that it concerns."""
    head = ReferenceTimesFile(scenarios=()).model_dump_json(exclude={"scenarios"})
    lines = ",\n".join(entry.model_dump_json() for entry in entries)
    write_text(path, f'{head[:-1]},"scenarios":[\n{lines}\n]}}\n')
