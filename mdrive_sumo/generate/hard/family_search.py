"""The search in one family: points of its parameters on the places of a season's pool, later ones bred from the best.

The first candidates are a Latin hypercube, spread round robin over the places. Later ones are children of candidates
that passed, or came far, on the same place: a point moved by the iso+line operator (Vassiliades and Mouret 2018). The
next child stands where a great share passes and few have passed, because a suite takes few scenarios of one place, and
some places never give one. Candidates are recorded in the order in which they were
proposed, and each of them is bred from those that are at least `AHEAD` before it. So neither the order in which they
are evaluated nor the number of workers changes anything.
"""

import math
import random
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from mdrive_sumo.generate.hard.candidate_evaluation import CandidateEvaluation
from mdrive_sumo.generate.hard.candidate_rejection import RejectionStage
from mdrive_sumo.generate.hard.family import FamilyCandidate, ScenarioFamily
from mdrive_sumo.generate.hard.hard_places import HardPlace
from mdrive_sumo.generate.hard.hard_recipe import HARD_GENERATOR
from mdrive_sumo.generate.seasons.season_seed import SeasonSeed

AHEAD = 32
"""Candidates that are proposed and not yet recorded: fewer learn earlier, more keep workers busy while one that passes,
ten times as dear as one that is rejected, holds up its family. With 12 families 64 workers are busy for 79 to 96 % of
the time, with batches of eight that wait for each other for 35 to 48 % (simulated with measured times)."""
FIRST_CANDIDATES = 24
"""Of the Latin hypercube."""
FRESH_SHARE = 0.25
"""Of later candidates that are drawn and not bred, so that a place without parents is tried again."""
PARENTS = 4
"""Best candidates of a place that have children."""
ISO_SIGMA, LINE_SIGMA = 0.05, 0.2
"""Standard deviations of the iso+line operator in units of a parameter's range: 0.01 and 0.2 in the source, for
millions of evaluations; a hundred need longer steps."""
GIVE_UP, GIVE_UP_WITHOUT_PASS = 48, 96
"""Candidates after which a family ends of which none was dangerous and solved, and none passed: it costs drives and
gives nothing."""
ENOUGH = 45
"""Candidates that passed with which a family ends: a suite takes 30 of one."""
SIGNIFICANT_DIGITS = 4
"""Of values: recipes are read by people, and the last bits of a computation do not reach them."""
PARENT_STAGES = (RejectionStage.UNAIDED, RejectionStage.GAP)
"""Rejections after which a candidate may have children: it holds a danger that `omniscient` solves."""

Point = tuple[float, ...]
"""One share of its range, in [0, 1], for each parameter."""


@dataclass(frozen=True, slots=True)
class _Parent:
    point: Point
    merit: float


class FamilySearch:
    """Candidates of one family and what came of them."""

    def __init__(self, family: ScenarioFamily, places: Sequence[HardPlace], seed: SeasonSeed) -> None:
        self.family = family
        self.places = {place.name: place for place in places}
        self._seed = seed
        self._names = tuple(self.places)
        self.evaluations: list[CandidateEvaluation] = []
        """All recorded candidates, in the order in which they were proposed."""
        self._parents: dict[str, list[_Parent]] = {}
        self._proposed = 0
        self._passed, self._tried, self._waiting = Counter[str](), Counter[str](), Counter[str]()
        """Candidates by place: those that passed, those that are recorded, and those that are not."""
        rng = random.Random(self._derive("first"))
        self._first = _draw_latin_hypercube(len(family.parameters), FIRST_CANDIDATES, rng)

    @property
    def is_over(self) -> bool:
        """Whether nothing can be expected of more candidates, or there are enough."""
        tried = len(self.evaluations)
        is_hopeless = (tried >= GIVE_UP and not self._parents) or (tried >= GIVE_UP_WITHOUT_PASS and not self.passed)
        return not self._names or is_hopeless or self.passed >= ENOUGH

    @property
    def passed(self) -> int:
        """Number of candidates that passed."""
        return self._passed.total()

    @property
    def proven(self) -> int:
        """Number of those that passed with a certificate of level `all`."""
        return sum(one.figures is not None and one.figures.is_proven for one in self.evaluations)

    def propose(self) -> FamilyCandidate:
        """Return the next candidate. Candidates are the same again if the same number is recorded at each call."""
        number = self._proposed
        self._proposed += 1
        candidate = self._propose(number)
        self._waiting[candidate.place] += 1
        return candidate

    def _propose(self, number: int) -> FamilyCandidate:
        place = self._names[number % len(self._names)]
        rng = random.Random(self._derive("point", number))
        if number < len(self._first):
            return self._make_candidate(number, place, self._first[number])
        if not self._parents or rng.random() < FRESH_SHARE:
            return self._make_candidate(number, place, tuple(rng.random() for _ in self.family.parameters))
        place = max(self._parents, key=lambda name: (self._rate_place(name), -self._names.index(name)))
        return self._make_candidate(number, place, self._breed(place, rng))

    def _rate_place(self, place: str) -> float:
        """Return the share of its candidates that pass, divided by the root of those that have or are expected to."""
        share = (self._passed[place] + 1) / (self._tried[place] + 2)
        return share / math.sqrt(1 + self._passed[place] + share * self._waiting[place])

    def record(self, one: CandidateEvaluation) -> None:
        """Record the evaluation of the first candidate that was proposed and is not recorded."""
        self.evaluations.append(one)
        self._waiting[one.place] -= 1
        self._tried[one.place] += 1
        self._passed[one.place] += one.figures is not None
        if one.figures is not None or one.stage in PARENT_STAGES:
            parents = self._parents.setdefault(one.place, [])
            parents.append(_Parent(self._to_point(one.values), one.merit))
            parents.sort(key=lambda parent: -parent.merit)  # stable: the older one of equals comes first
            del parents[PARENTS:]

    def _breed(self, place: str, rng: random.Random) -> Point:
        """Return a point near a parent on the place, moved along the line to another parent of the family."""
        parent = rng.choice(self._parents[place]).point
        other = rng.choice([one for parents in self._parents.values() for one in parents]).point
        along = rng.gauss(0.0, LINE_SIGMA)
        moved = (a + rng.gauss(0.0, ISO_SIGMA) + along * (b - a) for a, b in zip(parent, other, strict=True))
        return tuple(min(max(share, 0.0), 1.0) for share in moved)

    def _make_candidate(self, number: int, place: str, point: Point) -> FamilyCandidate:
        seed = self._derive("candidate", number)
        values = tuple(
            min(max(float(f"{p.low + share * (p.high - p.low):.{SIGNIFICANT_DIGITS}g}"), p.low), p.high)
            for p, share in zip(self.family.parameters, point, strict=True)
        )
        return FamilyCandidate(f"{self.family.category}_{seed[:8]}", place, values, seed)

    def _derive(self, *purpose: object) -> str:
        return self._seed.derive("hard", HARD_GENERATOR, self.family.category, *purpose)

    def _to_point(self, values: Sequence[float]) -> Point:
        return tuple(
            (value - p.low) / (p.high - p.low) if p.high > p.low else 0.0
            for p, value in zip(self.family.parameters, values, strict=True)
        )


def _draw_latin_hypercube(dimensions: int, count: int, rng: random.Random) -> list[Point]:
    """Return points in the unit cube: along each dimension one in each of `count` equal intervals."""
    columns = [rng.sample(range(count), count) for _ in range(dimensions)]
    return [tuple((column[i] + rng.random()) / count for column in columns) for i in range(count)]
