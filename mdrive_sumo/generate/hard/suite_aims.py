"""Aims of the hard tier as a whole (docs/hard.md): bounds on means over its scenarios, and how far agents are apart.

A choice is made with a margin to each bound (`SuiteAim.margin`); what is said to be missed is measured without it.
"""

import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

from mdrive_sumo.generate.hard.candidate_evaluation import CandidateEvaluation
from mdrive_sumo.generate.hard.candidate_probes import BLIND, BOTH, SHARING, SINGLE, SINGLE_PERFECT, WAITING
from mdrive_sumo.generate.hard.family_streets import is_corridor_network
from mdrive_sumo.scenario.reference_times import REFERENCE_AGENT

MOST_WAITING = 20.0
"""Mean driving score of an agent that waits by its number: a schedule without sight must not solve the tier."""
LEAST_CATEGORIES = 10
"""The packaged suite is about as many kinds of situations at least."""
OF_EACH_CATEGORY = 2
"""Scenarios with which a category counts."""
MOST_OF_CATEGORY = 0.3
"""Largest share of one category: the suite is about more than one situation."""
CORRIDOR_SHARE = 1 / 3
"""Least share of scenarios on dense corridors, where many road users act at once."""
FULL_COUNT, CERTIFICATES = 120, 80
"""Of so many scenarios or more, so many carry a certificate of need; of fewer, the same share."""
LADDER = (BLIND, SINGLE, SHARING, BOTH, REFERENCE_AGENT)
"""Each of these is better than the one before by more than the interval of 95 % of the paired difference."""
STEP = 4.0
"""Points between two of them at which a choice aims: the interval reached 2.1 points to either side with 132
scenarios."""
NORMAL_95 = 1.96
"""Quantile of the normal distribution for an interval at 95 %."""
MOST_MEAN_DRIVING_S = 130.0
"""[s] Mean over the suite of the times of all its CAVs: a suite of 77 s on average took 264 s of the eight minutes that
two cores may take, so that anybody can drive the tier."""


def is_on_corridor(candidate: CandidateEvaluation) -> bool:
    """Return whether a candidate drives on a dense corridor."""
    return is_corridor_network(candidate.measured.network)


def is_certified(candidate: CandidateEvaluation) -> bool:
    """Return whether the certificate of need of a candidate holds."""
    return candidate.measured.is_certified


@dataclass(frozen=True, slots=True)
class SuiteAim:
    """A bound on the mean of a figure over the chosen scenarios."""

    name: str
    measure: Callable[[CandidateEvaluation], float]
    bound: float
    is_least: bool = False
    """Whether the mean must be the bound or more, not the bound or less."""
    margin: float = 0.0
    """A choice aims at a bound that is so much stricter."""
    price: float = 100.0
    """Of a choice that misses it by 1."""

    def compute_excess(self, candidate: CandidateEvaluation) -> float:
        """Return how much a scenario contributes to missing the aim, with margin; negative if it helps."""
        sign = -1.0 if self.is_least else 1.0
        return sign * (self.measure(candidate) - self.bound) + self.margin

    def find_problem(self, chosen: Sequence[CandidateEvaluation]) -> str | None:
        """Return what is missed, in one phrase, or None."""
        mean = math.fsum(map(self.measure, chosen)) / len(chosen)
        if (self.bound - mean if self.is_least else mean - self.bound) <= 1e-9:
            return None
        return f"{self.name}: expected {self.bound:.4g} at {'least' if self.is_least else 'most'}, found {mean:.4g}"


def _score_of(name: str) -> Callable[[CandidateEvaluation], float]:
    return lambda candidate: candidate.measured.scores[name]


def build_aims(count: int) -> tuple[SuiteAim, ...]:
    """Return the aims of a suite of so many scenarios whose means a choice can be held to."""
    certificates = min(CERTIFICATES / count, CERTIFICATES / FULL_COUNT)
    share_price = 100.0 * count  # of a scenario as of a point
    return (
        SuiteAim(f"mean of {SINGLE}", _score_of(SINGLE), 40.0, margin=1.0),
        SuiteAim(f"mean of {SINGLE_PERFECT}", _score_of(SINGLE_PERFECT), 40.0, margin=1.0),
        SuiteAim(f"mean of {SHARING}", _score_of(SHARING), 75.0, margin=1.0),
        SuiteAim(f"mean of {BOTH}", _score_of(BOTH), 75.0, margin=1.0),
        SuiteAim(f"mean of {BOTH}", _score_of(BOTH), 40.0, is_least=True, margin=1.0),
        SuiteAim(f"mean of {REFERENCE_AGENT}", _score_of(REFERENCE_AGENT), 97.0, is_least=True, margin=0.2),
        SuiteAim("share of dense corridors", is_on_corridor, CORRIDOR_SHARE, is_least=True, price=share_price),
        SuiteAim("share of certificates", is_certified, certificates, is_least=True, price=share_price),
        SuiteAim(
            "time of all CAVs [s]", lambda candidate: candidate.measured.driving_s, MOST_MEAN_DRIVING_S, price=1.0
        ),
        *(SuiteAim(f"step to {b}", _step_of(a, b), STEP, is_least=True) for a, b in pairwise(LADDER)),
    )


def _step_of(worse: str, better: str) -> Callable[[CandidateEvaluation], float]:
    return lambda candidate: candidate.measured.scores[better] - candidate.measured.scores[worse]


def find_missed_aims(chosen: Sequence[CandidateEvaluation], count: int) -> Iterator[str]:
    """Yield a phrase for each aim that a choice of scenarios misses; `count` were asked for."""
    if len(chosen) < count:
        yield f"scenarios: expected {count}, found {len(chosen)}"
    if not chosen:
        return
    waiting = SuiteAim(f"mean of {WAITING}", _score_of(WAITING), MOST_WAITING)
    steps = [f"step to {name}" for name in LADDER[1:]]
    for aim in (*build_aims(count), waiting):
        if aim.name not in steps and (problem := aim.find_problem(chosen)) is not None:
            yield problem
    for worse, better in pairwise(LADDER):
        mean, half = compute_interval([_step_of(worse, better)(one) for one in chosen])
        if mean <= half:
            yield f"{better} above {worse}: expected more than the interval of 95 %, found {mean:.2f} +- {half:.2f}"
    categories = Counter(one.family for one in chosen)
    if (enough := sum(n >= OF_EACH_CATEGORY for n in categories.values())) < LEAST_CATEGORIES:
        yield f"categories: expected {LEAST_CATEGORIES} with {OF_EACH_CATEGORY} scenarios or more, found {enough}"
    name, most = categories.most_common(1)[0]
    if most > find_most_of_category(count):
        yield f"category {name}: expected {find_most_of_category(count)} scenarios at most, found {most}"


def find_most_of_category(count: int) -> int:
    """Return how many scenarios of one category a suite of so many may have."""
    return max(int(MOST_OF_CATEGORY * count), 1)


def compute_interval(differences: Sequence[float]) -> tuple[float, float]:
    """Return the mean of paired differences and half of its interval of 95 % (normal approximation)."""
    n = len(differences)
    mean = math.fsum(differences) / n
    if n < 2:
        return mean, math.inf
    variance = math.fsum((one - mean) * (one - mean) for one in differences) / (n - 1)
    return mean, NORMAL_95 * math.sqrt(variance / n)
