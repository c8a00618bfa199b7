"""CAM, CPM, MCM and text: what is said comes back within a step, and no bytes break the reader."""

import math
import string

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mdrive_sumo.contract import Message, Objects
from mdrive_sumo.v2x import messages
from mdrive_sumo.v2x.messages import (
    CAM,
    CPM,
    MAX_NAMES,
    MAX_OBJECTS,
    MAX_PAYLOAD_BYTES,
    MAX_POINTS,
    MAX_SECTORS,
    MAX_TEXT_BYTES,
    MCM,
    REACH_M,
    TEXT,
    TYPES,
    Cam,
    Content,
    Cpm,
    Direction,
    Intention,
    Mcm,
    MessageError,
    ReferencePose,
    decode,
    displace_message,
    encode,
    find_problem,
    format_track_name,
    parse_track_name,
)

STEP_M = 0.005 + 1e-6
"""Half a step of 1 cm."""
HEADER, OBJECT = 15, 18


def within(most: float) -> st.SearchStrategy[float]:
    return st.floats(-most, most)


poses = st.builds(ReferencePose, within(20_000.0), within(20_000.0), within(10.0), st.integers(0, 2**32 - 1))
names = st.dictionaries(st.text(string.ascii_letters + "äß_-", min_size=1, max_size=20), st.booleans(), max_size=4)


@st.composite
def cams(draw: st.DrawFn) -> Cam:
    return Cam(
        draw(poses), draw(within(90)), draw(within(90)), draw(within(9)), draw(st.floats(0, 30)), draw(st.floats(0, 5))
    )


def objects_around(pose: ReferencePose, count: int, sectors: int, range_m: float, seed: int) -> Objects:
    rng = np.random.default_rng(seed)
    return Objects(
        ids=tuple(format_track_name(int(number)) for number in rng.integers(0, 2**32, count)),
        kind=rng.integers(0, 4, count).astype(np.uint8),
        x=pose.x + rng.uniform(-200, 200, count),
        y=pose.y + rng.uniform(-200, 200, count),
        yaw=rng.uniform(-4, 4, count),
        speed=rng.uniform(-20, 60, count),
        length=rng.uniform(0, 20, count),
        width=rng.uniform(0, 4, count),
        free_m=rng.uniform(0, range_m, sectors),
    )


@st.composite
def cpms(draw: st.DrawFn) -> Cpm:
    pose, range_m = draw(poses), draw(st.integers(1, 2000)) / 10
    count, sectors = draw(st.integers(0, 12)), draw(st.integers(0, 80))
    objects = objects_around(pose, count, sectors, range_m, draw(st.integers(0, 999)))
    return Cpm(pose, range_m, objects, np.arange(count, dtype=np.uint8), roadside=draw(st.booleans()))


@st.composite
def mcms(draw: st.DrawFn) -> Mcm:
    pose = draw(poses)
    rng = np.random.default_rng(draw(st.integers(0, 999)))
    here = np.array((pose.x, pose.y))
    planned, desired = (here + rng.uniform(-200, 200, (draw(st.integers(0, 25)), 2)) for _ in range(2))
    return Mcm(
        pose,
        speed=draw(within(90)),
        intention=draw(st.sampled_from(Intention)),
        direction=draw(st.sampled_from(Direction)),
        interval_s=draw(st.integers(1, 255)) / 100,
        planned=planned,
        desired=desired,
        requests={name: Intention(int(yes)) for name, yes in draw(names).items()},
        answers=draw(names),
        group=tuple(sorted(draw(names))),
        until_tick=draw(st.integers(0, 2**32 - 1)),
    )


texts = st.text(max_size=200)
contents = st.one_of(cams(), cpms(), mcms(), texts)


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


@given(texts)
def test_a_text_comes_back(text: str) -> None:
    assert decode(encode(text)) == text


@given(contents)
def test_what_was_read_is_written_the_same_again(content: Content) -> None:
    once = encode(content)
    assert encode(decode(once)).payload == once.payload


def documented_size(content: Content) -> int:
    """As in docs/v2x.md and the docstring of the module."""
    if isinstance(content, str):
        return len(content.encode())
    if isinstance(content, Cam):
        return HEADER + 10
    if isinstance(content, Cpm):
        return HEADER + 5 + OBJECT * len(content.objects.ids) + len(content.objects.free_m)
    named = [*content.requests, *content.answers, *content.group]
    points = len(content.planned) + len(content.desired)
    return HEADER + 14 + 4 * points + sum(2 + len(name.encode()) for name in named)


@given(contents)
def test_sizes_are_the_documented_ones(content: Content) -> None:
    assert len(encode(content).payload) == documented_size(content)


def test_bytes_of_a_cam_are_the_documented_ones() -> None:
    cam = Cam(
        ReferencePose(12.34, -5.0, math.pi / 2, 7), speed=10.0, acceleration=-1.5, yaw_rate=0.25, length=4.9, width=2.0
    )
    header = "01d20400000cfeffff282307000000"  # kind, 1234 cm, -500 cm, 9000 centidegrees, tick 7
    body = "e8036afffa00ea01c800"  # 1000 cm/s, -150 cm/s2, 250 mrad/s, 490 cm, 200 cm
    assert encode(cam).payload.hex() == header + body


