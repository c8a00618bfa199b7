"""How drives of certified CAVs end."""

import pytest

from mdrive_sumo.core.state import End
from mdrive_sumo.core.tables import format_text
from mdrive_sumo.scoring import EgoResult, Infraction, ScenarioResult
from mdrive_sumo.study.certified_failures import DriveEnd, build_failure_table, judge_drive
from mdrive_sumo.study.need_certificate import NeedCertificate, NeedConflict, Proof

CONFLICT = NeedConflict(
    ego="a",
    road_user="b",
    x=57.0,
    y=0.0,
    required_speed=7.0,
    proves=Proof.ALL,
    proves_over_roofs=None,
    conflict_s=5.0,
)
CERTIFICATE = NeedCertificate(scenario="corner", conflicts=(CONFLICT,))


def hit(other: str, tick: int, x: float = 60.0, factor: float = 0.6) -> Infraction:
    return Infraction(kind="collision-vehicle", tick=tick, x=x, y=0.0, factor=factor, other=other)


def late(tick: int) -> Infraction:
    """The mark that costs in mode `hard`."""
    return Infraction(kind="timed-out", tick=tick, x=60.0, y=0.0, factor=0.7, other="")


def end_drive(*infractions: Infraction, outcome: End = End.ARRIVED, name: str = "a") -> EgoResult:
    return EgoResult(id=name, outcome=outcome, reason="", ds=60.0, rc=100.0, ip=0.6, infractions=infractions)


@pytest.mark.parametrize(
    ("result", "end"),
    [
        (end_drive(), DriveEnd.MET),
        (end_drive(outcome=End.TIMED_OUT), DriveEnd.LATE),
        (end_drive(late(100), outcome=End.TIMED_OUT), DriveEnd.LATE),
        (end_drive(hit("c", 50), late(100), outcome=End.TIMED_OUT), DriveEnd.ELSEWHERE),
        (end_drive(hit("b", 90)), DriveEnd.CERTIFIED),
        (end_drive(hit("b", 90), hit("c", 95)), DriveEnd.CERTIFIED),
        (end_drive(hit("b", 90), hit("c", 50)), DriveEnd.ELSEWHERE),
        (end_drive(hit("b", 90), hit("c", 50, factor=1.0)), DriveEnd.CERTIFIED),  # one that costs nothing
        (end_drive(hit("b", 90, x=100.0)), DriveEnd.ELSEWHERE),  # the same road user at another place
        (end_drive(hit("b", 90), outcome=End.TIMED_OUT), DriveEnd.CERTIFIED),
        (end_drive(hit("b", 90), name="other"), None),  # nothing is proven of it
    ],
)
def test_the_first_costly_infraction_counts(result: EgoResult, end: DriveEnd | None) -> None:
    assert judge_drive(result, CERTIFICATE) is end


def test_the_table_counts_drives_by_what_is_proven() -> None:
    egos = (end_drive(hit("b", 90)), end_drive(name="other"))
    result = ScenarioResult.model_construct(id="corner", egos=egos)
    table = build_failure_table((result, result), {"corner": CERTIFICATE})
    assert table is not None
    assert format_text(table).splitlines()[-1].split() == ["all", "2", "2", "0", "0", "0"]
    nothing = NeedCertificate(scenario="corner", conflicts=())
    assert build_failure_table((result,), {"corner": nothing}) is build_failure_table((result,), {}) is None
