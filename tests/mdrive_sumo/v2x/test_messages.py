"""CAM, CPM, MCM and text: contents are decoded within a step, sizes and bytes are the documented ones."""

import math
from collections.abc import Mapping

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from testing.message_samples import HEADER, OBJECT, PLACE, cams, contents, cpm_with, cpms, denms, mcms, texts, within

from mdrive_sumo.contract import Message, Objects
from mdrive_sumo.v2x import messages
from mdrive_sumo.v2x.channel import Channel, SentMessage
from mdrive_sumo.v2x.comm_settings import CommSettings
from mdrive_sumo.v2x.message_counts import count_bytes, count_deliveries, count_malformed, is_malformed
from mdrive_sumo.v2x.messages import (
    CAM,
    CPM,
    DENM,
    FEATURE,
    MAX_OBJECTS,
    MAX_PAYLOAD_BYTES,
    MAX_SECTORS,
    MCM,
    MESSAGE_REACH_M,
    TEXT,
    TYPES,
    Cam,
    Content,
    Cpm,
    Denm,
    EventCause,
    Mcm,
    MessageError,
    ReferencePose,
    Termination,
    decode,
    displace_message,
    encode,
    format_track_name,
    parse_track_name,
)

pytestmark = pytest.mark.slow

STEP_M = 0.005 + 1e-6
"""Half a step of 1 cm."""


def same_angle(a: object, b: object) -> bool:
    difference = np.asarray(a) - np.asarray(b)
    return bool((np.abs(np.arctan2(np.sin(difference), np.cos(difference))) < math.radians(0.005) + 1e-9).all())


def assert_same_pose(told: ReferencePose, read: ReferencePose) -> None:
    assert abs(told.x - read.x) < STEP_M and abs(told.y - read.y) < STEP_M
    assert same_angle(told.yaw, read.yaw) and told.tick == read.tick


@given(cams())
def test_a_cam_comes_back_within_a_step(cam: Cam) -> None:
    read = decode(encode(cam))
    assert isinstance(read, Cam)
    assert_same_pose(cam.pose, read.pose)
    told = (cam.speed, cam.acceleration, cam.yaw_rate * 10, cam.length, cam.width)
    assert np.allclose(told, (read.speed, read.acceleration, read.yaw_rate * 10, read.length, read.width), 0, STEP_M)


@given(cpms())
def test_a_cpm_comes_back_within_a_step(cpm: Cpm) -> None:
    read = decode(encode(cpm))
    assert isinstance(read, Cpm)
    assert_same_pose(cpm.pose, read.pose)
    told, found = cpm.objects, read.objects
    assert (found.ids, read.range_m, read.roadside) == (told.ids, cpm.range_m, cpm.roadside)
    assert np.array_equal(found.kind, told.kind) and np.array_equal(read.age, cpm.age)
    # The rounding of the sender's pose is not in the objects: only their own, in the sender's frame.
    assert (np.hypot(found.x - told.x, found.y - told.y) < STEP_M * math.sqrt(2)).all()
    assert same_angle(found.yaw, told.yaw)
    for name in ("speed", "length", "width"):
        assert np.allclose(getattr(found, name), getattr(told, name), 0, STEP_M)


@given(cpms())
def test_free_sight_is_encoded_in_255_steps_and_never_too_far(cpm: Cpm) -> None:
    read = decode(encode(cpm))
    assert isinstance(read, Cpm)
    short = cpm.objects.free_m - read.objects.free_m
    assert (short > -1e-5).all() and (short <= cpm.range_m / 255 + 1e-5).all()


@given(mcms())
def test_an_mcm_comes_back_within_a_step(mcm: Mcm) -> None:
    read = decode(encode(mcm))
    assert isinstance(read, Mcm)
    assert_same_pose(mcm.pose, read.pose)
    assert abs(read.speed - mcm.speed) < STEP_M
    for told, found in ((mcm.planned, read.planned), (mcm.desired, read.desired)):
        assert told.shape == found.shape
        assert (np.linalg.norm(told - found, axis=1) < STEP_M * math.sqrt(2)).all()
    exact = ("intention", "direction", "interval_s", "requests", "answers", "group", "until_tick")
    assert [getattr(read, name) for name in exact] == [getattr(mcm, name) for name in exact]


