"""Ranking by item response: abilities of agents and difficulties of scenarios, fitted jointly.

A mean counts every scenario alike, whether all agents solve it, none does, or it tells them apart. Item response theory
asks how able an agent must be for a scenario. The model is the mean of beta-3 IRT (Chen, Silva Filho, Prudencio, Diethe
and Flach 2019, "beta3-IRT: A New Item Response Model and its Applications", AISTATS), for responses between 0 and 1:

    E[score of agent i in scenario j] = 1 / (1 + (difficulty_j / (1 - difficulty_j)) ** a_j
                                                 * (ability_i / (1 - ability_i)) ** -a_j)

with abilities and difficulties in (0, 1) and discriminations a_j > 0. Driving scores are often 0 or 100, where the
density of a beta distribution is not finite. So the fit maximises the Bernoulli quasi-likelihood of the mean, which is
consistent for any response between 0 and 1 (Papke and Wooldridge 1996), with normal priors on the logits of ability and
difficulty and on the logarithms of the discriminations: without them a scenario that all agents solve has no finite
difficulty.

Intervals come from the same draws as those of means: places are drawn anew, then scenarios, then seeds.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.statistics import (
    CONFIDENCE,
    MIN_EFFECTIVE,
    MIN_UNITS,
    ConfidenceInterval,
    Label,
    count_effective,
    draw_nested_counts,
    make_interval,
)

LEAST_AGENTS: Final = 3
"""With two agents the difficulties follow the mean of both, and the fit says no more than their difference."""
RESAMPLES: Final = 400
"""Fits; the ends of an interval then differ by some hundredths of an ability's spread from those of other draws."""
LOGIT_SPREAD: Final = 2.5
"""Standard deviation of the priors of logits: 95 % of abilities and difficulties lie between 0.7 and 99.3 %."""
DISCRIMINATION_SPREAD: Final = 0.5
"""Standard deviation of the prior of log a: 95 % of the discriminations lie between 0.38 and 2.7."""
ROUNDS: Final = 200
"""Rounds of the fit at most."""
RESAMPLE_ROUNDS: Final = 25
"""Rounds of the fit of a resample, which begins at the estimate: from there changes end below 1e-3."""
TOLERANCE: Final = 1e-7
"""Change of a logit at which a fit ends."""
LONGEST_STEP: Final = 0.7
"""Of a logit in a round: Newton steps from far away overshoot."""


AgentScores = Mapping[Label, float]
"""Driving scores [%] of an agent by place, scenario id and seed, without void episodes."""


@dataclass(frozen=True, slots=True)
class RankedAgent:
    """An agent's place in the ranking."""

    agent: str
    mean: float
    """Mean driving score over scenarios and seeds [%]."""
    ability: float
    """[%] Its expected score in a scenario of mean difficulty and discrimination."""
    low: float | None
    """Ends of the interval of the ability; None for too few places."""
    high: float | None
    rank: int | None
    """1 + number of agents of its group that are clearly abler: the interval of the paired difference excludes 0. So
    agents that are not told apart are tied. Without intervals by the ability alone; None for an agent of no group."""
    rank_low: int | None
    """Ends of the interval of the rank among the resamples."""
    rank_high: int | None


@dataclass(frozen=True, slots=True)
class ItemResponseRanking:
    """Agents, the ablest first, and what was fitted of the scenarios."""

    agents: tuple[RankedAgent, ...]
    difficulty: Mapping[str, float]
    """[%] By scenario id: the ability with which half of the score is expected."""
    discrimination: Mapping[str, float]
    """By scenario id."""
    places: int
    """Number of networks, by which the intervals are drawn."""


@dataclass(frozen=True, slots=True)
class _Fit:
    """Estimates of R fits: abilities (R, agents), difficulties and log discriminations (R, scenarios)."""

    ability: Float
    """Logits, as the difficulties are."""
    difficulty: Float
    log_discrimination: Float


