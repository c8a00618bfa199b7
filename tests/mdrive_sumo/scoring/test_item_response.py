"""The ranking by item response: abilities are found again, ties are ties, and the fit is the maximum that it says."""

import math

import numpy as np
import pytest
from scipy.optimize import minimize

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.statistics import Label
from mdrive_sumo.scoring import item_response
from mdrive_sumo.scoring.item_response import rank_agents

SEEDS = 2


def draw_scores(
    logits: dict[str, float], scenarios: int, rng: np.random.Generator, places: int = 20
) -> dict[str, dict[Label, float]]:
    """Scores of agents of known ability in scenarios of drawn difficulty."""
    difficulty = rng.normal(0.0, 1.5, scenarios)
    return {
        agent: {
            (f"p{j % places}", f"s{j}", seed): 100.0 / (1.0 + math.exp(-(logit - difficulty[j] + rng.normal(0.0, 0.5))))
            for j in range(scenarios)
            for seed in range(SEEDS)
        }
        for agent, logit in logits.items()
    }


def rank(scores: dict[str, dict[Label, float]]) -> item_response.ItemResponseRanking:
    return rank_agents(scores, dict.fromkeys(scores, ""))


def test_abilities_and_ties_are_found_again() -> None:
    scores = draw_scores({"best": 2.0, "one": 0.5, "other": 0.5, "worst": -1.5}, 60, np.random.default_rng(1))
    found = {one.agent: one for one in rank(scores).agents}
    assert next(iter(found)) == "best" and [*found][-1] == "worst"
    assert [found[name].rank for name in ("best", "one", "other", "worst")] == [1, 2, 2, 4]
    for agent in found.values():
        assert agent.low is not None and agent.high is not None and agent.low < agent.ability < agent.high
        assert agent.rank_low is not None and agent.rank_high is not None
        assert agent.rank_low <= (agent.rank or 0) <= agent.rank_high
    assert found["one"].rank_high == 3


def test_the_fit_is_the_maximum_of_its_objective() -> None:
    """A second method: SciPy's BFGS on quasi-likelihood and priors, written down once more."""
    rng = np.random.default_rng(3)
    scores = draw_scores({"a": 1.0, "b": 0.0, "c": -1.0}, 8, rng)
    table = np.array([[[of_agent[f"p{j}", f"s{j}", seed] / 100 for seed in range(SEEDS)] for j in range(8)]
                      for of_agent in scores.values()]).mean(axis=2)  # fmt: skip

    def lose(x: np.ndarray) -> float:
        ability, difficulty, log_a = x[:3], x[3:11], x[11:]
        logit = np.exp(log_a) * (ability[:, None] - difficulty)
        likelihood = (table * logit - np.logaddexp(0.0, logit)).sum()
        priors = (ability**2).sum() / 12.5 + (difficulty**2).sum() / 12.5 + (log_a**2).sum() / 0.5
        return float(priors - likelihood)

    best = minimize(lose, np.zeros(19), tol=1e-10).x
    ranking = rank(scores)
    ability = {one.agent: one.ability for one in ranking.agents}
    expected = 100.0 / (1.0 + np.exp(-best))
    assert [ability[name] for name in "abc"] == pytest.approx(expected[:3], abs=0.01)
    assert [ranking.difficulty[f"s{j}"] for j in range(8)] == pytest.approx(expected[3:11], abs=0.01)
    assert [ranking.discrimination[f"s{j}"] for j in range(8)] == pytest.approx(np.exp(best[11:]), abs=0.001)


def test_scenarios_that_all_solve_change_no_rank_but_the_mean() -> None:
    scores = draw_scores({"a": 1.5, "b": 0.0, "c": -1.0}, 40, np.random.default_rng(5))
    for of_agent in scores.values():
        of_agent |= {(f"p{j % 20}", f"s{j}", seed): 100.0 for j in range(40, 80) for seed in range(SEEDS)}
    ranking = rank(scores)
    assert [one.agent for one in ranking.agents] == ["a", "b", "c"] and [one.rank for one in ranking.agents] == [
        1,
        2,
        3,
    ]
    assert max(ranking.difficulty[f"s{j}"] for j in range(40, 80)) < min(50.0, np.mean([*ranking.difficulty.values()]))


def test_the_order_of_agents_and_episodes_changes_nothing() -> None:
    scores = draw_scores({"a": 0.4, "b": 0.1, "c": 0.0}, 30, np.random.default_rng(7))
    turned = {name: dict(reversed(of_agent.items())) for name, of_agent in reversed(scores.items())}
    for one, other in zip(rank(scores).agents, rank(turned).agents, strict=True):
        assert (one.agent, one.rank) == (other.agent, other.rank) and one.ability == pytest.approx(other.ability)
        assert (one.low, one.high) == pytest.approx((other.low, other.high))


def test_few_places_give_no_interval_and_agents_of_no_group_no_rank() -> None:
    scores = draw_scores({"a": 1.0, "b": 0.0, "bound": 3.0}, 30, np.random.default_rng(9), places=9)
    few = rank(scores).agents
    assert {(one.low, one.rank_low) for one in few} == {(None, None)} and [one.rank for one in few] == [1, 2, 3]
    apart = rank_agents(scores, {"a": "", "b": "", "bound": None}).agents
    assert [(one.agent, one.rank) for one in apart] == [("bound", None), ("a", 1), ("b", 2)]


@pytest.mark.parametrize(
    ("scores", "problem"),
    [
        ({"a": {("p", "s", 0): 1.0}, "b": {("p", "s", 0): 1.0}}, "expected at least 3 agents, found 2"),
        ({name: {("p", "s", seed): 1.0} for seed, name in enumerate("abc")}, "expected scenarios with seeds that all"),
    ],
)
def test_what_cannot_be_ranked(scores: dict[str, dict[Label, float]], problem: str) -> None:
    with pytest.raises(InputError, match=problem):
        rank_agents(scores, dict.fromkeys(scores, ""))