@given(denms())
def test_a_denm_comes_back_within_a_step(denm: Denm) -> None:
    read = decode(encode(denm))
    assert isinstance(read, Denm)
    assert_same_pose(denm.pose, read.pose)
    exact = ("sequence", "cause", "sub_cause", "detection_tick", "validity_s", "termination")
    assert [getattr(read, name) for name in exact] == [getattr(denm, name) for name in exact]
    assert math.hypot(read.x - denm.x, read.y - denm.y) < STEP_M * math.sqrt(2)
    told, found = ((one.speed, one.length, one.width) for one in (denm, read))
    assert np.allclose(told, found, 0, STEP_M)


def test_bytes_of_a_denm_are_the_documented_ones() -> None:
    pose = ReferencePose(12.34, -5.0, math.pi / 2, 7)
    denm = Denm(
        pose, sequence=258, cause=EventCause.DANGEROUS_SITUATION, sub_cause=1, x=12.34, y=5.0, detection_tick=6,
        validity_s=1.5, speed=10.0, length=4.9, width=2.0, termination=Termination.CANCELLATION,
    )  # fmt: skip
    # sequence, tick 6, cause 99, sub cause 1, cancellation, 1000 cm ahead, validity 15, 1000 cm/s, 490 cm, 200 cm
    assert encode(denm).payload.hex()[2 * HEADER :] == "0201" + "06000000" + "630101" + "e8030000" + "0f00e803ea01c800"


def test_the_event_of_a_denm_moves_with_its_sender() -> None:
    pose = ReferencePose(10.0, 20.0, 0.0, 7)
    denm = Denm(pose, 0, EventCause.COLLISION_RISK, 2, 30.0, 20.0, 7, 1.0, 5.0, 4.9, 2.0)
    moved = decode(displace_message(encode(denm), 1.0, 2.0, math.pi / 2))
    assert isinstance(moved, Denm)
    assert (moved.pose.x, moved.pose.y) == (11.0, 22.0) and (moved.x, moved.y) == pytest.approx((11.0, 42.0), abs=0.02)


def test_the_path_history_of_a_cam_comes_back_within_a_step() -> None:
    path = np.array(((5.0, 20.0), (-5.0, 21.0)))
    read = decode(encode(Cam(ReferencePose(10.0, 20.0, 0.4, 7), 5.0, 0.0, 0.0, 4.9, 2.0, path_history=path)))
    assert isinstance(read, Cam) and read.path_history == pytest.approx(path, abs=0.01)


@given(texts)
def test_a_text_comes_back(text: str) -> None:
    assert decode(encode(text)) == text


@given(contents)
def test_what_was_read_is_written_the_same_again(content: Content) -> None:
    once = encode(content)
    assert encode(decode(once)).payload == once.payload


def documented_size(content: Cam | Cpm | Mcm | Denm | str) -> int:
    """As in docs/v2x.md and the docstring of the module."""
    if isinstance(content, str):
        return len(content.encode())
    if isinstance(content, Cam):
        path = content.path_history
        return HEADER + 11 + (0 if path is None else 1 + 4 * len(path))
    if isinstance(content, Denm):
        return HEADER + 21
    if isinstance(content, Cpm):
        return HEADER + 5 + OBJECT * len(content.objects.ids) + len(content.objects.free_m)
    named = [*content.requests, *content.answers, *content.group]
    points = len(content.planned) + len(content.desired)
    return HEADER + 14 + 4 * points + sum(2 + len(name.encode()) for name in named)


@given(st.one_of(cams(), cpms(), mcms(), denms(), texts))
def test_sizes_are_the_documented_ones(content: Cam | Cpm | Mcm | Denm | str) -> None:
    assert len(encode(content).payload) == documented_size(content)


def test_bytes_of_a_cam_are_the_documented_ones() -> None:
    pose = ReferencePose(12.34, -5.0, math.pi / 2, 7, position_sigma=3.0, yaw_sigma=math.radians(0.2))
    cam = Cam(pose, speed=10.0, acceleration=-1.5, yaw_rate=0.25, length=4.9, width=2.0, speed_sigma=0.1)
    # kind, 1234 cm, -500 cm, 9000 centidegrees, tick 7, standard deviations of 300 cm and 2 tenths of a degree
    header = "04d20400000cfeffff2823070000002c0102"
    body = "e8036afffa00ea01c8000a"  # 1000 cm/s, -150 cm/s2, 250 mrad/s, 490 cm, 200 cm, 10 cm/s
    assert encode(cam).payload.hex() == header + body


