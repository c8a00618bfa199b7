"""What a member knows: zones, sectors, rules of the road, what holds it up, and which objects it tells of."""

import math
from dataclasses import replace

import numpy as np
import pytest
from testing.negotiation_fakes import crossing, member

from mdrive_sumo.contract import Cause, Objects, Reason
from mdrive_sumo.contract.briefing import JunctionKind
from mdrive_sumo.core.state import Kind
from mdrive_sumo.negotiation.conflict_graph import build_conflict_graph
from mdrive_sumo.negotiation.dialogue.dialogue_view import (
    MAX_TOLD,
    DialogueView,
    Hold,
    OwnKnowledge,
    build_dialogue_view,
    find_zones,
)
from mdrive_sumo.negotiation.negotiator import NegotiationMember
from mdrive_sumo.v2x.messages import Direction

LETTERS = {"a": "A", "b": "B"}
Row = tuple[str, Kind, float, float, float]
"""Id, kind, x, y, speed."""


def build_objects(*rows: Row) -> Objects:
    ids, kinds, x, y, speed = zip(*rows, strict=True) if rows else ((), (), (), (), ())
    east, north, moving = (np.array(column, dtype=np.float64) for column in (x, y, speed))
    yaw, length, width = np.zeros(len(ids)), np.full(len(ids), 4.5), np.full(len(ids), 2.0)
    return Objects(tuple(ids), np.array(kinds, np.uint8), east, north, yaw, moving, length, width)


def view(
    me: str = "a",
    cars: dict[str, NegotiationMember] | None = None,
    objects: Objects | None = None,
    reason: Reason | None = None,
    junction: JunctionKind | None = None,
    sources: dict[str, str] | None = None,
) -> DialogueView:
    cars = cars or crossing()
    free = Reason(Cause.FREE)
    known = OwnKnowledge(objects or build_objects(), reason or free, sources or {}, {"k9": 2.0}, junction)
    return build_dialogue_view(me, list(cars.values()), LETTERS, (), known)


def test_members_are_seen_from_the_viewer_with_their_zones() -> None:
    """a is 10 m before the crossing, b 12 m; at 6 m/s they move 1.2 m a step, and 3.55 m is too close."""
    seen = view()
    a, b = seen.members
    assert (a.letter, a.sector, b.letter, b.sector, b.heading) == ("A", "", "B", "ahead right", "from right to left")
    assert b.distance_m == pytest.approx(math.hypot(10, 12)) and b.in_conflict and not a.in_conflict
    assert a.zone_s == (1.2, 2.2) and b.zone_s == (1.6, 2.4)  # x = -2.8 to 3.2, y = -2.4 to 2.4
    assert view("b").members[0].heading == "from left to right" and view("b").letters == "AB"


def test_members_that_share_nothing_have_no_zone() -> None:
    apart = [member("a", 0, 0, 0), member("b", 0, 50, 0)]
    assert find_zones(apart, build_conflict_graph(apart)) == {"a": None, "b": None}
    late = [member("a", -10, 0, 0), member("b", 0, -30, math.pi / 2)]  # the same place, but not at the same time
    assert find_zones(late, build_conflict_graph(late)) == {"a": None, "b": None}


LEFT, FOLLOW, CHANGE = Direction.LEFT, Direction.FOLLOW, Direction.CHANGE_LEFT
CROSSING, ONCOMING, BESIDE = (0.0, -12.0, math.pi / 2), (20.0, 0.0, math.pi), (-10.0, 3.0, 0.0)


@pytest.mark.parametrize(
    ("other", "directions", "junction", "expected"),
    [
        (CROSSING, (FOLLOW, FOLLOW), "yield", (("A", "B"),)),
        (CROSSING, (FOLLOW, FOLLOW), "stop", (("A", "B"),)),
        (CROSSING, (FOLLOW, FOLLOW), "priority-road", (("B", "A"),)),
        (CROSSING, (FOLLOW, FOLLOW), "right-before-left", (("A", "B"),)),
        (CROSSING, (FOLLOW, FOLLOW), "left-before-right", (("B", "A"),)),
        (CROSSING, (FOLLOW, FOLLOW), "roundabout", (("B", "A"),)),
        (CROSSING, (FOLLOW, FOLLOW), "uncontrolled", ()),
        (CROSSING, (FOLLOW, FOLLOW), None, ()),
        (ONCOMING, (LEFT, FOLLOW), "priority-road", (("A", "B"),)),
        (ONCOMING, (FOLLOW, LEFT), "yield", (("B", "A"),)),
        (ONCOMING, (LEFT, LEFT), "yield", ()),
        (BESIDE, (CHANGE, FOLLOW), None, (("A", "B"),)),
        (BESIDE, (FOLLOW, FOLLOW), "yield", ()),
    ],
)
def test_rules_of_the_road(
    other: tuple[float, float, float],
    directions: tuple[Direction, Direction],
    junction: JunctionKind | None,
    expected: tuple[tuple[str, str], ...],
) -> None:
    a, b = member("a", -10, 0, 0), member("b", *other)
    cars = {"a": replace(a, direction=directions[0]), "b": replace(b, direction=directions[1])}
    assert view(cars=cars, junction=junction).yields == expected


@pytest.mark.parametrize(
    ("reason", "expected"),
    [
        (Reason(Cause.FREE), None),
        (Reason(Cause.AGREEMENT, ("b",), distance_m=5.0), None),
        (Reason(Cause.FOLLOW, ("b",), distance_m=5.0), None),
        (Reason(Cause.STOP_SIGN, distance_m=12.0), Hold("stop sign", 12.0)),
        (Reason(Cause.YIELD, ("k1",), distance_m=7.0, seconds=2.0), Hold("crossing pedestrian", 7.0, 2.0)),
        (Reason(Cause.BLOCKED, ("k7",)), Hold("traffic")),
    ],
)
def test_what_holds_a_member_up_is_known_to_it_unless_it_is_a_member(reason: Reason, expected: Hold | None) -> None:
    objects = build_objects(("k1", Kind.PEDESTRIAN, -3.0, 2.0, 1.2))
    assert view(objects=objects, reason=reason).hold == expected


def test_objects_near_the_way_are_told_of_own_ones_first() -> None:
    near = [(f"k{i}", Kind.VEHICLE, -10.0 + i, 2.0, 3.0) for i in range(6)]
    rows: list[Row] = [("k9", Kind.CYCLIST, 0.0, 0.5, 4.0), ("b", Kind.VEHICLE, 0.0, 1.0, 6.0), *near]
    rows += [("k8", Kind.VEHICLE, 0.0, 40.0, 6.0), ("k10", Kind.STATIC, -5.0, 0.0, 0.0)]
    seen = view(objects=build_objects(*rows), sources={"k9": "b"})
    assert [one.source for one in seen.objects] == [""] * MAX_TOLD + ["B"]
    assert seen.objects[0].name == "obstacle" and seen.objects[-1].name == "cyclist"
    assert seen.objects[-1].sigma_m == 2.0 and seen.traffic == 7
