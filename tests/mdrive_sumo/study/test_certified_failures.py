"""How drives of certified CAVs end."""

import pytest

from mdrive_sumo.core.state import End
from mdrive_sumo.core.tables import format_text
from mdrive_sumo.scenario.scenario_part import Pose
from mdrive_sumo.scenario.scripted_actor import Actor, ReplayMotion, StandingMotion
from mdrive_sumo.scoring import EgoResult, Infraction, ScenarioResult
from mdrive_sumo.study.certified_failures import DriveEnd, build_failure_table, judge_drive
from mdrive_sumo.study.need_certificate import NeedCertificate, NeedConflict, Proof
from mdrive_sumo.worlds.placement.bodies import BODIES, build_actor

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


def make_rider(name: str) -> Actor:
    motion = ReplayMotion(poses=((0.0, 0.0, 0.0, 0.0), (1.0, 6.0, 0.0, 0.0)))
    return build_actor(name, BODIES["bicycle"], Pose(x=0.0, y=0.0, yaw=0.0), motion=motion, avoid_collision=False)


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
        (end_drive(hit("rider0_7", 90)), DriveEnd.ELSEWHERE),  # of a stream without the certified road user
    ],
)
def test_the_first_costly_infraction_counts(result: EgoResult, end: DriveEnd | None) -> None:
    assert judge_drive(result, CERTIFICATE, {"rider0_7": "bicycle rider0_"}) is end


@pytest.mark.parametrize(
    ("other", "x", "end"),
    [
        ("rider0_3", 60.0, DriveEnd.CERTIFIED),
        ("rider0_12", 60.0, DriveEnd.CERTIFIED),
        ("rider0_12", 100.0, DriveEnd.ELSEWHERE),
        ("rider1_3", 60.0, DriveEnd.ELSEWHERE),
        ("parked0_3", 60.0, DriveEnd.ELSEWHERE),
    ],
)
def test_every_rider_of_the_certified_stream_counts_at_its_conflict(other: str, x: float, end: DriveEnd) -> None:
    certificate = CERTIFICATE.model_copy(update={"conflicts": (CONFLICT.model_copy(update={"road_user": "rider0_3"}),)})
    actors = [make_rider(name) for name in ("rider0_3", "rider0_12", "rider1_3")]
    streams = {one.id: one.stream for one in actors}
    assert judge_drive(end_drive(hit(other, 90, x)), certificate, streams) is end


def test_only_who_brakes_for_nothing_on_a_replayed_course_is_in_a_stream() -> None:
    rider = make_rider("rider0_3")
    assert rider.stream == "bicycle rider0_"
    assert rider.model_copy(update={"avoid_collision": True}).stream == ""
    assert rider.model_copy(update={"motion": StandingMotion()}).stream == ""


def test_the_table_counts_drives_by_what_is_proven() -> None:
    egos = (end_drive(hit("b", 90)), end_drive(name="other"))
    result = ScenarioResult.model_construct(id="corner", egos=egos)
    table = build_failure_table((result, result), {"corner": CERTIFICATE}, ())
    assert table is not None
    assert format_text(table).splitlines()[-1].split() == ["all", "2", "2", "0", "0", "0"]
    nothing = NeedCertificate(scenario="corner", conflicts=())
    assert build_failure_table((result,), {"corner": nothing}, ()) is build_failure_table((result,), {}, ()) is None
