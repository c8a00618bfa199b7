"""The defence against senders that lie: rays, doubts, trust, motion, and the guard as a whole."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from testing.planning import own, seen, things

from mdrive_sumo.contract import Message, Objects, Observation, OwnState
from mdrive_sumo.contract.detector_profiles import IDEAL
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import DT, Kind
from mdrive_sumo.perception.announced_motion import AnnouncedMotion
from mdrive_sumo.perception.claim_history import Claim, ClaimHistory
from mdrive_sumo.perception.free_view import find_near, find_opaque, find_seen_through
from mdrive_sumo.perception.message_guard import MessageGuard
from mdrive_sumo.perception.sender_trust import SenderTrust
from mdrive_sumo.perception.witnesses import Witness, find_refuted_by_others, make_witness
from mdrive_sumo.v2x.messages import Cam, Cpm, Direction, Intention, Mcm, ReferencePose, encode

FREE = np.full(72, 80.0)
AGES = np.zeros(0, dtype=np.uint8)
LIAR, HONEST = "aaaaaaaa", "bbbbbbbb"


def sent(content: Cam | Cpm | Mcm, sender: str) -> Message:
    message = encode(content)
    return Message(message.type, message.payload, sender, content.pose.tick)


def car(x: float, y: float, speed: float = 0.0) -> Objects:
    box = things((x, y, 0.0, speed))
    return replace(box, length=np.array([4.5]), width=np.array([1.9]))


def look(tick: int, free_m: Float = FREE, detected: Objects | None = None, *messages: Message) -> Observation:
    objects = Objects.empty() if detected is None else detected
    return seen(tick, own(), replace(objects, free_m=free_m), messages)


def refute(boxes: Objects, eye: OwnState, free_m: Float, sigma: float = 0.0) -> list[bool]:
    return (find_opaque(boxes) & find_seen_through(boxes, np.full(len(boxes), sigma), eye, free_m)).tolist()


def test_a_box_is_refuted_by_a_ray_through_it_that_goes_on() -> None:
    """Its front is 17.75 m away, its rear 22.25 m; free views in messages have steps of 0.4 m."""
    assert refute(car(20.0, 0.0), own(), FREE) == [True]
    for end_m in (17.7, 22.0, 22.6):
        assert refute(car(20.0, 0.0), own(), np.full(72, end_m)) == [False]
    assert refute(car(20.0, 0.0), own(), np.full(72, 22.7)) == [True]


def test_a_box_that_may_stand_between_two_rays_is_not_refuted() -> None:
    middle = 40.0 * math.tan(math.radians(2.5))  # rays at 0 and 5 degrees are 3.5 m apart there
    assert refute(car(40.0, middle), own(), FREE) == [False]
    # a ray meets the middle of the box: it passes by if the box is 0.95 m further aside, two standard deviations
    assert [refute(car(40.0, 0.0), own(), FREE, sigma)[0] for sigma in (0.0, 0.3, 0.6)] == [True, True, False]
    # 10 m away, where rays are 0.87 m apart, the car is met wherever it stands
    assert refute(car(10.0, 0.0), own(), FREE, 0.6) == [True]


def test_the_own_errors_count_as_those_of_the_box() -> None:
    """At 40 m, 0.02 rad are 0.8 m."""
    box = car(40.0, 0.0)
    assert refute(box, replace(own(), position_sigma=0.6), FREE) == [False]
    assert refute(box, replace(own(), yaw_sigma=0.02), FREE) == [False]
    assert refute(box, replace(own(), position_sigma=0.2, yaw_sigma=0.0035), FREE) == [True]


def test_what_hides_nothing_and_what_is_far_or_the_own_car_is_not_refuted() -> None:
    box = car(20.0, 0.0)
    for kind, length, is_refuted in ((0, 4.5, True), (1, 0.6, False), (2, 1.8, False), (3, 2.0, False), (3, 4.0, True)):
        one = replace(box, kind=np.array([kind], dtype=np.uint8), length=np.array([length]))
        assert refute(one, own(), FREE) == [is_refuted], (kind, length)
    assert refute(car(61.0, 0.0), own(), FREE) == [False]
    assert refute(car(3.0, 0.0), own(), FREE) == [False]
    assert refute(box, own(), np.zeros(0)) == [False]


@settings(max_examples=60, deadline=None)
@given(
    st.floats(-50, 50), st.floats(-50, 50), st.floats(-4, 4), st.floats(0, 6.2), st.floats(0.0, 0.45), st.floats(0, 6.2)
)
def test_a_real_box_is_never_refuted(
    x: float, y: float, yaw: float, heading: float, error_m: float, direction: float
) -> None:
    """The view of a car that stands there ends on it: rays by a slower, other way (points along them)."""
    state = replace(own(), yaw=heading)
    free = np.array([measure_ray((x, y, yaw), heading + math.tau / 72 * i) for i in range(72)])
    claim = replace(
        car(x + error_m * math.cos(direction), y + error_m * math.sin(direction)), yaw=np.array([yaw + 0.02])
    )
    assert refute(claim, state, free, 0.3) == [False]  # two standard deviations are more than the error


def measure_ray(box: tuple[float, float, float], angle: float) -> float:
    """Length [m] of a ray from the origin to a box of 4.5 m x 1.9 m, by points 2 cm apart."""
    along = np.arange(0.0, 80.0, 0.02)
    dx, dy = along * math.cos(angle) - box[0], along * math.sin(angle) - box[1]
    cos, sin = math.cos(box[2]), math.sin(box[2])
    inside = (np.abs(cos * dx + sin * dy) <= 2.25) & (np.abs(cos * dy - sin * dx) <= 0.95)
    return float(along[int(inside.argmax())]) if inside.any() else 80.0


def test_a_detection_near_a_box_supports_it() -> None:
    assert find_near(car(20.0, 0.0), car(22.4, 0.0)).tolist() == [True]
    assert find_near(car(20.0, 0.0), car(22.6, 0.0)).tolist() == [False]
    assert find_near(car(20.0, 0.0), Objects.empty()).tolist() == [False]


def tell(history: ClaimHistory, ticks: Sequence[int], *claims: Claim, supported: Sequence[str] = ()) -> list[int]:
    return [tick for tick in ticks if history.update(tick, claims, supported)]


def test_a_claim_is_a_lie_after_a_second() -> None:
    history, claim = ClaimHistory(), Claim("t1", 5.0, 0.0)
    assert tell(history, range(0, 61, 4), claim) == [20, 44]  # it begins anew after 20


def test_false_positives_of_half_a_second_and_supported_claims_are_no_lies() -> None:
    history = ClaimHistory()
    for epoch in range(20):
        at = Claim(f"t{epoch}", 10.0 * (epoch % 7), 0.0)
        assert tell(history, range(10 * epoch, 10 * epoch + 10, 2), at) == []
    claim = Claim("t1", 5.0, 0.0)
    assert tell(history, range(300, 316, 4), claim) == []
    assert tell(history, [316], supported=["t1"]) == []
    assert tell(history, range(320, 336, 4), claim) == []


def test_a_phantom_that_changes_its_name_is_found_by_its_place() -> None:
    history = ClaimHistory()
    lies = [tick for tick in range(0, 24, 4) if history.update(tick, [Claim(f"t{tick}", 5.0, 0.1 * tick)], ())]
    assert lies == [20]


def test_trust_falls_at_once_and_recovers_in_time() -> None:
    trust = SenderTrust()
    assert trust.get(LIAR, 0) == 1.0 and trust.is_believed(LIAR, 0)
    trust.record_contradiction(LIAR, 100)
    assert trust.get(LIAR, 100) == pytest.approx(0.2) and not trust.is_believed(LIAR, 399)
    assert trust.is_believed(LIAR, 401) and trust.get(LIAR, 10_000) == 1.0  # 0.02 a second
    trust.record_contradiction(LIAR, 400)
    trust.record_contradiction(LIAR, 401)
    assert trust.get(LIAR, 401) == 0.0 and trust.get(HONEST, 401) == 1.0


def mcm_at(tick: int, x: float, plan_speed: float, speed: float = 8.0) -> Mcm:
    points = np.column_stack((x + plan_speed * 0.2 * np.arange(1.0, 11.0), np.zeros(10)))
    return Mcm(ReferencePose(x, 0.0, 0.0, tick), speed, Intention.KEEP, Direction.FOLLOW, 0.2, points)


def find_contradictions(positions: Sequence[tuple[int, float, float]]) -> list[int]:
    """Ticks of MCMs (tick, x, planned speed) that contradict earlier ones."""
    motion = AnnouncedMotion()
    return [tick for tick, x, plan_speed in positions if motion.add(mcm_at(tick, x, plan_speed))]


def test_a_promise_to_stand_is_broken_by_driving_on() -> None:
    assert find_contradictions([(tick, 8.0 * tick * DT, 8.0) for tick in range(0, 100, 4)]) == []
    # the first is due after 20 ticks; eight in a row are broken from tick 20 to 52
    assert find_contradictions([(tick, 8.0 * tick * DT, 0.0) for tick in range(0, 70, 4)])[0] == 52


def push(mcm: Mcm, y: float) -> Mcm:
    """An MCM of a car that is at y beside its plan."""
    return replace(mcm, pose=replace(mcm.pose, y=y))


def test_a_car_that_is_pushed_aside_and_plans_along_its_path_breaks_no_promise() -> None:
    """At 8 m/s until tick 40, where it is pushed 6 m aside and stands; its plans begin on its path beside it."""
    motion = AnnouncedMotion()
    for tick in range(0, 200, 4):
        x = 8.0 * min(tick, 40) * DT
        mcm = mcm_at(tick, x, 8.0) if tick < 40 else push(mcm_at(tick, x, 2.0, 0.0), 6.0)
        assert not motion.add(mcm), tick


@pytest.mark.parametrize("away", [(0.0, 8.0), (8.0, 0.0)])
def test_a_plan_that_begins_elsewhere_is_a_broken_promise(away: tuple[float, float]) -> None:
    """The car stands; from tick 40 on it announces to drive 8 m beside or before itself, off its line."""
    motion, found = AnnouncedMotion(), list[int]()
    for tick in range(0, 100, 4):
        mcm = mcm_at(tick, 0.0, 0.0, 0.0)
        if tick >= 40:
            mcm = replace(mcm, planned=mcm_at(tick, 0.05 * (tick - 40), 2.0).planned + away)
        found += [tick] * motion.add(mcm)
    assert found[0] == 72


def test_a_sudden_stop_breaks_no_promise() -> None:
    """At 8 m/s, with 6 m/s2 from tick 42 on, which no announcement before it says."""
    drive: list[tuple[int, float, float]] = []
    for tick in range(0, 120, 4):
        braking_s = min(max(0.0, (tick - 42) * DT), 8.0 / 6.0)
        x = 8.0 * min(tick, 42) * DT + 8.0 * braking_s - 3.0 * braking_s * braking_s
        drive.append((tick, x, 8.0 - 6.0 * braking_s if tick > 42 else 8.0))
    assert find_contradictions([(tick, x, speed) for tick, x, speed in drive if tick <= 60]) == []


def test_a_jump_is_a_contradiction_and_a_gap_in_time_is_not() -> None:
    motion = AnnouncedMotion()
    cam = Cam(ReferencePose(0.0, 0.0, 0.0, 0), 8.0, 0.0, 0.0, 4.5, 1.9)
    assert not motion.add(cam)
    assert not motion.add(replace(cam, pose=replace(cam.pose, x=5.7, tick=2)))  # 0.8 m and 5 m
    assert motion.add(replace(cam, pose=replace(cam.pose, x=-20.0, tick=4)))
    assert not motion.add(replace(cam, pose=replace(cam.pose, x=90.0, tick=40)))


def cpm_of(tick: int, objects: Objects) -> Cpm:
    return Cpm(ReferencePose(60.0, 30.0, 0.0, tick), 80.0, objects, np.zeros(len(objects), dtype=np.uint8))


def test_a_phantom_in_plain_view_costs_its_sender_the_trust_in_its_reports_and_nobody_else() -> None:
    """Its place and plans are believed further on: its car drives there all the same."""
    guard, fallen_at = MessageGuard(IDEAL), {}
    for tick in range(80):
        place = sent(Cam(ReferencePose(60.0, 30.0, 0.0, tick), 0.0, 0.0, 0.0, 4.5, 1.9), LIAR)
        liar, honest = sent(cpm_of(tick, car(25.0, 0.0)), LIAR), sent(cpm_of(tick, car(0.0, 70.0)), HONEST)
        observation = look(tick, np.minimum(FREE, 60.0), None, liar, place, honest)
        screened, fallen, notes = guard.screen(observation)
        fallen_at |= dict.fromkeys(fallen, tick)
        assert [note.text for note in notes] == [f"{one}: it reports what is not there" for one in fallen]
        if LIAR in fallen_at:
            assert screened.messages == (place, honest)
        else:
            assert screened is observation
    assert fallen_at == {LIAR: 20} and guard.is_believed(LIAR)


def test_a_person_is_not_refuted_by_a_view_that_goes_on_behind() -> None:
    """Views go past people: they are no higher than what hides nothing."""
    guard = MessageGuard(IDEAL)
    for tick in range(80):
        person = replace(car(25.0, 0.0), kind=np.array([Kind.PEDESTRIAN], dtype=np.uint8))
        observation = look(tick, FREE, None, sent(cpm_of(tick, person), HONEST))
        assert guard.screen(observation) == (observation, frozenset(), ())


@pytest.mark.parametrize("hidden", [True, False])
def test_a_car_that_is_hidden_or_detected_is_believed(hidden: bool) -> None:
    free, detected = (np.full(72, 10.0), None) if hidden else (np.full(72, 22.75), car(25.2, 0.1))
    guard = MessageGuard(IDEAL)
    for tick in range(80):
        observation = look(tick, free, detected, sent(cpm_of(tick, car(25.0, 0.0)), HONEST))
        assert guard.screen(observation) == (observation, frozenset(), ())


def test_a_sender_whose_own_place_is_seen_to_be_empty_is_not_believed() -> None:
    guard, fallen, screened = MessageGuard(IDEAL), frozenset[str](), look(0)
    for tick in range(40):
        cam = Cam(ReferencePose(20.0, 0.0, 0.0, tick), 0.0, 0.0, 0.0, 4.5, 1.9)
        screened, now, _ = guard.screen(look(tick, FREE, None, sent(cam, LIAR)))
        fallen |= now
    assert fallen == {LIAR} and not guard.is_believed(LIAR) and screened.messages == ()


def test_unreadable_messages_are_left_to_the_tracker() -> None:
    observation = look(0, FREE, None, Message("cpm", b"nonsense", LIAR, 0), Message("hello", b"", LIAR, 0))
    assert MessageGuard(IDEAL).screen(observation) == (observation, frozenset(), ())


def make_seeing(x: float, y: float, detected: Objects | None = None, free_m: Float = FREE) -> Witness:
    return Witness(ReferencePose(x, y, 0.0, 0), free_m, Objects.empty() if detected is None else detected)


def test_two_witnesses_refute_and_one_detection_supports() -> None:
    box, blind = car(20.0, 0.0), np.full(72, 5.0)
    one, two = make_seeing(0.0, 0.0), make_seeing(20.0, 30.0)  # from behind, and from the side
    for witnesses, is_refuted in (
        ({"a": one}, False),
        ({"a": one, "b": two}, True),
        ({"a": one, "b": make_seeing(20.0, 30.0, free_m=blind)}, False),
        ({"a": one, "b": two, "c": make_seeing(50.0, 0.0, car(21.0, 0.5), blind)}, False),
        ({LIAR: one, "b": two}, False),  # the sender is no witness of its own claim
    ):
        assert find_refuted_by_others(box, np.zeros(1), [LIAR], witnesses).tolist() == [is_refuted]


def test_a_witness_that_drives_has_seen_what_it_tells_a_little_before() -> None:
    cam = Cam(ReferencePose(10.0, 0.0, 0.0, 9), 8.0, 0.0, 0.0, 4.5, 1.9)
    cpm = replace(cpm_of(9, car(50.0, 0.0)), pose=cam.pose)
    assert make_witness(cpm, cam, cpm.objects, 2).pose.x == pytest.approx(9.2)  # 2 ticks at 8 m/s
    assert make_witness(cpm, None, cpm.objects, 2).pose == cpm.pose


@pytest.mark.parametrize(("accusers", "fallen"), [(1, frozenset[str]()), (2, frozenset({LIAR}))])
def test_who_cannot_see_believes_two_witnesses_and_not_one(accusers: int, fallen: frozenset[str]) -> None:
    guard, found = MessageGuard(IDEAL), frozenset[str]()
    for tick in range(40):
        liar = sent(cpm_of(tick, car(25.0, 0.0)), LIAR)
        others = [
            sent(
                Cpm(ReferencePose(25.0, 20.0 + n, 0.0, tick), 80.0, replace(Objects.empty(), free_m=FREE), AGES),
                f"b{n}",
            )
            for n in range(accusers)
        ]
        found |= guard.screen(look(tick, np.full(72, 10.0), None, liar, *others))[1]
    assert found == fallen
