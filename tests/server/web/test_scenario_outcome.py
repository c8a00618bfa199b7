"""Outcome and infractions of a scenario in a few words, and which scenarios are failures."""

from typing import Any

import pytest

from server.api.schemas.scenarios import ScenarioOut
from server.web.scenario_outcome import (
    FAILURES,
    describe_infractions,
    describe_outcomes,
    grade_outcome,
    has_failure,
    match_filter,
)


def row(*egos: tuple[str, tuple[str, ...]], verdict: str | None = "ok", sr: float = 0.0, left_out: int = 0) -> Any:
    cars = [
        {"id": str(i), "outcome": outcome, "ds": 1.0, "rc": 1.0, "ip": 1.0, "infractions_left_out": left_out}
        | {"infractions": [{"kind": kind} for kind in kinds]}
        for i, (outcome, kinds) in enumerate(egos)
    ]
    return ScenarioOut.model_validate(
        {"scenario": "a", "seed": 0, "state": "done", "verdict": verdict, "reason": None, "sr": sr, "egos": cars}
        | {"recording": False, "logs": []}
    )


@pytest.mark.parametrize(
    ("found", "outcomes", "infractions", "grade", "failure"),
    [
        (row(("arrived", ()), sr=100.0), "arrived", "none", "good", False),
        (row(("arrived", ("stop-sign",))), "arrived", "stop-sign", "warn", True),
        (
            row(("blocked", ("blocked",)), ("arrived", ("collision-vehicle",) * 2)),
            "1 arrived, 1 blocked",
            "2 x collision-vehicle",
            "warn",
            True,
        ),
        (row(("agent-failed", ()), verdict="agent-failed"), "agent-failed", "none", "bad", True),
        (row(("arrived", ("stop-sign",)), left_out=3), "arrived", "stop-sign, 3 more", "warn", True),
        (row(verdict="failed-ours"), "", "", "warn", True),
    ],
)
def test_a_row_says_how_its_cars_ended(found: Any, outcomes: str, infractions: str, grade: str, failure: bool) -> None:
    assert describe_outcomes(found) == outcomes
    assert describe_infractions(found.egos) == infractions
    assert grade_outcome(found) == grade
    assert has_failure(found) is failure
    assert match_filter(found, FAILURES) is failure
    assert match_filter(found, "") and match_filter(found, found.verdict) and not match_filter(found, "x")


def test_what_waits_is_no_failure() -> None:
    assert not has_failure(row(verdict=None))