def rank_agents(
    scores_by_agent: Mapping[str, AgentScores], group_by_agent: Mapping[str, str | None]
) -> ItemResponseRanking:
    """Return the ranking of agents over the scenarios and seeds that all of them have.

    group_by_agent: agents are ranked among those of their group, such as a sensing track; None: not ranked, but fitted.

    Raises InputError for fewer than three agents, and if they have no scenario with a common seed.
    """
    if len(scores_by_agent) < LEAST_AGENTS:
        raise InputError(
            f"ranking by item response: expected at least {LEAST_AGENTS} agents, found {len(scores_by_agent)}"
        )
    common = sorted(set.intersection(*(set(scores) for scores in scores_by_agent.values())))
    if not common:
        raise InputError("ranking by item response: expected scenarios with seeds that all agents have, found none")
    names = list(dict.fromkeys(str(label[1]) for label in common))
    row_of = {name: row for row, name in enumerate(names)}
    owner = np.array([row_of[str(label[1])] for label in common])
    scores = np.array([[of_agent[label] / 100.0 for label in common] for of_agent in scores_by_agent.values()])
    scores = scores.clip(0.0, 1.0)
    counts = draw_nested_counts(common)[: 1 + RESAMPLES].astype(np.float64)
    fit = _fit(_Responses.count(scores, owner, counts[:1]), None, ROUNDS)
    places, effective = len({label[0] for label in common}), count_effective(common)
    drawn = None
    if places >= MIN_UNITS and effective >= MIN_EFFECTIVE:
        drawn = _fit(_Responses.count(scores, owner, counts[1:]), fit, RESAMPLE_ROUNDS).ability
    abilities = _Abilities(fit.ability[0], drawn, places, effective)
    groups = [(name, group_by_agent[name]) for name in scores_by_agent]
    return ItemResponseRanking(
        _rank(groups, 100.0 * scores.mean(axis=1), abilities),
        {name: _to_percent(fit.difficulty[0, row]) for name, row in row_of.items()},
        {name: float(portable.exp(fit.log_discrimination[0, row])) for name, row in row_of.items()},
        places,
    )


@dataclass(frozen=True, slots=True)
class _Abilities:
    """Abilities as logits, and those of the resamples (RESAMPLES, agents); None for too few places."""

    estimate: Float
    drawn: Float | None
    places: int
    effective: float

    def find_interval(self, agent: int) -> ConfidenceInterval:
        """Return the interval of an agent's ability."""
        return self._make(float(self.estimate[agent]), None if self.drawn is None else self.drawn[:, agent])

    def is_clearly_abler(self, one: int, other: int) -> bool:
        """Return whether an agent is abler by more than chance; without resamples, at all."""
        gap = float(self.estimate[one] - self.estimate[other])
        if self.drawn is None:
            return gap > 0.0
        return gap > 0.0 and self._make(gap, self.drawn[:, one] - self.drawn[:, other]).is_clear

    def _make(self, mean: float, drawn: Float | None) -> ConfidenceInterval:
        if drawn is None:
            return ConfidenceInterval(mean, None, None, self.places)
        return make_interval(mean, drawn, self.places, self.effective)


@dataclass(frozen=True, slots=True)
class _Responses:
    """Weighted mean scores (R, agents, scenarios) in [0, 1], and the weights (R, 1, scenarios) of the scenarios."""

    score: Float
    weight: Float

    @classmethod
    def count(cls, scores: Float, owner: Float, weights: Float) -> "_Responses":
        """Return what the fit needs of scores (agents, episodes) that count `weights` (R, episodes) times.

        owner: index of each episode's scenario; weights: whole numbers.
        """
        scenarios = int(owner.max()) + 1
        total = np.zeros((len(weights), 1, scenarios))
        summed = np.zeros((len(weights), len(scores), scenarios))
        for episode, scenario in enumerate(owner):
            total[:, 0, scenario] += weights[:, episode]
            summed[:, :, scenario] += np.multiply.outer(weights[:, episode], scores[:, episode])
        seeds = np.bincount(owner, minlength=scenarios)
        return cls(summed / np.maximum(total, 1.0), total / seeds)