def test_bytes_of_an_object_are_the_documented_ones() -> None:
    one = Objects(
        ("t0000002a",), np.array([1], np.uint8), np.array([13.0]), np.array([20.0]), np.array([math.pi]),
        np.array([-0.5]), np.array([0.5]), np.array([0.4]), np.array([50.0, 100.0]),
    )  # fmt: skip
    sigmas = np.array([[0.13, math.radians(1.1), 0.5]])
    cpm = Cpm(ReferencePose(10.0, 20.0, math.pi / 2, 0), 100.0, one, np.array([3], np.uint8), False, sigmas)
    body = encode(cpm).payload[HEADER:].hex()
    head = "e803010200"  # 1000 dm, one object, two sectors, no road-side unit
    # 3 m to the east of a sender that faces north is 3 m to its right: x = 0, y = -300 cm; yaw 90 degrees to its left.
    row = "2a000000010000d4fe2823ceff32002800030d0b32"
    assert body == head + row + "7fff"


def test_numbers_too_large_for_their_field_are_clamped() -> None:
    read = decode(encode(Cam(ReferencePose(9.9e5, 0.0, 0.0, 0), -1e6, 1e6, 100.0, 1e6, -1.0)))
    assert isinstance(read, Cam)
    assert (read.speed, read.acceleration, read.yaw_rate) == (-327.67, 327.67, 32.767)
    assert (read.length, read.width, read.pose.x) == (655.35, 0.0, 9.9e5)
    vague = decode(encode(Cam(ReferencePose(0.0, 0.0, 0.0, 0, 1e4, 1e4), 0.0, 0.0, 0.0, 4.0, 2.0, 1e4)))
    assert isinstance(vague, Cam)
    assert (vague.pose.position_sigma, vague.speed_sigma) == (655.35, 2.55)
    assert vague.pose.yaw_sigma == pytest.approx(math.radians(25.5))


@given(st.one_of(cams(), cpms(), mcms()))
def test_standard_deviations_arrive(content: Content) -> None:
    read = decode(encode(content))
    assert not isinstance(content, str) and not isinstance(read, str)
    assert read.pose.position_sigma == pytest.approx(content.pose.position_sigma, abs=0.0051)
    assert read.pose.yaw_sigma == pytest.approx(content.pose.yaw_sigma, abs=math.radians(0.051))
    if isinstance(content, Cpm) and isinstance(read, Cpm):
        assert (np.abs(read.sigmas - content.sigmas) <= (0.0051, math.radians(0.051), 0.0051)).all()


def test_a_cpm_without_standard_deviations_is_read_with_zeros() -> None:
    read = decode(encode(cpm_with(2)))
    assert isinstance(read, Cpm)
    assert read.sigmas.tolist() == [[0.0] * 3] * 2


def test_a_full_cpm_fits() -> None:
    full = decode(encode(cpm_with(MAX_OBJECTS, MAX_SECTORS)))
    assert isinstance(full, Cpm)
    assert (len(full.objects.ids), len(full.objects.free_m)) == (MAX_OBJECTS, MAX_SECTORS)


def world_points(content: Content) -> np.ndarray:
    """(N, 2) every place that a message tells [m]."""
    assert not isinstance(content, str)
    rows = [np.array([[content.pose.x, content.pose.y]])]
    if isinstance(content, Cpm):
        rows.append(np.column_stack((content.objects.x, content.objects.y)))
    if isinstance(content, Mcm):
        rows += [content.planned, content.desired]
    return np.concatenate(rows)


