"""What the rules must not reach in a candidate of the hard tier, with three seeds."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
from testing.toy_family import TOY_FAMILY

from mdrive_sumo.generate.hard import candidate_evaluation, candidate_probes
from mdrive_sumo.generate.hard.candidate_evaluation import CandidateTask, evaluate_candidate
from mdrive_sumo.generate.hard.candidate_probes import (
    BLIND,
    BOTH,
    PROBES,
    SHARING,
    SINGLE,
    SINGLE_PERFECT,
    WAITING,
    CandidateProbe,
    CandidateScores,
    describe_probes,
)
from mdrive_sumo.generate.hard.candidate_rejection import CandidateRejected, RejectionStage
from mdrive_sumo.generate.hard.family import FamilyCandidate

TASK = CandidateTask(TOY_FAMILY, FamilyCandidate("toy_0", (0.0, 1.0), "s"), ())
LOW = (10.0, 10.0, 10.0)


def find_probe(name: str) -> CandidateProbe:
    return next(probe for probe in PROBES if probe.name == name)


@pytest.fixture
def driven(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, int]]:
    """Drives, instead of episodes: agents with their seeds."""
    drives: list[tuple[str, int]] = []

    def drive(agent: str, scenario: object, roads: object, seed: int, options: object) -> tuple[str, str, int]:
        drives.append((agent, seed))
        return agent, str(options), seed

    monkeypatch.setattr(candidate_probes, "drive_with", drive)
    monkeypatch.setattr(candidate_probes, "vary_scenario", lambda scenario, roads, seed: scenario)
    return drives


def use_scores(monkeypatch: pytest.MonkeyPatch, scores: Mapping[str, Sequence[float]]) -> CandidateScores:
    """Make the drives of `driven` score this, by name of the probe and seed."""

    def score(episode: tuple[str, str, int], *_: object) -> SimpleNamespace:
        agent, options, seed = episode
        name = next(p.name for p in PROBES if (p.agent, str(p.options)) == (agent, options))
        return SimpleNamespace(ds=scores.get(name, LOW)[seed])

    monkeypatch.setattr(candidate_probes, "score_episode", score)
    unused: Any = None  # scenario and roads: only the replaced drives get them
    return CandidateScores(unused, unused, {})


def test_means_over_three_seeds_are_kept(monkeypatch: pytest.MonkeyPatch, driven: list[tuple[str, int]]) -> None:
    found = use_scores(monkeypatch, {BOTH: (90.0, 60.0, 30.0), SINGLE_PERFECT: (12.0, 30.0, 48.0)})
    found.drive((0,))
    assert driven == [(probe.agent, 0) for probe in PROBES]
    found.drive((1, 2))
    others = {BLIND: 10.0, WAITING: 10.0, SINGLE: 10.0, SHARING: 10.0}
    assert found.means == {**others, BOTH: pytest.approx(60.0), SINGLE_PERFECT: pytest.approx(30.0)}
    assert sorted(driven) == sorted((probe.agent, seed) for probe in PROBES for seed in (0, 1, 2))


REJECTED: list[tuple[str, tuple[float, ...], RejectionStage, int]] = [
    (SINGLE, (63.0, 0.0, 0.0), RejectionStage.UNAIDED, 1),
    (SINGLE, (61.0, 60.0, 45.0), RejectionStage.UNAIDED, 3),
    (SINGLE, (61.0, 90.0, 15.0), RejectionStage.UNAIDED, 3),
    (SINGLE_PERFECT, (60.0, 106.0, 0.0), RejectionStage.UNAIDED, 2),
    (BLIND, (55.0, 55.0, 56.0), RejectionStage.UNAIDED, 3),
    (WAITING, (90.0, 91.0, 0.0), RejectionStage.UNAIDED, 2),
    (SHARING, (97.5, 0.0, 0.0), RejectionStage.GAP, 1),
    (BOTH, (97.0, 97.0, 97.0), RejectionStage.GAP, 3),
]


@pytest.mark.parametrize(("name", "scores", "stage", "seeds"), REJECTED)
def test_one_agent_that_does_well_is_enough_to_reject(
    name: str,
    scores: tuple[float, ...],
    stage: RejectionStage,
    seeds: int,
    monkeypatch: pytest.MonkeyPatch,
    driven: list[tuple[str, int]],
) -> None:
    found = use_scores(monkeypatch, {name: scores})
    with pytest.raises(CandidateRejected) as rejected:
        found.drive((0,))
        found.drive((1, 2))
    assert rejected.value.stage is stage and f"found {scores[0]:.2f}" in rejected.value.reason
    agent = find_probe(name).agent
    assert driven[-1] == (agent, seeds - 1)  # nothing is driven after the seed that decides


@pytest.mark.parametrize("name", [BLIND, SINGLE, SINGLE_PERFECT, SHARING, BOTH, WAITING])
def test_scores_at_the_bounds_pass(name: str) -> None:
    probe = find_probe(name)
    first = min(probe.most, 100.0)
    rest = (3 * probe.most_mean - first) / 2
    probe.check((first,))
    probe.check((first, rest, rest))
    with pytest.raises(CandidateRejected):
        probe.check((first, rest, rest + 0.01))


def test_the_fingerprint_tells_bounds_and_seeds(monkeypatch: pytest.MonkeyPatch) -> None:
    before = describe_probes()
    assert "single/perfect<62<" in before and before.endswith("hard seeds 0,1,2")
    monkeypatch.setattr(candidate_probes, "PROBES", (replace(PROBES[0], most_mean=1.0), *PROBES[1:]))
    assert describe_probes() != before


@pytest.mark.slow
class TestDriven:
    @pytest.fixture(autouse=True)
    def _cheap(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """Nothing happens to blind driving in the toy: a car that stands stands in for it and for all probes."""
        monkeypatch.setattr(candidate_evaluation, "BLIND_AGENT", "stationary")
        cheap = tuple(replace(probe, agent="stationary") for probe in PROBES)
        monkeypatch.setattr(candidate_probes, "PROBES", cheap)

    def test_figures_are_means_of_drives(self, monkeypatch: pytest.MonkeyPatch) -> None:
        passing = replace(find_probe(BOTH), agent="constant-speed", most=100.0, most_mean=100.0)
        monkeypatch.setattr(candidate_probes, "PROBES", (*candidate_probes.PROBES[:-1], passing))
        found = evaluate_candidate(TASK)
        assert found.stage is None and set(found.measured.scores) == {probe.name for probe in PROBES} | {"omniscient"}
        assert found.measured.unaided_score < 5.0 < 90.0 < found.measured.score == found.measured.scores[BOTH]
        assert found.measured.scores["omniscient"] > 97.0

    def test_one_seed_that_is_not_solved_rejects(self, monkeypatch: pytest.MonkeyPatch) -> None:
        drive, seeds = candidate_evaluation.drive_with, list[int]()

        def drive_badly(agent: str, scenario: Any, roads: Any, seed: int = 0, **options: Any) -> object:
            seeds.append(seed)
            return drive("stationary" if seed == 3 else agent, scenario, roads, seed, **options)

        monkeypatch.setattr(candidate_evaluation, "drive_with", drive_badly)
        found = evaluate_candidate(TASK)
        assert found.stage is RejectionStage.FEASIBILITY and found.figures is None
        assert found.reason.startswith("expected omniscient to reach 100 with seed 3, found 0.00")
        assert seeds == [0, 0, 1, 2, 3]

    def test_blind_driving_without_harm_is_rejected_before_anything_else_is_driven(
        self, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(candidate_evaluation, "BLIND_AGENT", "constant-speed")
        monkeypatch.setattr(candidate_evaluation, "REFERENCE_AGENT", "no such agent")
        found = evaluate_candidate(TASK)
        assert found.stage is RejectionStage.DANGER
        assert found.reason == "expected constant-speed at 75 at most, found 100.00"