def _fit(responses: _Responses, start: _Fit | None, rounds: int) -> _Fit:
    """Return the maximum of quasi-likelihood and priors, by Newton steps of abilities and scenarios in turn."""
    count, agents, scenarios = responses.score.shape
    ability = np.zeros((count, agents)) if start is None else np.repeat(start.ability, count, axis=0)
    difficulty = np.zeros((count, scenarios)) if start is None else np.repeat(start.difficulty, count, axis=0)
    log_a = np.zeros((count, scenarios)) if start is None else np.repeat(start.log_discrimination, count, axis=0)
    for _ in range(rounds):
        a = portable.exp(log_a)[:, None, :]
        gap = ability[:, :, None] - difficulty[:, None, :]
        error, spread = _compare(responses, a * gap)
        step = _make_step((a * error).sum(axis=2), (a * a * spread).sum(axis=2), ability, LOGIT_SPREAD)
        ability = ability + step
        gap = ability[:, :, None] - difficulty[:, None, :]
        error, spread = _compare(responses, a * gap)
        moved = _make_step(-(a * error).sum(axis=1), (a * a * spread).sum(axis=1), difficulty, LOGIT_SPREAD)
        difficulty = difficulty + moved
        gap = a * (ability[:, :, None] - difficulty[:, None, :])
        error, spread = _compare(responses, gap)
        turned = _make_step((gap * error).sum(axis=1), (gap * gap * spread).sum(axis=1), log_a, DISCRIMINATION_SPREAD)
        log_a = log_a + turned
        if max(float(np.abs(one).max()) for one in (step, moved, turned)) < TOLERANCE:
            break
    return _Fit(ability, difficulty, log_a)


def _compare(responses: _Responses, logit: Float) -> tuple[Float, Float]:
    """Return what is left of the scores, and the variance of a Bernoulli variable, both weighted (R, agents, N)."""
    expected = _sigmoid(logit)
    return responses.weight * (responses.score - expected), responses.weight * expected * (1.0 - expected)


def _make_step(slope: Float, curvature: Float, value: Float, spread: float) -> Float:
    """Return a Newton step towards the maximum, with the slope and curvature of the prior, of limited length."""
    step = (slope - value / (spread * spread)) / (curvature + 1.0 / (spread * spread))
    return step.clip(-LONGEST_STEP, LONGEST_STEP)


def _sigmoid(logit: Float) -> Float:
    return 1.0 / (1.0 + portable.exp(-logit))


def _to_percent(logit: float) -> float:
    return 100.0 / (1.0 + portable.exp(-float(logit)))


def _rank(groups: Sequence[tuple[str, str | None]], means: Float, abilities: _Abilities) -> tuple[RankedAgent, ...]:
    """Return the agents, the ablest first. groups: names with their group."""
    tail = (1 - CONFIDENCE) / 2
    ranked: list[RankedAgent] = []
    for i, (name, group) in enumerate(groups):
        rivals = [k for k, (_, other) in enumerate(groups) if other == group and k != i]
        rank = rank_low = rank_high = None
        if group is not None:
            rank = 1 + sum(abilities.is_clearly_abler(rival, i) for rival in rivals)
        if group is not None and abilities.drawn is not None:
            ranks = 1 + (abilities.drawn[:, rivals] > abilities.drawn[:, i : i + 1]).sum(axis=1)
            rank_low, rank_high = (int(end) for end in np.quantile(ranks, (tail, 1 - tail), method="nearest"))
        interval = abilities.find_interval(i)
        low, high = map(_to_percent, interval.ends) if interval.ends else (None, None)
        ability = _to_percent(interval.mean)
        ranked.append(RankedAgent(name, float(means[i]), ability, low, high, rank, rank_low, rank_high))
    return tuple(sorted(ranked, key=lambda one: (-one.ability, one.agent)))
