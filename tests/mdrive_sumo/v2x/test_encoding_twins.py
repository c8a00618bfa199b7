"""The compiled encoding of messages against the Python text."""

import math
import sys
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from testing.message_samples import HEADER, PLACE, cams, cpm_with, cpms, mcm_with, mcms, poses
from testing.twins import compare_twins, get_compiled

from mdrive_sumo.core import compiled
from mdrive_sumo.v2x.content import MAX_OBJECTS, MAX_SECTORS, Cam, Cpm, Mcm, MessageError, ReferencePose
from mdrive_sumo.v2x.encoding import CpmParts, decode_pose, encode_cpm, encode_header, parse_cpm
from mdrive_sumo.v2x.mcm_encoding import encode_mcm, parse_mcm

ANY = st.one_of(
    st.floats(allow_nan=True), st.sampled_from((0.005, -0.005, 327.67, -327.675, 1e300, math.inf, -0.0, math.pi))
)
LOCAL = st.lists(st.tuples(st.floats(-328.0, 328.0), st.floats(-328.0, 328.0)), max_size=5)


@given(pose=st.one_of(poses, st.builds(ReferencePose, ANY, ANY, ANY, st.integers(-1, 2**32), ANY, ANY)))
def test_headers(pose: ReferencePose) -> None:
    head = compare_twins("v2x_encoding_encode_header", 4, pose)
    if isinstance(head, bytes):
        compare_twins("v2x_encoding_decode_pose", head)


@given(cam=st.one_of(cams(), st.builds(Cam, st.just(PLACE), ANY, ANY, ANY, ANY, ANY, ANY)))
def test_cams(cam: Cam) -> None:
    compare_twins("v2x_encoding_encode_high_frequency", cam, cam.pose)


@given(pose=poses, local=LOCAL, data=st.binary(max_size=21))
def test_points(pose: ReferencePose, local: list[tuple[float, float]], data: bytes) -> None:
    compare_twins("v2x_encoding_encode_points", pose, np.array(local).reshape(-1, 2) + np.array((pose.x, pose.y)))
    compare_twins("v2x_encoding_decode_points", pose, data)


@given(x=ANY, y=ANY, yaw=ANY, own=ANY)
def test_points_that_mean_nothing(x: float, y: float, yaw: float, own: float) -> None:
    pose = ReferencePose(own, 0.0, yaw, 0)
    compare_twins("v2x_encoding_encode_points", pose, np.array(((x, y),)))
    compare_twins("v2x_encoding_encode_points", pose, np.array((x, y, x)))
    compare_twins("v2x_encoding_decode_points", pose, b"\x00\x80\xff\x7f")


@given(cpm=cpms())
def test_cpms(cpm: Cpm) -> None:
    pose = decode_pose(encode_header(5, cpm.pose))
    parts = compare_twins("v2x_encoding_parse_cpm", compare_twins("v2x_encoding_encode_cpm", cpm, pose))
    compare_twins("v2x_encoding_build_cpm", pose, parts)


@given(
    body=st.one_of(st.binary(max_size=60), st.integers(0, 3).map(lambda n: bytes((9, 0, n, 2, 1)) + bytes(21 * n + 2)))
)
def test_bodies(body: bytes) -> None:
    parts = compare_twins("v2x_encoding_parse_cpm", body)
    if isinstance(parts, CpmParts):
        compare_twins("v2x_encoding_build_cpm", PLACE, parts)


@pytest.mark.slow
@given(mcm=mcms())
def test_mcms(mcm: Mcm) -> None:
    pose = decode_pose(encode_header(6, mcm.pose))
    compare_twins("v2x_mcm_encoding_parse_mcm", compare_twins("v2x_mcm_encoding_encode_mcm", mcm, pose))


