"""MAP-Elites over the parameters of one family: an archive of the best candidate of every kind of behaviour.

Behaviour is measured by three numbers (`DESCRIPTORS`); the objective is what the rules lose. The first candidates are
those of an earlier suite and a Latin hypercube; later ones vary and cross elites (iso+line operator). Archive and
operator are those of pyribs. Candidates are proposed and recorded in whole batches, so neither the order in which they
are evaluated nor the number of workers changes anything.
"""

import hashlib
import importlib.util
import random
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.installation_command import format_installation
from mdrive_sumo.core.seeding import derive_seed
from mdrive_sumo.generate.hard.candidate_evaluation import CandidateEvaluation, CandidateFigures
from mdrive_sumo.generate.hard.family import FamilyCandidate, ScenarioFamily
from mdrive_sumo.generate.hard.hard_recipe import HARD_GENERATOR
from mdrive_sumo.generate.validation import FULL_SCORE

if TYPE_CHECKING:
    from ribs.archives import GridArchive
    from ribs.emitters import IsoLineEmitter

BATCH = 8
"""Candidates proposed at once: a smaller batch learns earlier, a larger one keeps more workers busy."""
FIRST_CANDIDATES = 16
"""Of the Latin hypercube."""
ISO_SIGMA, LINE_SIGMA = 0.05, 0.2
"""Standard deviations of the iso+line operator in units of a parameter's range: 0.01 and 0.2 in Vassiliades and Mouret
(2018), for millions of evaluations; a hundred need longer steps."""
SIGNIFICANT_DIGITS = 4
"""Of values: recipes are read by people, and the last bits of a computation do not reach them."""


@dataclass(frozen=True, slots=True)
class BehaviourDescriptor:
    """A measure of a scenario's behaviour and the cells of the archive along it; values outside count for the outer
    cells."""

    name: str
    unit: str
    low: float
    high: float
    cells: int
    logarithmic: bool = False

    def to_measure(self, value: float) -> float:
        """Return the coordinate in the archive."""
        return float(portable.log(max(value, self.low)) / portable.log(2.0)) if self.logarithmic else value

    @property
    def measure_range(self) -> tuple[float, float]:
        """Range of the coordinate."""
        return self.to_measure(self.low), self.to_measure(self.high)

    def find_cell(self, value: float) -> int:
        """Return the index of the cell of a value."""
        low, high = self.measure_range
        return min(max(int((self.to_measure(value) - low) / (high - low) * self.cells), 0), self.cells - 1)

    @property
    def edges(self) -> tuple[float, ...]:
        """Bounds of the cells as values."""
        low, high = self.measure_range
        places = [low + (high - low) * i / self.cells for i in range(self.cells + 1)]
        return tuple(float(portable.exp(place * portable.log(2.0))) if self.logarithmic else place for place in places)


DESCRIPTORS = (
    BehaviourDescriptor("road users", "", 2.0, 128.0, 6, logarithmic=True),
    BehaviourDescriptor("mean speed of the CAVs", "m/s", 0.0, 24.0, 8),
    BehaviourDescriptor("time that a message gains", "s", 0.0, 6.0, 6),
)
"""Each doubling of the road users is a cell, up to 150 background vehicles and 12 CAVs; 3 m/s and 1 s are differences
that are seen in a replay. A message from 150 m tells at 25 m/s what is 6 s away."""


def list_behaviour(figures: CandidateFigures) -> tuple[float, float, float]:
    """Return the values of the descriptors."""
    return float(figures.road_users), figures.mean_speed, figures.message_gain_s


def find_cell(figures: CandidateFigures) -> tuple[int, ...]:
    """Return the index of the cell along each descriptor."""
    return tuple(one.find_cell(value) for one, value in zip(DESCRIPTORS, list_behaviour(figures), strict=True))


def compute_objective(figures: CandidateFigures) -> float:
    """Return what a cell maximises: points lost by the best rules that talk, the best agent without messages, and one
    that waits by its number, each a third.

    All three have aims (`suite_aims`), and the gap alone is largest where messages are worth nothing. A candidate whose
    certificate holds is worth more than any other.
    """
    lost = FULL_SCORE - (figures.score + figures.unaided_score + figures.waiting_score) / 3.0
    return lost + FULL_SCORE * figures.is_certified


@dataclass(frozen=True, slots=True)
class SearchSeed:
    """What a search depends on besides its families."""

    seed: int = 0
    split: str = "public"
    secret: str = ""
    """Known to the organiser of a hidden split only; part of every seed."""
    start: str = ""
    """Checksum of the suite that the search starts from: other candidates have other ids."""

    def derive(self, *purpose: str) -> str:
        """Return a seed for a purpose; the secret cannot be derived from it."""
        start = (self.start,) if self.start else ()
        text = "/".join((str(HARD_GENERATOR), self.split, self.secret, str(self.seed), *start, *purpose))
        return hashlib.blake2b(text.encode(), digest_size=12).hexdigest()