@given(st.one_of(cams(), cpms(), mcms()), within(5.0), within(5.0), within(1.0))
def test_an_error_of_the_pose_moves_all_places_rigidly(content: Content, dx: float, dy: float, dyaw: float) -> None:
    message = encode(content)
    before, after = decode(message), decode(displace_message(message, dx, dy, dyaw))
    old, new = world_points(before), world_points(after)
    cos, sin = math.cos(dyaw), math.sin(dyaw)
    expected = (old - old[0]) @ np.array([[cos, sin], [-sin, cos]]) + old[0] + (dx, dy)
    # A step of the pose, and half a centidegree of yaw over the distance.
    tolerance = 2 * STEP_M + math.radians(0.005) * np.linalg.norm(old - old[0], axis=1) + 1e-6
    assert (np.linalg.norm(new - expected, axis=1) <= tolerance).all()
    if isinstance(before, Cpm) and isinstance(after, Cpm):
        assert same_angle(after.objects.yaw, before.objects.yaw + dyaw)
        assert np.array_equal(after.objects.speed, before.objects.speed)
        assert np.array_equal(after.objects.free_m, before.objects.free_m)


def test_moving_keeps_sender_tick_and_whatever_has_no_pose() -> None:
    text = Message(TEXT, b"I am at (3, 4)", "a", 5)
    own = Message("own", b"\1\2\3", "a", 5)
    cam = encode(Cam(PLACE, 1.0, 0.0, 0.0, 4.0, 2.0))
    signed = Message(cam.type, cam.payload, "a", 5)
    assert displace_message(text, 1, 1, 1) is text and displace_message(own, 1, 1, 1) is own
    assert (displace_message(signed, 1, 1, 1).sender, displace_message(signed, 1, 1, 1).tick) == ("a", 5)
    assert displace_message(signed, 0, 0, 0) == signed
    vague = encode(Cam(ReferencePose(1.0, 2.0, 0.3, 9, 0.2, 0.01), 1.0, 0.0, 0.0, 4.0, 2.0, 0.1))
    assert displace_message(vague, 1, 1, 1).payload[15:] == vague.payload[15:], "the stated errors stay"


@given(st.integers(0, 2**32 - 1))
def test_track_names_and_numbers_are_inverses(number: int) -> None:
    assert parse_track_name(format_track_name(number)) == number


@pytest.mark.parametrize("name", ["", "t", "t2a", "T0000002a", "t0000002A", "t-000002a", "t100000000", "x0000002a"])
def test_other_names_are_no_track_names(name: str) -> None:
    with pytest.raises(MessageError):
        parse_track_name(name)


def test_everything_public_is_importable_from_messages() -> None:
    assert [name for name in messages.__all__ if not hasattr(messages, name)] == []
    assert {CAM, CPM, MCM, DENM, FEATURE, TEXT} == set(TYPES) and MESSAGE_REACH_M == 327.67


def send(said: Mapping[int, Mapping[str, tuple[Message, ...]]]) -> tuple[SentMessage, ...]:
    channel = Channel(CommSettings(), 1)
    for tick, outgoing in said.items():
        channel.deliver(tick, ("a", "b"))
        channel.send(tick, outgoing, {"a": (0.0, 0.0), "b": (30.0, 40.0)})
    return channel.sent_messages()


def test_malformed_messages_are_counted_by_what_is_wrong_and_their_bytes_are_not() -> None:
    said = {
        tick: {"a": (encode("four"), Message("cam", b"x" * tick), Message("own", b"ok")), "b": ()} for tick in (1, 2)
    }
    sent = send(said)
    assert count_malformed(sent) == {"cam: expected at least 18 bytes": 2}
    assert [is_malformed(one) for one in sent] == [False, True, False] * 2
    assert count_bytes(sent) == count_deliveries(sent)["bytes"] == 12
    assert count_malformed(()) == {}


def test_kinds_of_malformed_messages_are_limited() -> None:
    large = tuple(Message(f"own-{number}", bytes(MAX_PAYLOAD_BYTES + 1)) for number in range(20))
    counts = count_malformed(send({0: {"a": large, "b": ()}}))
    assert len(counts) == 9 and counts["(other)"] == 12


def test_the_most_frequent_kind_comes_first_and_of_equals_the_first_name() -> None:
    large = [Message(name, bytes(MAX_PAYLOAD_BYTES + 1)) for name in ("own-b", "own-a", "own-c", "own-c")]
    counts = count_malformed(send({0: {"a": tuple(large), "b": ()}}))
    assert [kind.partition(":")[0] for kind in counts] == ["own-c", "own-a", "own-b"]
    assert list(counts.values()) == [2, 1, 1]