@given(mcm=mcms(), data=st.data())
def test_damaged_mcms(mcm: Mcm, data: st.DataObject) -> None:
    body = bytearray(encode_mcm(mcm, mcm.pose))
    for _ in range(data.draw(st.integers(0, 3))):
        body[data.draw(st.integers(0, len(body) - 1))] = data.draw(st.integers(0, 255))
    compare_twins("v2x_mcm_encoding_parse_mcm", bytes(body[: data.draw(st.integers(0, len(body)))]))
    compare_twins("v2x_mcm_encoding_parse_mcm", bytes(body))
    compare_twins("v2x_mcm_encoding_parse_mcm", bytes(body) + b"\0")


@given(speed=ANY, interval_s=st.one_of(ANY, st.floats(0.0, 3.0)), until=st.integers(-5, 2**32), x=ANY)
def test_numbers_of_mcms_that_mean_nothing(speed: float, interval_s: float, until: int, x: float) -> None:
    points = np.array(((5.0, x),))
    mcm = mcm_with(speed=speed, interval_s=interval_s, until_tick=until, planned=points)
    compare_twins("v2x_mcm_encoding_encode_mcm", mcm, PLACE)
    compare_twins("v2x_mcm_encoding_encode_mcm", mcm_with(speed=speed, until_tick=until), PLACE)


@pytest.mark.parametrize(
    ("parts", "why"),
    [
        ({"interval_s": 0.0}, r"expected interval_s in \[0.01, 2.55\] s, found 0.0"),
        ({"until_tick": 2**32}, "expected an until_tick up to 4294967295, found 4294967296"),
        ({"planned": np.zeros((101, 2))}, "expected at most 100 points, found 101"),
        ({"desired": np.zeros((4, 3))}, r"expected points \(K, 2\), found 12 numbers"),
        ({"requests": {"a": 9}}, "9 is not a valid Intention"),
        ({"requests": {"a": "x"}}, "'x' is not a valid Intention"),
        ({"group": tuple(f"car_{i}" for i in range(33))}, "expected at most 32 names of 1 to 80 bytes, found 33"),
        ({"answers": {"": True}}, "expected at most 32 names of 1 to 80 bytes, found 1"),
        ({"answers": {"ä" * 41: True}}, "expected at most 32 names of 1 to 80 bytes, found 1"),
        ({"group": ("\ud800",)}, "surrogates not allowed"),
    ],
)
def test_both_refuse_mcms_in_the_same_words(parts: dict[str, object], why: str) -> None:
    mcm = mcm_with(**parts)
    compare_twins("v2x_mcm_encoding_encode_mcm", mcm, PLACE)
    for encode in (encode_mcm, compiled.REFERENCES["v2x_mcm_encoding_encode_mcm"]):
        with pytest.raises(ValueError, match=why):
            encode(mcm, PLACE)


def test_a_name_is_in_a_group_once_and_any_number_of_an_intention_will_do() -> None:
    mcm = mcm_with(group=("b", "a", "b"), requests={"a": 2.0}, answers={"a": 7})
    assert list(parse_mcm(compare_twins("v2x_mcm_encoding_encode_mcm", mcm, PLACE)).group) == ["b", "a"]


@pytest.mark.parametrize(
    "body",
    [
        b"12345678",
        bytes((0, 0, 4, 0, 20, 0, 0, 0, 0)),
        *(
            bytes((0, 0, 1, 1, 20, 0, 0, 0, 0, *rest))
            for rest in (
                (101,),  # too many points,
                (),  # and bytes that are missing
                (2, 1, 1, 1, 1, 1, 1, 1),
                (0, 0, 1, 3),
                (0, 0, 1, 3, 0, 97, 98),
                (0, 0, 1, 3, 4, 97, 98, 99),  # no such intention
                (0, 0, 0, 0, 0, 0, 0),  # more than there should be
            )
        ),
    ],
)
def test_both_name_what_is_wrong_with_a_body(body: bytes) -> None:
    told: list[str] = []
    for parse in (parse_mcm, compiled.REFERENCES["v2x_mcm_encoding_parse_mcm"]):
        with pytest.raises(MessageError) as caught:
            parse(body)
        told.append(str(caught.value))
    assert told[0] == told[1]


