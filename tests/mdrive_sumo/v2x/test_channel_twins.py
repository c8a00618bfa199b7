"""The compiled parts of the channel against the Python text."""

import math
from types import MappingProxyType

import pytest
from hypothesis import given
from hypothesis import strategies as st
from testing.twins import compare_twins, get_compiled

from mdrive_sumo.contract import Message
from mdrive_sumo.core import compiled
from mdrive_sumo.core.seeding import draw_uniforms
from mdrive_sumo.v2x.channel import Delivery, DeliveryStatus, draw_lucks, hand_over, measure_distances, select_reached

NAMES = st.lists(st.text("abä_0", min_size=1, max_size=5), min_size=1, max_size=6, unique=True)
NUMBERS = st.one_of(st.floats(-1e3, 1e3), st.sampled_from((0.0, -0.0, math.inf, math.nan, 150.0)))


@given(names=NAMES, numbers=st.lists(NUMBERS, min_size=12, max_size=12))
def test_distances(names: list[str], numbers: list[float]) -> None:
    positions = {name: (numbers[2 * i], numbers[2 * i + 1]) for i, name in enumerate(names)}
    distances = compare_twins("v2x_channel_measure_distances", positions, names[0], sorted(names))
    assert list(distances) == sorted(names[1:])


@given(seed=st.integers(0, 2**31 - 1), names=NAMES, n=st.integers(0, 40), block=st.integers(0, 10**6))
def test_random_numbers(seed: int, names: list[str], n: int, block: int) -> None:
    rows = compare_twins("v2x_channel_draw_lucks", seed, names[0], n, tuple(names[1:]), block)
    for i, receiver in enumerate(names[1:]):
        assert tuple(row[i] for row in rows) == draw_uniforms(seed, "loss", names[0], receiver, n, block)


@given(
    distances=st.lists(st.sampled_from((0.0, 150.0, 150.1, math.inf, math.nan)), max_size=6),
    loss=st.sampled_from((0.0, 0.5, 1.0)),
    lucks=st.lists(st.sampled_from((0.0, 0.4, 0.5, 0.6)), min_size=6, max_size=6),
)
def test_receivers_that_are_reached(distances: list[float], loss: float, lucks: list[float]) -> None:
    others, told = {f"cav_{i}": distance for i, distance in enumerate(distances)}, []
    for function in (compiled.REFERENCES["v2x_channel_select_reached"], select_reached):
        deliveries: dict[str, Delivery] = {}
        reached = function(7, others, 150.0, loss, tuple(lucks), deliveries)
        told.append((reached, list(deliveries.items())))
    assert told[0] == told[1]


@given(names=NAMES, active=st.integers(0, 6))
def test_messages_reach_inboxes(names: list[str], active: int) -> None:
    arrived, gone = Delivery(DeliveryStatus.DELIVERED, 8), Delivery(DeliveryStatus.GONE, 8)
    messages, told = [Message("text", name.encode()) for name in names], []
    for function in (compiled.REFERENCES["v2x_channel_hand_over"], hand_over):
        deliveries: dict[str, Delivery] = {}
        inboxes: dict[str, list[Message]] = {name: [] for name in names[:active]}
        function(names, messages, inboxes, deliveries, arrived, gone)
        told.append((inboxes, list(deliveries.items())))
    assert told[0] == told[1]
    assert list(told[0][0].values()) == [[message] for message in messages[:active]]
    compare_twins("v2x_channel_hand_over", names, messages, {}, {}, arrived, gone)


@given(payloads=st.lists(st.binary(max_size=3), max_size=3), tick=st.integers(0, 2**40))
def test_signed_messages(payloads: list[bytes], tick: int) -> None:
    said = tuple(Message("text", payload, "another", 9) for payload in payloads)
    assert all(one.sender == "me" for one in compare_twins("v2x_channel_sign_messages", said, "me", tick))


def test_by_hand() -> None:
    deliveries: dict[str, Delivery] = {}
    reached = select_reached(3, {"a": 9.0, "b": 200.0, "c": 9.0}, 150.0, 0.5, (0.5, 0.9, 0.4), deliveries)
    assert reached == ["a"]
    assert deliveries == {"b": Delivery(DeliveryStatus.OUT_OF_RANGE, 3), "c": Delivery(DeliveryStatus.LOST, 3)}


def test_what_is_missing_is_an_error() -> None:
    with pytest.raises(KeyError, match="b"):
        measure_distances({"a": (0.0, 0.0)}, "a", ["a", "b"])
    with pytest.raises(IndexError):
        select_reached(3, {"a": 9.0}, 150.0, 0.5, (), {})
    assert draw_lucks(1, "a", 0, (), 0) == ((),) * 8


def test_distances_that_cannot_be_listed_are_an_error() -> None:
    others = MappingProxyType({"a": 9.0})
    with pytest.raises(TypeError, match="expected a dict"):
        get_compiled("v2x_channel_select_reached")(3, others, 150.0, 0.0, (), {})
