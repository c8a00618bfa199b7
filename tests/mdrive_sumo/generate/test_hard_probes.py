"""What agents without messages, and the best rules that talk, must not reach in a candidate of the hard tier."""

import pytest
from testing.toy_family import TOY_FAMILY

from mdrive_sumo.generate.hard import candidate_evaluation
from mdrive_sumo.generate.hard.candidate_evaluation import CandidateTask, RejectionStage, evaluate_candidate
from mdrive_sumo.generate.hard.family import FamilyCandidate

pytestmark = pytest.mark.slow
TASK = CandidateTask(TOY_FAMILY, FamilyCandidate("toy_0", (0.0, 1.0), "s"), ())


@pytest.mark.parametrize(
    ("unaided", "probed", "stage", "reason"),
    [
        (("stationary", "constant-speed"), ("stationary",), RejectionStage.UNAIDED, "expected constant-speed at 55"),
        (("stationary",), ("stationary", "constant-speed"), RejectionStage.GAP, "expected constant-speed at 90"),
    ],
)
def test_one_agent_that_does_well_is_enough_to_reject(
    monkeypatch: pytest.MonkeyPatch,
    unaided: tuple[str, ...],
    probed: tuple[str, ...],
    stage: RejectionStage,
    reason: str,
) -> None:
    monkeypatch.setattr(candidate_evaluation, "UNAIDED_AGENTS", unaided)
    monkeypatch.setattr(candidate_evaluation, "PROBED_AGENTS", probed)
    found = evaluate_candidate(TASK)
    assert found.stage is stage and found.reason.startswith(reason) and found.figures is None


def test_the_better_agents_are_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(candidate_evaluation, "UNAIDED_AGENTS", ("stationary",))
    monkeypatch.setattr(candidate_evaluation, "PROBED_AGENTS", ("stationary", "constant-speed"))
    monkeypatch.setattr(candidate_evaluation, "LEAST_GAP", -1.0)
    found = evaluate_candidate(TASK)
    assert found.stage is None
    assert found.measured.unaided_score < 5.0 < 90.0 < found.measured.score