class FamilySearch:
    """The search in one family. Needs pyribs."""

    def __init__(self, family: ScenarioFamily, seed: SearchSeed, start: Sequence[FamilyCandidate] = ()) -> None:
        """`start`: the first batch, of any size, before the Latin hypercube."""
        self.family, self._seed, self._start = family, seed, tuple(start)
        self.evaluations: list[CandidateEvaluation] = []
        """All recorded candidates, in the order in which they were proposed."""
        number = derive_seed(0, seed.derive(family.category, "emitter"))
        self._archive = _open_archive(len(family.parameters), number)
        self._parents = _open_archive(len(family.parameters), number)
        """What later candidates are bred from: certified candidates alone as soon as there is one."""
        self._has_certified = False
        self._emitter = _open_emitter(self._parents, len(family.parameters), number)
        self._first = _draw_latin_hypercube(
            len(family.parameters), FIRST_CANDIDATES, random.Random(seed.derive(family.category, "first"))
        )

    @property
    def has_start(self) -> bool:
        """Whether the first batch is that of an earlier suite."""
        return bool(self._start)

    def propose_batch(self) -> tuple[FamilyCandidate, ...]:
        """Return the next candidates; all of them must be recorded before the next batch."""
        begin = len(self.evaluations)
        if self._start and not begin:
            return self._start
        new = begin - len(self._start)
        if new + BATCH <= len(self._first):
            points = self._first[new : new + BATCH]
        elif self._parents.empty:
            draw = random.Random(self._seed.derive(self.family.category, "again", str(begin)))
            points = _draw_latin_hypercube(len(self.family.parameters), BATCH, draw)
        else:
            points = [tuple(row) for row in self._emitter.ask().tolist()]
        return tuple(self._make_candidate(begin + i, point) for i, point in enumerate(points))

    def record_batch(self, evaluations: Sequence[CandidateEvaluation]) -> None:
        """Record the evaluations of the last batch, in its order."""
        for one in evaluations:
            self.evaluations.append(one)
            if one.figures is not None:
                self._add(self._archive, one, one.figures)
                self._add_parent(one, one.figures)

    def _add_parent(self, one: CandidateEvaluation, figures: CandidateFigures) -> None:
        if figures.is_certified and not self._has_certified:
            self._parents.clear()
            self._has_certified = True
        if figures.is_certified == self._has_certified:
            self._add(self._parents, one, figures)

    def _add(self, archive: "GridArchive", one: CandidateEvaluation, figures: CandidateFigures) -> None:
        measures = [d.to_measure(v) for d, v in zip(DESCRIPTORS, list_behaviour(figures), strict=True)]
        archive.add_single(
            self._to_unit(one.values), compute_objective(figures), measures, number=len(self.evaluations) - 1
        )

    @property
    def elites(self) -> tuple[CandidateEvaluation, ...]:
        """The best candidate of every cell, in the order of the cells."""
        found = self._archive.data(["index", "number"])
        order = np.argsort(found["index"], kind="stable")
        return tuple(self.evaluations[int(found["number"][i])] for i in order)

    @property
    def cells(self) -> int:
        """Number of cells of the archive."""
        return int(self._archive.cells)

    def _make_candidate(self, number: int, point: Sequence[float]) -> FamilyCandidate:
        seed = self._seed.derive(self.family.category, str(number))
        mark = "h" if self._seed.split == "hidden" else ""
        values = tuple(
            min(max(float(f"{p.low + share * (p.high - p.low):.{SIGNIFICANT_DIGITS}g}"), p.low), p.high)
            for p, share in zip(self.family.parameters, point, strict=True)
        )
        return FamilyCandidate(f"{self.family.category}_{mark}{seed[:8]}", values, seed)

    def _to_unit(self, values: Sequence[float]) -> list[float]:
        return [
            (value - p.low) / (p.high - p.low) if p.high > p.low else 0.0
            for p, value in zip(self.family.parameters, values, strict=True)
        ]


def check_search_library() -> None:
    """Raise InputError without pyribs, which searches, or SciPy, which chooses."""
    for package in ("ribs", "scipy"):
        if importlib.util.find_spec(package) is None:
            raise InputError(
                f"generate --hard: expected the package {package}, which the search needs, found none;"
                f" {format_installation('search')}"
            )


def _open_archive(dimensions: int, seed: int) -> "GridArchive":
    from ribs.archives import GridArchive  # only here: four seconds of processor time

    return GridArchive(
        solution_dim=dimensions,
        dims=[one.cells for one in DESCRIPTORS],
        ranges=[one.measure_range for one in DESCRIPTORS],
        extra_fields={"number": ((), np.int32)},
        seed=seed,
    )


def _open_emitter(archive: "GridArchive", dimensions: int, seed: int) -> "IsoLineEmitter":
    from ribs.emitters import IsoLineEmitter

    return IsoLineEmitter(
        archive,
        iso_sigma=ISO_SIGMA,
        line_sigma=LINE_SIGMA,
        x0=[0.5] * dimensions,
        bounds=[(0.0, 1.0)] * dimensions,
        batch_size=BATCH,
        seed=seed,
    )


def _draw_latin_hypercube(dimensions: int, count: int, rng: random.Random) -> list[tuple[float, ...]]:
    """Return points in the unit cube: along each dimension one in each of `count` equal intervals."""
    columns = [rng.sample(range(count), count) for _ in range(dimensions)]
    return [tuple((column[i] + rng.random()) / count for column in columns) for i in range(count)]
