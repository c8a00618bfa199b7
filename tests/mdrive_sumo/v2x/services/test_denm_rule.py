"""Events: repeated while they last, cancelled when they are over; and what a receiver keeps of them."""

from dataclasses import replace

from mdrive_sumo.contract import Message
from mdrive_sumo.v2x.messages import Denm, EventCause, ReferencePose, Termination, encode
from mdrive_sumo.v2x.services.denm_rule import DenmRule, Hazard, SenderFacts
from mdrive_sumo.v2x.services.event_table import MAX_EVENTS, EventName, EventTable

STANDS, BRAKES = EventCause.STATIONARY_VEHICLE, EventCause.DANGEROUS_SITUATION


def warn(rule: DenmRule, tick: int, *causes: EventCause) -> list[Denm]:
    sender = SenderFacts(ReferencePose(float(tick), 0.0, 0.0, tick), 5.0, 4.9, 2.0)
    return rule.check(tick, sender, [Hazard(cause, 0, float(tick), 1.0) for cause in causes])


def test_an_event_is_repeated_with_its_present_place_and_then_cancelled_three_times() -> None:
    rule, sent = DenmRule(), list[Denm]()
    for tick in range(0, 20, 2):
        sent += warn(rule, tick, *((BRAKES,) if 2 <= tick < 6 else ()))
    facts = [(denm.pose.tick, denm.x, denm.detection_tick, denm.sequence, denm.termination) for denm in sent]
    over = Termination.CANCELLATION
    assert facts == [
        (2, 2.0, 2, 0, Termination.NONE), (4, 4.0, 2, 0, Termination.NONE),
        (6, 4.0, 2, 0, over), (8, 4.0, 2, 0, over), (10, 4.0, 2, 0, over),
    ]  # fmt: skip


def test_causes_are_events_of_their_own_and_one_that_returns_is_a_new_event() -> None:
    rule = DenmRule()
    first = warn(rule, 0, BRAKES, STANDS)
    assert [(denm.cause, denm.sequence) for denm in first] == [(STANDS, 1), (BRAKES, 0)]
    assert [denm.cause for denm in warn(rule, 2, BRAKES, STANDS)] == [BRAKES]  # the other one in a second
    warn(rule, 4, STANDS)
    assert [(denm.sequence, denm.termination) for denm in warn(rule, 6, BRAKES, STANDS)] == [(2, Termination.NONE)]


def denm(tick: int = 0, sequence: int = 0, **changes: object) -> Denm:
    pose = ReferencePose(0.0, 0.0, 0.0, tick)
    return replace(Denm(pose, sequence, BRAKES, 1, 0.0, 0.0, 0, 1.0, 5.0, 4.9, 2.0), **changes)


def hear(table: EventTable, *denms: Denm, sender: str = "cav_1") -> int:
    """Return the number of notes."""
    messages = [replace(encode(one), sender=sender, tick=one.pose.tick) for one in denms]
    return len(table.receive(messages))


def test_an_event_is_noted_once_and_valid_until_its_validity_ends() -> None:
    table, name = EventTable(), EventName("cav_1", 0)
    assert hear(table, denm()) == 1 and hear(table, denm(2)) == 0
    assert table.find_events(22) == {name: denm(2)}
    assert table.find_events(22, STANDS) == {} and table.find_events(22, BRAKES)
    assert table.find_events(23) == {} and hear(table, denm(30)) == 0


def test_a_cancelled_event_stays_over_whatever_comes_late() -> None:
    table = EventTable()
    hear(table, denm(), denm(4, termination=Termination.CANCELLATION), denm(2))
    assert table.find_events(4) == {}
    hear(table, denm(6, sequence=1), sender="cav_2")
    assert [*table.find_events(6)] == [EventName("cav_2", 1)]


def test_messages_out_of_order_or_unreadable_or_too_many_change_nothing() -> None:
    table = EventTable()
    hear(table, denm(8), denm(4))
    assert table.find_events(8)[EventName("cav_1", 0)].pose.tick == 8
    assert table.receive([Message("denm", b"\x07", "cav_1", 9), Message("text", b"x", "cav_1", 9)]) == ()
    assert sum(hear(table, denm(9, sequence=number)) for number in range(2 * MAX_EVENTS)) == MAX_EVENTS - 1
