"""Scores by agent in runs of two agents: means over scenarios of means over the CAVs of each."""

import pytest
from testing.score_golden import scenario

from mdrive_sumo.core.state import End
from mdrive_sumo.scoring import ScenarioResult, make_void_result
from mdrive_sumo.scoring.results import EgoResult
from mdrive_sumo.scoring.roles import compute_roles, mark_tested

VOID = make_void_result(scenario(), 1, "world failed")


def drove(*cavs: tuple[str, float], tested: tuple[str, ...] = (), ratio: float | None = None) -> ScenarioResult:
    """A scenario with these CAVs and DS; those that are not `tested` drove with the second agent."""
    egos = tuple(
        EgoResult(id=id_, outcome=End.ARRIVED, reason="", ds=ds, rc=ds, ip=1.0, infractions=(), time_ratio=ratio)
        for id_, ds in cavs
    )
    return mark_tested(VOID.model_copy(update={"status": "scored", "egos": egos}), tested)


def test_a_run_of_one_agent_has_no_roles() -> None:
    assert compute_roles([drove(("0", 100.0), ("1", 50.0), tested=("0", "1")), VOID]) is None
    assert compute_roles([VOID]) is None


def test_every_scenario_has_the_same_weight_however_many_cavs_it_has() -> None:
    many = drove(("0", 40.0), ("1", 100.0), ("2", 60.0), ("3", 20.0), tested=("0", "1"), ratio=1.5)
    few = drove(("0", 100.0), ("1", 30.0), tested=("0",), ratio=0.5)
    roles = compute_roles([many, few])
    assert roles is not None
    assert roles.others is not None
    assert (roles.tested.cavs, roles.others.cavs) == (3, 3)
    assert roles.tested.ds == roles.tested.rc == (70.0 + 100.0) / 2
    assert roles.others.ds == (40.0 + 30.0) / 2
    assert roles.tested.sr == (50.0 + 100.0) / 2
    assert roles.tested.time_ratio == pytest.approx((1.5 + 1.5 + 0.5) / 3)


def test_a_scenario_without_cavs_of_an_agent_says_nothing_of_it_and_a_void_one_counts_as_0() -> None:
    both = drove(("0", 80.0), ("1", 60.0), tested=("0",))
    alone = drove(("0", 100.0), ("1", 100.0), tested=("0", "1"))
    roles = compute_roles([both, alone])
    assert roles is not None
    assert roles.others is not None
    assert (roles.tested.ds, roles.others.ds, roles.others.cavs) == (90.0, 60.0, 1)
    with_void = compute_roles([both, VOID])
    assert with_void is not None
    assert with_void.others is not None
    assert (with_void.tested.ds, with_void.others.ds, with_void.others.ip) == (40.0, 30.0, 0.5)


def test_no_number_of_a_result_is_minus_zero() -> None:
    """Files of equal results are equal bytes."""
    ego = EgoResult(id="0", outcome=End.ARRIVED, reason="", ds=-1e-9, rc=-0.0, ip=0.1234567, infractions=())
    assert '"ds":0.0,"rc":0.0,"ip":0.123457' in ego.model_dump_json()
