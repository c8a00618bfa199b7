"""What leaves the stations of attackers: hand-made messages, and that honest stations are left alone."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from testing.message_samples import cpms, mcms, objects_around

from mdrive_sumo.contract import Message
from mdrive_sumo.core.state import Kind
from mdrive_sumo.v2x.attacks.attack_settings import AttackKind, parse_attack
from mdrive_sumo.v2x.attacks.falsifier import Falsifier
from mdrive_sumo.v2x.attacks.route_point import Receiver
from mdrive_sumo.v2x.messages import (
    FLOOD,
    Cam,
    Cpm,
    Direction,
    Intention,
    Mcm,
    ReferencePose,
    decode,
    encode,
    find_problem,
)

ATTACKER, NAME = "0", "aaaaaaaa"
ROUTE = np.column_stack((np.arange(200.0), np.zeros(200)))


def make_falsifier(text: str) -> Falsifier:
    attack = parse_attack(text)
    assert attack is not None
    return Falsifier(attack, {ATTACKER: NAME}, 7)


def receiver(x: float, speed: float = 6.0, name: str = "bbbbbbbb") -> Receiver:
    return Receiver(name, x, 0.0, speed, ROUTE)


def lie(text: str, *messages: Message, tick: int = 0, x: float = 10.0, falsifier: Falsifier | None = None) -> list[Any]:
    found = (falsifier or make_falsifier(text)).falsify(
        tick, {ATTACKER: messages, "1": messages}, {ATTACKER: receiver(50.0), "1": receiver(x)}, {ATTACKER, "1"}
    )
    assert found["1"] == messages
    return [one if one.type == FLOOD else decode(one) for one in found.get(ATTACKER, ())]


def make_pose(tick: int = 0, x: float = 40.0) -> ReferencePose:
    return ReferencePose(x, 20.0, 0.5, tick)


def make_cpm(count: int = 3) -> Cpm:
    pose = make_pose()
    objects = objects_around(pose, count, 12, 80.0, seed=1)
    return Cpm(pose, 80.0, objects, np.zeros(count, dtype=np.uint8), sigmas=np.full((count, 3), 0.2))


def make_mcm(points: int = 10) -> Mcm:
    steps = np.column_stack((40.0 + np.arange(1.0, points + 1.0), np.full(points, 20.0)))
    return Mcm(make_pose(), 5.0, Intention.KEEP, Direction.FOLLOW, 0.2, steps, steps + 1.0)


def test_a_phantom_stands_where_the_receiver_has_to_brake() -> None:
    (cpm,) = lie("phantom", encode(make_cpm()))
    assert len(cpm.objects) == 4 and cpm.objects.kind[3] == Kind.VEHICLE and cpm.objects.speed[3] == 0.0
    # 10 m along the route + 7 m gap + 6 m of a second's reaction + 36 / 6 m of braking
    assert (cpm.objects.x[3], cpm.objects.y[3]) == pytest.approx((29.0, 0.0), abs=0.02)
    assert math.cos(cpm.objects.yaw[3]) == pytest.approx(1.0)


def test_a_phantom_stays_until_the_receiver_has_passed_then_another_one_stands_ahead() -> None:
    falsifier, message = make_falsifier("phantom"), encode(make_cpm(0))
    places = [lie("", message, x=x, falsifier=falsifier)[0].objects for x in (10.0, 20.0, 29.0, 31.0)]
    assert [round(float(one.x[0])) for one in places] == [29, 29, 29, 50]
    assert places[0].ids == places[2].ids != places[3].ids


def test_no_phantom_stands_behind_the_end_of_a_route_or_far_away() -> None:
    assert len(lie("phantom", encode(make_cpm(3)), x=190.0)[0].objects) == 3
    far = encode(Cpm(make_pose(x=400.0), 80.0, make_cpm(0).objects, np.zeros(0, dtype=np.uint8)))
    assert len(lie("phantom", far)[0].objects) == 0


def test_a_full_cpm_keeps_its_nearest_objects() -> None:
    (cpm,) = lie("phantom", encode(make_cpm(255)))
    assert len(cpm.objects) == len(cpm.age) == len(cpm.sigmas) == 255
    assert cpm.objects.ids[:254] == make_cpm(255).objects.ids[:254]


def test_hiding_leaves_no_object_and_claims_a_free_view() -> None:
    (cpm,) = lie("hide", encode(make_cpm()))
    assert len(cpm.objects) == 0 and cpm.objects.free_m.tolist() == [80.0] * 12


@pytest.mark.parametrize(("tick", "shift_m"), [(0, 0.0), (100, 1.5), (100_000, 8.0)])
def test_a_shift_drifts_at_its_rate_up_to_its_most(tick: int, shift_m: float) -> None:
    cam = Cam(make_pose(), 5.0, 0.0, 0.0, 4.9, 1.9)
    moved_cam, moved_mcm = lie("shift", encode(cam), encode(make_mcm()), tick=tick)
    assert math.hypot(moved_cam.pose.x - 40.0, moved_cam.pose.y - 20.0) == pytest.approx(shift_m, abs=0.02)
    assert moved_mcm.planned - (moved_cam.pose.x, moved_cam.pose.y) == pytest.approx(
        make_mcm().planned - (40.0, 20.0), abs=0.03
    )


def test_a_forged_claim_asks_all_to_stop_and_ends_on_the_route_of_the_nearest() -> None:
    (mcm,) = lie("forge-mcm", encode(make_mcm()))
    assert mcm.requests == {"bbbbbbbb": Intention.STOP, NAME: Intention.FASTER}
    assert mcm.answers == {"bbbbbbbb": False} and mcm.group == (NAME, "bbbbbbbb")
    assert mcm.planned[-1] == pytest.approx((29.0, 0.0), abs=0.03)  # 10 points every 0.2 s: after 2 s
    assert mcm.planned[4] == pytest.approx((34.5, 10.0), abs=0.03)
    assert mcm.until_tick == 100


def test_a_false_promise_stands_and_says_yes() -> None:
    (mcm,) = lie("forge-mcm:claim=yield", encode(make_mcm()))
    assert mcm.planned == pytest.approx(np.tile((40.0, 20.0), (10, 1)), abs=0.02)
    assert mcm.desired == pytest.approx(make_mcm().desired, abs=0.02)
    assert (mcm.intention, mcm.answers) == (Intention.STOP, {"bbbbbbbb": True})


def test_a_replay_sends_what_was_sent_before_with_the_present_time() -> None:
    falsifier = make_falsifier("replay:delay=0.5")
    sent = []
    for tick in range(20):
        cam = Cam(make_pose(tick, 40.0 + tick), 5.0, 0.0, 0.0, 4.9, 1.9)
        messages = (encode(cam),) if tick % 2 == 0 else ()
        found = falsifier.falsify(tick, {ATTACKER: messages}, {}, {ATTACKER})
        sent += [(tick, decode(one).pose) for one in found.get(ATTACKER, ())]  # pyright: ignore[reportAttributeAccessIssue]
    assert [(tick, pose.x) for tick, pose in sent] == [
        *((tick, 40.0 + tick) for tick in range(0, 10, 2)),
        *((tick, 30.0 + tick) for tick in range(10, 20, 2)),
    ]
    assert all(pose.tick == tick for tick, pose in sent)


def test_a_flood_adds_its_share_of_bytes_in_every_tick() -> None:
    *honest, filler = lie("flood:bytes=1000", encode(make_cpm()))
    assert len(honest) == 1 and len(filler.payload) == 50 and find_problem(filler) is None
    silent = make_falsifier("flood").falsify(3, {}, {}, {ATTACKER})
    assert [one.type for one in silent[ATTACKER]] == [FLOOD]
    assert make_falsifier("flood").falsify(3, {}, {}, set()) == {}


@settings(max_examples=40, deadline=None)
@given(st.sampled_from([*AttackKind]), cpms(), mcms(), st.binary(max_size=40), st.integers(0, 5000))
def test_a_lie_is_a_valid_message_and_what_cannot_be_read_stays(
    kind: AttackKind, cpm: Cpm, mcm: Mcm, noise: bytes, tick: int
) -> None:
    messages = (encode(cpm), encode(mcm), Message("cam", noise), Message("text", b"hello"))
    found = make_falsifier(str(kind)).falsify(tick, {ATTACKER: messages}, {"1": receiver(10.0)}, {ATTACKER})
    lies = found.get(ATTACKER, ())
    if kind is AttackKind.REPLAY and tick >= 60:
        assert lies == ()
        return
    assert all(find_problem(one) is None for one in (*lies[:2], *lies[3:]))
    assert lies[2:4] == messages[2:4]
