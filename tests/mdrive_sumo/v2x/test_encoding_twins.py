"""The compiled encoding of messages against the Python text."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from testing.message_samples import HEADER, PLACE, cams, cpm_with, cpms, poses
from testing.twins import compare_twins

from mdrive_sumo.v2x.content import MAX_OBJECTS, MAX_SECTORS, Cam, Cpm, MessageError, ReferencePose
from mdrive_sumo.v2x.encoding import CpmParts, decode_pose, encode_cpm, encode_header, parse_cpm

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
    compare_twins("v2x_encoding_encode_cam", cam, cam.pose)


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


@pytest.mark.parametrize(("body", "why"), [(b"1234", "at least 5 .* found 4"), (bytes(6), "expected 5 .* found 6")])
def test_sizes_that_no_message_has(body: bytes, why: str) -> None:
    compare_twins("v2x_encoding_parse_cpm", body)
    with pytest.raises(MessageError, match=why):
        parse_cpm(body)


@pytest.mark.parametrize("arguments", [(b"short",), (bytes(HEADER - 1),)])
def test_poses_are_not_read_beyond_the_bytes(arguments: tuple[Any, ...]) -> None:
    with pytest.raises(ValueError, match=f"expected at least {HEADER} bytes, found {len(arguments[0])}"):
        decode_pose(*arguments)


@pytest.mark.parametrize("tick", [-1, 2**32])
def test_ticks_that_do_not_fit_are_refused(tick: int) -> None:
    with pytest.raises(MessageError, match=f"expected a tick from 0 to 4294967295, found {tick}"):
        encode_header(4, replace(PLACE, tick=tick))