def test_bytes_of_an_object_are_the_documented_ones() -> None:
    one = Objects(
        ("t0000002a",), np.array([1], np.uint8), np.array([13.0]), np.array([20.0]), np.array([math.pi]),
        np.array([-0.5]), np.array([0.5]), np.array([0.4]), np.array([50.0, 100.0]),
    )  # fmt: skip
    cpm = Cpm(ReferencePose(10.0, 20.0, math.pi / 2, 0), 100.0, one, np.array([3], np.uint8))
    body = encode(cpm).payload[HEADER:].hex()
    head = "e803010200"  # 1000 dm, one object, two sectors, no road-side unit
    # 3 m to the east of a sender who looks north is 3 m to its right: x = 0, y = -300 cm; yaw 90 degrees to its left.
    row = "2a000000010000d4fe2823ceff3200280003"
    assert body == head + row + "7fff"


@pytest.mark.parametrize("kind", [*TYPES, "own"])
@given(payload=st.binary(max_size=120))
def test_random_bytes_raise_nothing_but_message_error(kind: str, payload: bytes) -> None:
    reads(Message(kind, payload))


@given(contents, st.data())
def test_damaged_messages_raise_nothing_but_message_error(content: Content, data: st.DataObject) -> None:
    whole = encode(content)
    payload = bytearray(whole.payload)
    for at in data.draw(st.lists(st.integers(0, max(8 * len(payload) - 1, 0)), max_size=6 if payload else 0)):
        payload[at // 8] ^= 1 << at % 8
    reads(Message(whole.type, bytes(payload)))
    reads(Message(whole.type, bytes(payload[: data.draw(st.integers(0, len(payload)))])))
    reads(Message(whole.type, bytes(payload) + b"\0"))


def reads(message: Message) -> bool:
    """Whether `decode` reads it; `find_problem` must say the same, and what is read must be usable and movable."""
    try:
        decode(message)
    except MessageError as error:
        assert message.type not in TYPES or find_problem(message)
        assert "\n" not in str(error) and str(error)
        return False
    assert find_problem(message) is None
    decode(displace_message(message, 1.0, -2.0, 0.5))
    return True


@given(st.one_of(cams(), cpms(), mcms()))
def test_a_truncated_or_longer_message_is_not_read(content: Content) -> None:
    whole = encode(content)
    assert reads(whole)
    assert not reads(Message(whole.type, whole.payload[:-1]))
    assert not reads(Message(whole.type, whole.payload + b"\0"))


def test_types_of_agents_own_need_only_fit() -> None:
    assert find_problem(Message("own", b"\xff" * MAX_PAYLOAD_BYTES)) is None
    assert find_problem(Message("own", b"\xff" * (MAX_PAYLOAD_BYTES + 1))) is not None
    with pytest.raises(MessageError, match="expected a type of"):
        decode(Message("own", b""))


PLACE = ReferencePose(100.0, 50.0, 0.3, 9)


def mcm_with(**parts: object) -> Mcm:
    values: dict[str, object] = {"speed": 1.0, "interval_s": 0.2, "planned": np.zeros((0, 2))}
    return Mcm(PLACE, intention=Intention.KEEP, direction=Direction.LEFT, **(values | parts))  # pyright: ignore[reportArgumentType]


def cpm_with(count: int = 1, sectors: int = 0, **parts: object) -> Cpm:
    values: dict[str, object] = {name: np.zeros(count) for name in ("yaw", "speed", "length", "width")}
    values |= {"ids": (format_track_name(1),) * count, "kind": np.zeros(count, np.uint8), "free_m": np.zeros(sectors)}
    values |= {"x": np.full(count, PLACE.x), "y": np.full(count, PLACE.y)}
    return Cpm(PLACE, 50.0, Objects(**(values | parts)), np.zeros(count, np.uint8))  # pyright: ignore[reportArgumentType]


def patched(content: Content, at: int, *values: int) -> Message:
    """The message with other bytes from there on."""
    whole = encode(content)
    return Message(whole.type, whole.payload[:at] + bytes(values) + whole.payload[at + len(values) :])


EMPTY_MCM = mcm_with()
NAMING_MCM = mcm_with(requests={"ab": Intention.STOP, "cd": Intention.STOP})
BODY = HEADER + 9
"""Where an MCM's lists begin: two of points, three of names."""


@pytest.mark.parametrize(
    "damaged",
    [
        patched(Cam(PLACE, 1.0, 0.0, 0.0, 4.0, 2.0), 0, 2),  # another kind
        patched(EMPTY_MCM, 0, 1),
        patched(cpm_with(), HEADER + 2, 2),  # more objects than there are
        patched(cpm_with(), HEADER + 4, 2),  # neither car nor road-side unit
        patched(cpm_with(), HEADER + 5 + 4, 4),  # no kind of object
        patched(EMPTY_MCM, HEADER + 2, 4),  # no intention
        patched(EMPTY_MCM, HEADER + 3, 6),  # no direction
        patched(EMPTY_MCM, HEADER + 4, 0),  # no time between points
        patched(EMPTY_MCM, BODY, MAX_POINTS + 1),
        patched(NAMING_MCM, BODY + 2, 3),  # more names than there are
        patched(NAMING_MCM, BODY + 4, 4),  # asked to do what is no intention
        patched(NAMING_MCM, BODY + 9, *b"ab"),  # the same name twice
        patched(NAMING_MCM, BODY + 5, 0xFF),  # no UTF-8
        Message(TEXT, b"x" * (MAX_TEXT_BYTES + 1)),
        Message(TEXT, b"\xff"),
        Message(CAM, b""),
        Message(CPM, encode(cpm_with()).payload[:HEADER]),
        Message(MCM, encode(EMPTY_MCM).payload[:HEADER]),
    ],
)
def test_a_byte_that_means_nothing_makes_a_message_unreadable(damaged: Message) -> None:
    assert not reads(damaged)


def test_only_the_patched_bytes_were_wrong() -> None:
    assert all(reads(encode(content)) for content in (EMPTY_MCM, NAMING_MCM, cpm_with()))
    assert NAMING_MCM.requests == getattr(decode(patched(NAMING_MCM, BODY + 9, *b"cd")), "requests", None)


FAR = np.array([[PLACE.x + 400.0, PLACE.y]])


@pytest.mark.parametrize(
    ("content", "why"),
    [
        (Cam(ReferencePose(math.nan, 0.0, 0.0, 0), 0.0, 0.0, 0.0, 4.0, 2.0), "finite"),
        (Cam(ReferencePose(0.0, 0.0, math.inf, 0), 0.0, 0.0, 0.0, 4.0, 2.0), "cam"),
        (Cam(ReferencePose(0.0, 0.0, 0.0, -1), 0.0, 0.0, 0.0, 4.0, 2.0), "cam"),
        (Cam(PLACE, math.inf, 0.0, 0.0, 4.0, 2.0), "finite"),
        (cpm_with(MAX_OBJECTS + 1), "at most 255 objects"),
        (cpm_with(1, MAX_SECTORS + 1), "255 sectors"),
        (cpm_with(x=FAR[:, 0]), "within 327.67 m"),
        (cpm_with(x=np.array([math.nan])), "within 327.67 m"),
        (cpm_with(yaw=np.array([math.nan])), "finite"),
        (cpm_with(ids=("cav_1",)), "track names"),
        (cpm_with(kind=np.array([4], np.uint8)), "kinds"),
        (cpm_with(0, free_m=np.array([math.nan])), "finite"),
        (cpm_with(y=np.zeros(2)), "cpm"),
        (mcm_with(planned=FAR), "within 327.67 m"),
        (mcm_with(planned=np.full((MAX_POINTS + 1, 2), 100.0)), "at most 100 points"),
        (mcm_with(interval_s=0.0), "interval_s"),
        (mcm_with(interval_s=2.6), "interval_s"),
        (mcm_with(until_tick=2**32), "mcm"),
        (mcm_with(group=tuple(f"car_{i}" for i in range(MAX_NAMES + 1))), "at most 32 names"),
        (mcm_with(answers={"": True}), "1 to 80 bytes"),
        (mcm_with(requests={"x": 9}), "mcm"),
        ("x" * (MAX_TEXT_BYTES + 1), "8192 bytes"),
        ("\ud800", "text"),
    ],
)
def test_what_no_message_can_carry_is_refused(content: Content, why: str) -> None:
    with pytest.raises(MessageError, match=why):
        encode(content)


def test_numbers_too_large_for_their_field_are_clamped() -> None:
    read = decode(encode(Cam(ReferencePose(1e9, 0.0, 0.0, 0), -1e6, 1e6, 100.0, 1e6, -1.0)))
    assert isinstance(read, Cam)
    assert (read.speed, read.acceleration, read.yaw_rate) == (-327.67, 327.67, 32.767)
    assert (read.length, read.width, read.pose.x) == (655.35, 0.0, (2**31 - 1) / 100)


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


@given(st.integers(0, 2**32 - 1))
def test_track_names_and_numbers_are_inverses(number: int) -> None:
    assert parse_track_name(format_track_name(number)) == number


@pytest.mark.parametrize("name", ["", "t", "t2a", "T0000002a", "t0000002A", "t-000002a", "t100000000", "x0000002a"])
def test_other_names_are_no_track_names(name: str) -> None:
    with pytest.raises(MessageError):
        parse_track_name(name)


def test_everything_public_is_importable_from_messages() -> None:
    assert [name for name in messages.__all__ if not hasattr(messages, name)] == []
    assert {CAM, CPM, MCM, TEXT} == set(TYPES) and REACH_M == 327.67
