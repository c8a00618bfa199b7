"""`archive.json`: what a search found, one family after the other, with the elite of every cell."""

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict

from mdrive_sumo.core.output_files import make_folder, write_text
from mdrive_sumo.generate.hard.behaviour_archive import DESCRIPTORS, FamilySearch, find_cell, list_behaviour
from mdrive_sumo.generate.hard.candidate_evaluation import CandidateEvaluation
from mdrive_sumo.generate.hard.candidate_probes import PROBE_SEEDS
from mdrive_sumo.runs.evaluate import report_write_errors

ARCHIVE_FILE = "archive.json"


class _FilePart(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)


class ArchiveDescriptor(_FilePart):
    """A measure of behaviour."""

    name: str
    unit: str
    edges: tuple[float, ...]
    """Bounds of the cells."""


class ArchiveElite(_FilePart):
    """The best candidate of a cell."""

    id: str
    cell: tuple[int, ...]
    """Index along each descriptor."""
    behaviour: tuple[float, ...]
    gap: float
    """Points that the best rules that talk lose against `omniscient`, mean over the seeds."""
    scores: Mapping[str, float]
    """Mean scores (mode `hard`) by agent."""
    is_certified: bool
    """Whether the certificate of need holds."""
    network: str
    values: tuple[float, ...]
    """Of the family's parameters."""
    is_chosen: bool = False
    """Whether a scenario of the suite is in this cell."""


class FamilyArchive(_FilePart):
    """The archive of one family."""

    family: str
    parameters: tuple[str, ...]
    cells: int
    evaluated: int
    """Candidates."""
    rejected: Mapping[str, int]
    """Number of candidates by the stage that rejected them."""
    elites: tuple[ArchiveElite, ...]


class HardArchiveFile(_FilePart):
    """`archive.json`."""

    format: Literal["mdrive-sumo/hard-archive/3"] = "mdrive-sumo/hard-archive/3"
    seeds: tuple[int, ...] = PROBE_SEEDS
    """Of the scores."""
    descriptors: tuple[ArchiveDescriptor, ...]
    families: tuple[FamilyArchive, ...]


def build_archive_file(searches: Sequence[FamilySearch], chosen: Collection[str] = ()) -> HardArchiveFile:
    """Return the content of `archive.json`. chosen: ids of the scenarios of the suite."""
    return HardArchiveFile(
        descriptors=tuple(
            ArchiveDescriptor(name=one.name, unit=one.unit, edges=tuple(round(edge, 3) for edge in one.edges))
            for one in DESCRIPTORS
        ),
        families=tuple(_describe_family(search, chosen) for search in searches),
    )


def save_archive_file(content: HardArchiveFile, folder: Path) -> Path:
    """Write `archive.json` into a folder and return its path. Raises InputError."""
    path = folder / ARCHIVE_FILE
    with report_write_errors(path):
        make_folder(folder)
        write_text(path, content.model_dump_json(indent=1) + "\n")
    return path


def _describe_family(search: FamilySearch, chosen: Collection[str]) -> FamilyArchive:
    cells = {find_cell(one.measured) for one in search.evaluations if one.id in chosen}
    rejected = Counter(str(one.stage) for one in search.evaluations if one.stage is not None)
    return FamilyArchive(
        family=search.family.category,
        parameters=tuple(parameter.name for parameter in search.family.parameters),
        cells=search.cells,
        evaluated=len(search.evaluations),
        rejected=dict(sorted(rejected.items())),
        elites=tuple(_describe_elite(elite, find_cell(elite.measured) in cells) for elite in search.elites),
    )


def _describe_elite(elite: CandidateEvaluation, is_chosen: bool) -> ArchiveElite:
    figures = elite.measured
    return ArchiveElite(
        id=elite.id,
        cell=find_cell(figures),
        behaviour=list_behaviour(figures),
        gap=round(figures.gap, 3),
        scores={name: round(score, 3) for name, score in figures.scores.items()},
        is_certified=figures.is_certified,
        network=figures.network,
        values=elite.values,
        is_chosen=is_chosen,
    )
