"""Late fusion: what I see and what others tell become one list of things."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from testing.planning import FACTS, LENGTH, own, things
from testing.sampling import examples

from mdrive_sumo.contract import Message, Objects
from mdrive_sumo.core.geometry import wrap_angle
from mdrive_sumo.core.state import DT, Kind
from mdrive_sumo.perception.late_fusion import ETSI_FUSION, FUSION, FusionLimits, LateFusion
from mdrive_sumo.v2x.messages import (
    CAM,
    CPM,
    Cam,
    Cpm,
    Direction,
    Intention,
    Mcm,
    ReferencePose,
    displace_message,
    encode,
)

NOTHING = things()
CENTIMETRE = 0.011


def sent(message: Message, sender: str) -> Message:
    """As the channel hands it over."""
    return replace(message, sender=sender)


def cam(
    sender: str, x: float, y: float = 0.0, yaw: float = 0.0, speed: float = 0.0, turn: float = 0.0, tick: int = 0
) -> Message:
    """A station at that place, which turns at `turn` [rad/s]."""
    return sent(encode(Cam(ReferencePose(x, y, yaw, tick), speed, 0.0, turn, LENGTH, 1.8)), sender)


def cpm(sender: str, objects: Objects, x: float = 50.0, y: float = 50.0, tick: int = 0, age: int = 0) -> Message:
    """What a station at that place sees."""
    ages = np.full(len(objects.ids), age, dtype=np.uint8)
    return sent(encode(Cpm(ReferencePose(x, y, 0.0, tick), 80.0, objects, ages)), sender)


def fused(
    messages: Sequence[Message], seen: Objects = NOTHING, tick: int = 0, reach: FusionLimits | None = None
) -> Objects:
    """What a car at the origin knows then."""
    fusion = LateFusion(FACTS, reach)
    assert fusion.receive(messages) == ()
    return fusion.fuse(tick, own(), seen)


def places(objects: Objects) -> list[tuple[float, float]]:
    """Centres, to 0.1 m."""
    return sorted((round(x, 1), round(y, 1)) for x, y in zip(objects.x.tolist(), objects.y.tolist(), strict=True))


def test_own_and_received_objects_form_one_list() -> None:
    told = things((30, 0, 0, 0), (30, 10, 0, 0))
    known = fused([cam("b", 20.0), cpm("b", told)], things((10, 0, 0, 0)))
    assert places(known) == [(10, 0), (20, 0), (30, 0), (30, 10)]
    assert known.ids == ("t00000000", "b", "b:t00000000", "b:t00000001")


def test_the_own_measurement_is_preferred() -> None:
    mine = things((20.0, 0.3, 0.1, 4.0), ids=("t00000007",))
    known = fused([cam("b", 20.5, speed=9.0), cpm("c", things((20.0, -0.4, 0.0, 5.0)))], mine)
    assert (known.x.tolist(), known.y.tolist(), known.speed.tolist()) == ([20.0], [0.3], [4.0])
    assert known.ids == ("b",)  # but the station's name is the better one


def test_association_is_one_to_one_from_the_nearest_pair() -> None:
    mine = things((20.0, 0.0, 0.0, 0.0))
    told = things((22.0, 0.0, 0.0, 0.0), (20.3, 0.0, 0.0, 0.0))
    known = fused([cpm("b", told)], mine)
    assert places(known) == [(20.0, 0.0), (22.0, 0.0)]  # both are within the gate, one of them is mine
    assert known.ids == ("t00000000", "b:t00000000")


@pytest.mark.parametrize(("gap", "count"), [(FUSION.vehicle_gate_m - 0.1, 1), (FUSION.vehicle_gate_m + 0.1, 2)])
def test_cars_within_the_gate_are_merged(gap: float, count: int) -> None:
    assert len(fused([cpm("b", things((20 + gap, 0, 0, 0)))], things((20, 0, 0, 0))).ids) == count


def test_reports_of_the_own_car_are_removed() -> None:
    me, other = (0.8, -0.6, 0.0, 3.0), (12.0, 0.0, 0.0, 3.0)
    assert places(fused([cpm("b", things(me, other))])) == [(12.0, 0.0)]


def test_pedestrians_are_not_cars() -> None:
    walker = things((20.3, 0, 0, 1), kind=Kind.PEDESTRIAN)
    known = fused([cpm("b", walker)], things((20, 0, 0, 0)))
    assert sorted(known.kind.tolist()) == [Kind.VEHICLE, Kind.PEDESTRIAN]
    assert known.width.tolist() == pytest.approx([1.8, 0.6], abs=CENTIMETRE)
    nearby = things((21.5, 0, 0, 1), kind=Kind.PEDESTRIAN)  # a car would be the same one
    assert len(fused([cpm("b", walker)], nearby).ids) == 2
    assert len(fused([cpm("b", walker)], things((20.9, 0, 0, 1), kind=Kind.PEDESTRIAN)).ids) == 1


@given(st.floats(-3, 3), st.floats(0, 15), st.integers(0, FUSION.memory_ticks))
def test_age_is_compensated_exactly_at_constant_velocity(yaw: float, speed: float, ticks: int) -> None:
    way = np.array((math.cos(yaw), math.sin(yaw))) * speed * ticks * DT
    station = fused([cam("b", 100.0, 20.0, yaw, speed)], tick=ticks)
    seen = fused([cpm("b", things((100.0, 20.0, yaw, speed)))], tick=ticks)
    for known in (station, seen):
        assert (known.x[0], known.y[0]) == pytest.approx((100.0 + way[0], 20.0 + way[1]), abs=0.03)
        assert wrap_angle(float(known.yaw[0]) - yaw) == pytest.approx(0.0, abs=1e-3)


def test_the_age_of_a_measurement_counts_too() -> None:
    known = fused([cpm("b", things((30.0, 0.0, 0.0, 10.0)), age=6)], tick=4)
    assert known.x[0] == pytest.approx(30.0 + 10.0 * 10 * DT, abs=0.02)


@given(st.floats(-0.6, 0.6), st.integers(0, FUSION.memory_ticks))
def test_stations_are_advanced_along_arcs(turn: float, ticks: int) -> None:
    known = fused([cam("b", 60.0, 10.0, 0.3, 8.0, turn)], tick=ticks)
    x, y, yaw = 60.0, 10.0, 0.3
    step_s = ticks * DT / 300
    for _ in range(300):  # the motion itself, in small steps
        x, y = x + 8.0 * step_s * math.cos(yaw), y + 8.0 * step_s * math.sin(yaw)
        yaw += turn * step_s
    assert (known.x[0], known.y[0]) == pytest.approx((x, y), abs=0.03)
    assert wrap_angle(float(known.yaw[0]) - yaw) == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize(("ticks", "known"), [(FUSION.memory_ticks, 2), (FUSION.memory_ticks + 1, 0)])
def test_messages_older_than_a_second_are_dropped(ticks: int, known: int) -> None:
    assert FUSION.memory_ticks * DT == 1.0
    assert len(fused([cam("b", 30.0), cpm("b", things((40, 0, 0, 0)))], tick=ticks).ids) == known


def test_poses_of_the_future_and_boxes_without_a_size_are_dropped() -> None:
    car = things((40, 0, 0, 0))
    flat, thin = replace(car, length=np.zeros(1)), replace(car, width=np.zeros(1))
    assert not fused([cpm("b", flat), cpm("c", thin), cpm("d", car, tick=1), cam("e", 30.0, tick=1)]).ids


def test_a_received_object_keeps_its_name_when_detected() -> None:
    fusion = LateFusion(FACTS)
    fusion.receive([cam("b", 50.0, 50.0), cpm("b", things((20, 0, 0, 0), ids=("t0000000a",)))])
    assert fusion.fuse(0, own(), NOTHING).ids == ("b", "b:t0000000a")
    known = fusion.fuse(1, own(), things((20.1, 0, 0, 0), ids=("t00000001",)))
    names = set(known.ids)
    gone = fusion.fuse(60, own(), things((20.1, 0, 0, 0), ids=("t00000001",)))
    assert names == {"b", "b:t0000000a"}
    assert gone.ids == ("b:t0000000a",)


def test_a_detected_station_keeps_its_name_without_messages() -> None:
    fusion = LateFusion(FACTS)
    mine = things((20, 0, 0, 0), ids=("t00000001",))
    fusion.receive([cam("b", 20.0)])
    assert fusion.fuse(0, own(), NOTHING).ids == ("b",)
    assert fusion.fuse(1, own(), mine).ids == ("b",)
    assert fusion.fuse(100, own(), mine).ids == ("b",)


def test_a_detected_object_keeps_its_name_when_only_received() -> None:
    fusion = LateFusion(FACTS)
    fusion.receive([cpm("b", things((20, 0, 0, 0)))])
    assert fusion.fuse(0, own(), things((20.1, 0, 0, 0), ids=("t00000001",))).ids == ("t00000001",)
    assert fusion.fuse(1, own(), NOTHING).ids == ("t00000001",)


def test_names_are_unique_after_a_merged_object_splits() -> None:
    fusion = LateFusion(FACTS)
    fusion.receive([cpm("b", things((20, 0, 0, 0)))])
    fusion.fuse(0, own(), things((20.1, 0, 0, 0), ids=("t00000001",)))
    fusion.receive([cpm("b", things((27, 0, 0, 0)), tick=1)])
    known = fusion.fuse(1, own(), things((20.1, 0, 0, 0), ids=("t00000001",)))
    assert len(set(known.ids)) == len(known.ids) == 2


def test_a_car_confused_with_a_station_regains_its_name() -> None:
    fusion = LateFusion(FACTS)
    mine = things((20, 0, 0, 0), ids=("t00000001",))
    fusion.receive([cam("b", 20.5)])
    assert fusion.fuse(0, own(), mine).ids == ("b",)
    fusion.receive([cam("b", 27.0, tick=1)])
    assert fusion.fuse(1, own(), mine).ids == ("t00000001", "b")
    both = things((20, 0, 0, 0), (27, 0, 0, 0), ids=("t00000001", "t00000002"))
    assert fusion.fuse(2, own(), both).ids == ("t00000001", "b")


@pytest.mark.slow
def test_the_channels_pose_error_hardly_ever_makes_two_of_one() -> None:
    """0.6 m in x and y, 0.6 degrees (protocol 12.1) at 30 m from the sender."""
    rng = np.random.default_rng(7)
    said = cpm("b", things((20.0, 0.0, 0.0, 0.0)), x=20.0, y=30.0)
    mine, twice = things((20.0, 0.0, 0.0, 0.0)), 0
    for _ in range(1000):
        dx, dy, turn = rng.normal(0, (0.6, 0.6, math.radians(0.6)))
        twice += len(fused([displace_message(said, dx, dy, turn)], mine).ids) == 2
    assert twice <= 5


def test_reach_picks_the_nearest_senders() -> None:
    told = [cpm(f"c{i}", things((200.0 + 10 * i, 0, 0, 0)), x=10.0 * (6 - i), y=0.0) for i in range(6)]
    assert places(fused(told, reach=FusionLimits(2, 70.0))) == [(240.0, 0.0), (250.0, 0.0)]
    assert len(fused(told, reach=FusionLimits(6, 35.0)).ids) == 3  # at 10, 20 and 30 m
    assert len(fused(told).ids) == 6


def test_unreadable_messages_are_noted_and_ignored() -> None:
    fusion = LateFusion(FACTS)
    broken = [Message(CAM, b"\x01rubbish", "b"), Message(CPM, b"", "c"), Message("mine", b"x", "d")]
    notes = fusion.receive([*broken, cam("e", 30.0)])
    assert [(note.kind, note.text.split(":")[0]) for note in notes] == [
        ("unreadable", "cam from b"), ("unreadable", "cpm from c"), ("unreadable", "mine from d")]  # fmt: skip
    assert fusion.fuse(0, own(), NOTHING).ids == ("e",)


def test_an_mcm_gives_a_position_and_a_cam_of_the_same_tick_replaces_it() -> None:
    mcm = Mcm(ReferencePose(30.0, 0.0, 0.0, 0), 4.0, Intention.KEEP, Direction.FOLLOW, 0.2, np.zeros((1, 2)))
    said = sent(encode(mcm), "b")
    assert fused([said]).length.tolist() == [FACTS.length]
    assert fused([said], tick=10).x[0] == pytest.approx(32.0, abs=CENTIMETRE)
    for order in ([said, cam("b", 30.0, speed=5.0)], [cam("b", 30.0, speed=5.0), said]):
        assert fused(order).speed.tolist() == [5.0]


Rows = list[tuple[float, float, float, float]]
CARS = st.lists(st.tuples(st.floats(-60, 60), st.floats(-60, 60), st.floats(-3, 3), st.floats(0, 10)), max_size=6)


@settings(max_examples=examples(20, 60))
@given(CARS, CARS, CARS)
def test_the_number_of_objects_is_between_the_maximum_and_the_sum(mine: Rows, first: Rows, second: Rows) -> None:
    def away(rows: Rows) -> Rows:  # the own place is kept free
        return [row for row in rows if math.hypot(row[0], row[1]) > FUSION.vehicle_gate_m + 0.1]

    mine, first, second = away(mine), away(first), away(second)
    known = fused([cpm("b", things(*first)), cpm("c", things(*second))], things(*mine))
    assert max(len(mine), len(first), len(second)) <= len(known.ids) <= len(mine) + len(first) + len(second)
    assert len(set(known.ids)) == len(known.ids)
    assert known.x[: len(mine)].tolist() == [row[0] for row in mine]


@settings(max_examples=examples(12, 40))
@given(CARS, CARS, st.permutations(range(4)))
def test_the_order_of_messages_within_a_tick_does_not_matter(first: Rows, second: Rows, order: list[int]) -> None:
    said = [cam("b", 25.0), cpm("b", things(*first)), cam("c", -25.0), cpm("c", things(*second))]
    one, other = fused(said), fused([said[i] for i in order])
    assert one.ids == other.ids
    assert np.array_equal(one.x, other.x)


def test_older_messages_that_arrive_later_are_ignored() -> None:
    fusion = LateFusion(FACTS)
    fusion.receive([cam("b", 20.0, tick=8), cpm("c", things((40.0, 0.0, 0.0, 0.0)), tick=8)])
    fusion.receive([cam("b", 90.0, tick=2), cpm("c", things((90.0, 9.0, 0.0, 0.0)), tick=2)])
    assert places(fusion.fuse(8, own(), NOTHING)) == [(20.0, 0.0), (40.0, 0.0)]


def test_cpms_with_a_part_of_what_their_sender_detects_add_up() -> None:
    one, other = things((30.0, 0.0, 0.0, 0.0), ids=["t00000001"]), things((40.0, 0.0, 0.0, 2.0), ids=["t00000002"])
    moved = things((33.0, 0.0, 0.0, 0.0), ids=["t00000001"])
    reports = [cpm("b", one), cpm("b", other, tick=10), cpm("b", moved, tick=20)]
    known: dict[bool, list[list[tuple[float, float]]]] = {}
    for accumulates in (False, True):
        fusion = LateFusion(FACTS, None, ETSI_FUSION, accumulates)
        fusion.receive(reports[:2])
        before = places(fusion.fuse(10, own(), NOTHING))
        fusion.receive(reports[2:])
        known[accumulates] = [before, *(places(fusion.fuse(tick, own(), NOTHING)) for tick in (20, 66))]
    assert known[False] == [[(40.0, 0.0)], [(33.0, 0.0)], []]
    assert known[True] == [[(30.0, 0.0), (40.0, 0.0)], [(33.0, 0.0), (41.0, 0.0)], []]


def test_a_part_that_is_too_old_is_dropped() -> None:
    fusion = LateFusion(FACTS, None, ETSI_FUSION, accumulates=True)
    one, other = things((30.0, 0.0, 0.0, 0.0), ids=["t00000001"]), things((40.0, 0.0, 0.0, 0.0), ids=["t00000002"])
    fusion.receive([cpm("b", one), cpm("b", other, tick=ETSI_FUSION.memory_ticks + 1)])
    assert places(fusion.fuse(ETSI_FUSION.memory_ticks + 1, own(), NOTHING)) == [(40.0, 0.0)]
