"""What each CAV lost, in plain English."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from testing.view_runs import HIT, hit, stood

from mdrive_sumo.contract import Cause
from mdrive_sumo.core.state import End
from mdrive_sumo.report.reasons import NotedReason
from mdrive_sumo.report.run_page.losses import explain_losses
from mdrive_sumo.scoring import EgoResult, Infraction, ScenarioResult


def ego(*infractions: Infraction, name: str = "0", rc: float = 40.0, **changed: Any) -> EgoResult:
    values = {"outcome": End.BLOCKED, "reason": "", "ds": 24.0, "ip": 0.6, **changed}
    return EgoResult(id=name, rc=rc, infractions=infractions, **values)


def episode(*egos: EgoResult) -> ScenarioResult:
    return ScenarioResult(
        id="s", bucket="b", category="c", seed=0, status="ok", reason="", min_ttc=None, digest="", ticks=500,
        ds=0.0, sr=0.0, rc=0.0, ip=1.0, egos=egos,
    )  # fmt: skip


def event(kind: str, other: str = "", factor: float = 0.7) -> Infraction:
    return Infraction(kind=kind, tick=30, x=0, y=0, factor=factor, other=other)


@pytest.mark.parametrize(
    ("infraction", "text"),
    [
        (hit("1"), "hit CAV 1 at 2.5 m/s"),
        (hit("npc"), "hit vehicle npc at 2.5 m/s"),
        (hit("npc", None), "hit vehicle npc"),
        (event("collision-pedestrian", "anna"), "hit pedestrian anna"),
        (event("collision-static", "cone"), "hit obstacle cone"),
        (event("collision-static"), "hit a building"),
        (event("red-light", "tls:2"), "crossed the stop line at red (light tls:2)"),
        (event("stop-sign", "s1"), "did not stop at stop sign s1"),
        (event("outside-lanes", factor=0.75), "drove 25 % of its way (20 m) outside lanes or on a wrong lane"),
        (stood(), "stood still for 30 s, 120 m before the end of its route (40 % done)"),
        (event("timed-out", factor=1.0), "ran out of time, 120 m before the end of its route (40 % done)"),
        (event("route-deviation", factor=1.0), "left its route, 120 m before the end of its route (40 % done)"),
        (event("honked", "npc"), "honked with npc"),
    ],
)
def test_every_infraction_is_a_sentence(infraction: Infraction, text: str) -> None:
    found = explain_losses(episode(ego(infraction), ego(name="1", rc=100.0, ds=100.0)), {"0": 200.0})
    assert [(cav.ego, [loss.text for loss in cav.losses]) for cav in found] == [("0", [text])]
    assert (found[0].losses[0].time_s, found[0].losses[0].factor) == (infraction.tick / 20, infraction.factor)


def test_a_collision_and_a_standstill_come_with_the_reason_that_held() -> None:
    reasons = [
        NotedReason(tick, name, Cause.YIELD, (), text)
        for tick, name, text in (
            (5, "0", "yields to A"),
            (HIT, "0", "follows B"),
            (HIT, "1", "never mind"),
            (99, "0", "stops"),
        )
    ]
    cav = ego(hit("npc"), event("red-light", "tls:2"), stood())
    (found,) = explain_losses(episode(cav), {}, reasons)
    assert [loss.text for loss in found.losses] == [
        "hit vehicle npc at 2.5 m/s (noted: follows B)",
        "crossed the stop line at red (light tls:2)",
        "stood still for 30 s, with 40 % of its route done (noted: stops)",
    ]
    (early,) = explain_losses(episode(ego(hit("npc"))), {}, reasons[3:])
    assert early.losses[0].text == "hit vehicle npc at 2.5 m/s"


def test_a_failed_agent_says_how() -> None:
    failed = ego(event("agent-failed"), outcome=End.AGENT_FAILED, reason="crashed:\nValueError " + "x" * 500)
    (cav,) = explain_losses(episode(failed), {})
    assert cav.has_failed_agent and "\n" not in cav.losses[0].text
    assert cav.losses[0].text.startswith("agent failed (crashed: ValueError xxx")
    assert cav.losses[0].text.endswith("...), with 40 % of its route done")


@given(st.lists(st.tuples(st.floats(0, 100), st.lists(st.integers(0, 999), max_size=4)), min_size=1, max_size=6))
def test_who_lost_is_named_once_and_in_order(cavs: list[tuple[float, list[int]]]) -> None:
    """Only CAVs that did not succeed, the worst first, with all their infractions by time."""
    egos = [
        ego(*(hit().model_copy(update={"tick": tick}) for tick in ticks), name=str(i), ds=ds)
        for i, (ds, ticks) in enumerate(cavs)
    ]
    found = explain_losses(episode(*egos), {})
    assert sorted(cav.ego for cav in found) == [str(i) for i, (ds, _) in enumerate(cavs) if round(ds, 6) <= 99.95]
    assert [cav.ds for cav in found] == sorted(cav.ds for cav in found)
    for cav in found:
        assert [loss.tick for loss in cav.losses] == sorted(cavs[int(cav.ego)][1])


def test_in_mode_hard_lost_time_is_a_loss() -> None:
    late = ego(
        name="0", rc=100.0, ds=100.0, ip=1.0, outcome=End.ARRIVED, ticks=300, time_ratio=1.5, time_factor=0.666667
    )
    hit_late = ego(hit(), name="1", rc=100.0, outcome=End.ARRIVED, ticks=300, time_ratio=1.5, time_factor=0.6)
    in_time = ego(name="2", rc=100.0, ds=100.0, ip=1.0, ticks=200, time_ratio=1.0, time_factor=1.0)
    found = {cav.ego: cav.losses for cav in explain_losses(episode(late, hit_late, in_time), {})}
    assert [loss.text for loss in found["0"]] == ["needed 1.50 x omniscient's time"]
    assert found["1"][-1].text == "counts with its whole time limit, with an infraction"
    assert "2" not in found