NUMBERS = ("x", "y", "yaw", "speed", "length", "width", "free_m")


@given(name=st.sampled_from(NUMBERS), value=ANY, range_m=ANY, sigma=ANY, age=st.integers(-300, 300))
def test_numbers_that_mean_nothing(name: str, value: float, range_m: float, sigma: float, age: int) -> None:
    cpm = cpm_with(2, 2, **{name: np.array((5.0, value))})
    compare_twins("v2x_encoding_encode_cpm", cpm, PLACE)
    compare_twins("v2x_encoding_encode_cpm", replace(cpm, range_m=range_m), PLACE)
    compare_twins("v2x_encoding_encode_cpm", replace(cpm_with(1), sigmas=np.array(((sigma, value, 0.1),))), PLACE)
    compare_twins("v2x_encoding_encode_cpm", replace(cpm_with(1, 1), age=np.array((age,))), PLACE)


@pytest.mark.parametrize(
    ("cpm", "why"),
    [
        (cpm_with(MAX_OBJECTS + 1), "expected at most 255 objects and 255 sectors, found 256 and 0"),
        (cpm_with(1, MAX_SECTORS + 1), "expected at most 255 objects and 255 sectors, found 1 and 256"),
        (cpm_with(ids=("t0000002A",)), "expected track names such as t0000002a, found 't0000002A'"),
        (cpm_with(ids=("t0000_02a",)), "expected track names"),
        (cpm_with(ids=("t00000002a",)), "expected track names"),
        (cpm_with(ids=("tä00002a",)), "expected track names"),
        (cpm_with(ids=("\ud800",)), "expected track names"),
        (cpm_with(kind=np.array([4], np.uint8)), "expected kinds from 0 to 3"),
        (replace(cpm_with(2), age=np.zeros(1, np.uint8)), "expected an age for each of 2 objects, found 1"),
        (replace(cpm_with(2), sigmas=np.zeros((1, 3))), r"expected finite .* of shape \(2, 3\), found 3 numbers"),
        (replace(cpm_with(1), range_m=-math.inf), "expected finite numbers, found -inf"),
    ],
)
def test_both_say_the_same_of_what_no_message_can_carry(cpm: Cpm, why: str) -> None:
    compare_twins("v2x_encoding_encode_cpm", cpm, PLACE)
    with pytest.raises(MessageError, match=why):
        encode_cpm(cpm, PLACE)


def test_yaws_whose_difference_is_infinite_are_refused() -> None:
    pose, cpm = replace(PLACE, yaw=-6e304), cpm_with(yaw=np.array([sys.float_info.max]))
    compare_twins("v2x_encoding_encode_cpm", cpm, pose)
    with pytest.raises(MessageError, match="expected finite numbers"):
        get_compiled("v2x_encoding_encode_cpm")(cpm, pose)


@pytest.mark.parametrize(("body", "why"), [(b"1234", "at least 5 .* found 4"), (bytes(6), "expected 5 .* found 6")])
def test_sizes_that_no_message_has(body: bytes, why: str) -> None:
    compare_twins("v2x_encoding_parse_cpm", body)
    with pytest.raises(MessageError, match=why):
        parse_cpm(body)


@pytest.mark.parametrize("arguments", [(b"short",), (bytes(HEADER - 1),)])
def test_poses_are_not_read_beyond_the_bytes(arguments: tuple[Any, ...]) -> None:
    with pytest.raises(ValueError, match=f"expected at least {HEADER} bytes, found {len(arguments[0])}"):
        get_compiled("v2x_encoding_decode_pose")(*arguments)


@pytest.mark.parametrize("tick", [-1, 2**32])
def test_ticks_that_do_not_fit_are_refused(tick: int) -> None:
    with pytest.raises(MessageError, match=f"expected a tick from 0 to 4294967295, found {tick}"):
        encode_header(4, replace(PLACE, tick=tick))
