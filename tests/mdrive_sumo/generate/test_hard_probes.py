"""What agents without messages, and the best rules that talk, must not reach in a candidate of the hard tier."""

import pytest
from testing.toy_family import TOY_FAMILY

from mdrive_sumo.generate.hard import candidate_evaluation
from mdrive_sumo.generate.hard.candidate_evaluation import CandidateTask, RejectionStage, evaluate_candidate
from mdrive_sumo.generate.hard.family import FamilyCandidate
from mdrive_sumo.loop import EpisodeOptions

Drives = tuple[tuple[str, EpisodeOptions], ...]
pytestmark = pytest.mark.slow
TASK = CandidateTask(TOY_FAMILY, FamilyCandidate("toy_0", (0.0, 1.0), "s"), ())
STATIONARY, CONSTANT = ((agent, candidate_evaluation.PROBE_OPTIONS) for agent in ("stationary", "constant-speed"))


@pytest.fixture(autouse=True)
def _in_danger(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing happens to blind driving in the toy: a car that stands stands in for it."""
    monkeypatch.setattr(candidate_evaluation, "BLIND_AGENT", "stationary")


@pytest.mark.parametrize(
    ("unaided", "probed", "stage", "reason"),
    [
        (
            (STATIONARY, CONSTANT),
            (STATIONARY,),
            RejectionStage.UNAIDED,
            "expected constant-speed (sensing realistic) at 62",
        ),
        (
            (STATIONARY,),
            (STATIONARY, CONSTANT),
            RejectionStage.GAP,
            "expected constant-speed (sensing realistic) at 97",
        ),
    ],
)
def test_one_agent_that_does_well_is_enough_to_reject(
    monkeypatch: pytest.MonkeyPatch,
    unaided: Drives,
    probed: Drives,
    stage: RejectionStage,
    reason: str,
) -> None:
    monkeypatch.setattr(candidate_evaluation, "UNAIDED_DRIVES", unaided)
    monkeypatch.setattr(candidate_evaluation, "PROBED_DRIVES", probed)
    found = evaluate_candidate(TASK)
    assert found.stage is stage and found.reason.startswith(reason) and found.figures is None


def test_the_better_agents_are_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(candidate_evaluation, "UNAIDED_DRIVES", (STATIONARY,))
    monkeypatch.setattr(candidate_evaluation, "PROBED_DRIVES", (STATIONARY, CONSTANT))
    monkeypatch.setattr(candidate_evaluation, "LEAST_GAP", -1.0)
    found = evaluate_candidate(TASK)
    assert found.stage is None
    assert found.measured.unaided_score < 5.0 < 90.0 < found.measured.score


def test_blind_driving_without_harm_is_rejected_before_anything_else_is_driven(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(candidate_evaluation, "BLIND_AGENT", "constant-speed")
    monkeypatch.setattr(candidate_evaluation, "REFERENCE_AGENT", "no such agent")
    found = evaluate_candidate(TASK)
    assert found.stage is RejectionStage.DANGER
    assert found.reason == "expected constant-speed at 75 at most, found 100.00"
