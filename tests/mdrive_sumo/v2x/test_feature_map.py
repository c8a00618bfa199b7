"""Maps of features as packets: what comes back, what each bit says, what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from testing.message_samples import HEADER, PLACE, features, grids

from mdrive_sumo.contract import Message
from mdrive_sumo.v2x.attacks.attack_settings import parse_attack
from mdrive_sumo.v2x.attacks.falsifier import Falsifier
from mdrive_sumo.v2x.attacks.replayed_messages import restamp
from mdrive_sumo.v2x.channel import Channel
from mdrive_sumo.v2x.comm_settings import PRESETS, CommSettings, LinkSettings
from mdrive_sumo.v2x.content import MAX_PACKET_BYTES
from mdrive_sumo.v2x.feature_map import assemble_feature_map, encode_feature_map
from mdrive_sumo.v2x.messages import (
    FEATURE,
    Feature,
    FeatureGrid,
    MessageError,
    ReferencePose,
    decode,
    encode,
    find_problem,
)
from mdrive_sumo.v2x.radio.air_interface import split_message
from mdrive_sumo.v2x.rice_code import (
    MAX_PARAMETER,
    choose_parameter,
    count_rice_bits,
    decode_rice,
    encode_rice,
    read_unary,
)

GRID = FeatureGrid("bev-a", 3, 1.6, 64, 64, 16)
POSE = ReferencePose(10.0, -20.0, 0.5, 40)


def draw_map(seed: int, grid: FeatureGrid = GRID, share: float = 0.1) -> tuple[np.ndarray, np.ndarray]:
    """Features above 0 where something is, and a confidence that says where."""
    rng = np.random.default_rng(seed)
    seen = rng.random((grid.rows, grid.columns)) < share
    values = np.maximum(rng.normal(0.0, 2.0, (grid.channels, grid.rows, grid.columns)), 0.0) * seen
    return values.astype(np.float32), (seen * rng.uniform(0.1, 1.0, seen.shape)).astype(np.float32)


def read(messages: tuple[Message, ...]) -> list[Feature]:
    contents = [decode(message) for message in messages]
    assert all(isinstance(content, Feature) for content in contents)
    return [content for content in contents if isinstance(content, Feature)]


@given(st.lists(st.integers(0, 5000), max_size=60), st.integers(0, MAX_PARAMETER))
def test_rice_codes_come_back_and_have_the_counted_bits(numbers: list[int], parameter: int) -> None:
    values = np.array(numbers, dtype=np.int64)
    low, unary = encode_rice(values, parameter)
    assert decode_rice(low, read_unary(unary), parameter).tolist() == numbers
    assert len(low) + len(unary) == int(count_rice_bits(values, parameter).sum())
    best = int(count_rice_bits(values, choose_parameter(values)).sum())
    assert best <= len(low) + len(unary)


def test_bits_of_a_rice_code_by_hand() -> None:
    low, unary = encode_rice(np.array([0, 5, 9]), 2)  # 0 = 0 + 00, 5 = 1 + 01, 9 = 2 + 01
    assert "".join(map(str, low)) == "000101" and "".join(map(str, unary)) == "101001"


@given(features())
def test_a_feature_message_comes_back_exactly(feature: Feature) -> None:
    message = encode(feature)
    assert find_problem(message) is None and len(split_message(len(message.payload), 0)) == 1
    found = decode(message)
    assert isinstance(found, Feature) and found.grid == feature.grid
    for name in ("steps", "tiles", "confidence", "places", "levels"):
        assert np.array_equal(getattr(found, name), getattr(feature, name)), name
    assert encode(found).payload == message.payload


def test_bytes_of_a_feature_message_are_the_documented_ones() -> None:
    grid = FeatureGrid("ab", 258, 0.5, 2, 4, 2, 2)
    one = Feature(
        PLACE, grid, np.array((1.0, 0.5)), np.array((1,)), np.array((1.0,)), np.array((3, 5)), np.array((2, -1))
    )
    body = encode(one).payload[HEADER:]
    assert body[:26] == b"ab" + bytes(14) + bytes((2, 1, 0xF4, 1, 2, 0, 4, 0, 2, 2))
    # 1 tile, signs, cells 1 and 2, 2 values; gaps of the cells 1, 0, of the places 1 and 3 among them 1, 1, sizes 1, 0
    assert body[26:35] == bytes((1, 1, 2, 0, 2, 0, 0, 0, 0))
    assert body[35:42] == bytes((0, 0x3C, 0, 0x38, 1, 0, 255))
    assert body[42:] == bytes((0b01_011_010, 0b1_011_0000))  # signs + -, then 01 1, 01 01, 01 1 in unary
    assert len(body) == 44


@given(st.integers(0, 999), st.integers(2, 8), st.booleans(), grids)
def test_a_map_comes_back_within_half_a_step(seed: int, bits: int, has_signs: bool, grid: FeatureGrid) -> None:
    values, confidence = draw_map(seed, grid, 0.4)
    values = values * np.random.default_rng(seed).choice((1, -1), values.shape) if has_signs else values
    messages = encode_feature_map(values, confidence, POSE, grid, bits=bits)
    assert bool(messages) == bool(confidence.any())
    if not messages:
        return
    received = assemble_feature_map(read(messages), grid)
    assert ((confidence > 0) <= received.arrived).all()
    most = 2 ** (bits - 1) - 1 if (values < 0).any() else 2**bits - 1
    step = np.abs(values).max(axis=(1, 2)) / most * 1.001 + 1e-6  # steps are half precision, rounded up
    assert (np.abs(received.features - values).max(axis=(1, 2)) <= step / 2 + 1e-5).all()


@pytest.mark.slow
@given(st.integers(0, 99), st.data())
def test_any_packets_in_any_order_give_their_tiles_and_no_others(seed: int, data: st.DataObject) -> None:
    values, confidence = draw_map(seed)
    sent = read(encode_feature_map(values, confidence, POSE, GRID))
    assert len(sent) >= 2
    whole = assemble_feature_map(sent, GRID)
    kept = [sent[i] for i in data.draw(st.lists(st.sampled_from(range(len(sent))), min_size=1, unique=True))]
    part, again = assemble_feature_map(kept, GRID), assemble_feature_map([*kept[::-1], kept[0]], GRID)
    for name in ("features", "arrived", "confidence"):
        assert np.array_equal(getattr(part, name), getattr(again, name))
    assert np.array_equal(part.features, whole.features * part.arrived)
    assert int(part.arrived.sum()) == 64 * sum(len(one.tiles) for one in kept)


def test_the_most_confident_tiles_go_first_and_within_the_budget() -> None:
    values, confidence = draw_map(3)
    whole = encode_feature_map(values, confidence, POSE, GRID)
    stated = np.concatenate([one.confidence for one in read(whole)])
    assert (np.diff(stated) <= 0).all() and max(len(one.payload) for one in whole) <= MAX_PACKET_BYTES
    for budget in (0, 100, 1000, 3000, 10**6):
        some = encode_feature_map(values, confidence, POSE, GRID, budget_bytes=budget)
        assert sum(len(one.payload) for one in some) <= budget
        tiles = [tile for one in read(some) for tile in one.tiles.tolist()]
        assert tiles == [tile for one in read(whole) for tile in one.tiles.tolist()][: len(tiles)]
    assert encode_feature_map(values, confidence, POSE, GRID, most_messages=2) == whole[:2] != whole
    few = read(encode_feature_map(values, confidence, POSE, GRID, least_confidence=0.8))
    assert min(one.confidence.min() for one in few) >= 0.8 - 1 / 510
    assert 0 < sum(len(one.tiles) for one in few) < len(stated)


def test_a_dense_map_of_noise_is_sent_whole_in_coarser_steps_where_needed() -> None:
    grid = replace(GRID, tile_cells=16)
    values = np.random.default_rng(0).uniform(0.0, 1.0, (16, 64, 64))
    messages = encode_feature_map(values, np.ones((64, 64)), POSE, grid, bits=8)
    assert len(messages) == 16 and all(len(one.payload) <= MAX_PACKET_BYTES for one in messages)
    received = assemble_feature_map(read(messages), grid)
    assert received.arrived.all() and np.abs(received.features - values).max() < 0.26


def damage(seed: int) -> Message:
    rng = np.random.default_rng(seed)
    payload = bytearray(encode_feature_map(*draw_map(1), POSE, GRID)[0].payload)
    for at in rng.integers(0, len(payload), rng.integers(1, 4)):
        payload[at] = int(rng.integers(0, 256))
    return Message(FEATURE, bytes(payload))


@given(st.integers(0, 10**6))
def test_damaged_packets_are_read_as_something_valid_or_refused_in_a_sentence(seed: int) -> None:
    message = damage(seed)
    try:
        content = decode(message)
    except MessageError as error:
        assert find_problem(message) and "\n" not in str(error)
        return
    assert find_problem(message) is None and isinstance(content, Feature)
    assemble_feature_map([content], content.grid)


def patch(at: int, *values: int) -> Message:
    whole = encode_feature_map(*draw_map(1), POSE, GRID)[0]
    at += HEADER
    return Message(FEATURE, whole.payload[:at] + bytes(values) + whole.payload[at + len(values) :])


@pytest.mark.parametrize(
    ("message", "why"),
    [
        (patch(0, 0x41), "expected a grid whose name has 1 to 16 of"),
        (patch(18, 0, 0), "cell_m in mm from 1 to 65535, found 0"),
        (patch(18, 255, 255), "within 327.67 m of the sender"),
        (patch(20, 63), "expected a grid with rows that are a multiple of 8"),
        (patch(24, 0), "channels from 1 to 64, found 0"),
        (patch(25, 17), "tile_cells from 1 to 16, found 17"),
        (patch(26, 255), "expected .* bytes or more|expected each tile once|expected .* numbers"),
        (patch(27, 2), "0 or 1 for signs"),
        (patch(30, 255, 255), "expected [0-9]+ numbers in [0-9]+ bytes"),
        (patch(32, 16), "parameters up to 15"),
        (patch(35, 0, 0x7C), "expected steps from 0 to 65504"),
        (patch(35 + 32, 255, 255), "expected each tile once, from 0 to 63"),
        (Message(FEATURE, patch(0).payload + bytes(1398)), "expected at most 1398 bytes"),
        (Message(FEATURE, patch(0).payload[: HEADER + 20]), "expected at least 35 bytes after the header, found 20"),
    ],
)
def test_a_byte_that_means_nothing_is_named(message: Message, why: str) -> None:
    with pytest.raises(MessageError, match=why):
        decode(message)


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"features": np.zeros((16, 64, 63))}, r"expected features \(16, 64, 64\)"),
        ({"features": np.full((16, 64, 64), np.nan)}, "expected finite features"),
        ({"features": np.full((16, 64, 64), 1e6)}, "expected features up to 16000"),
        ({"confidence": np.full((64, 64), 1.5)}, r"a confidence in \[0, 1\]"),
        ({"bits": 9}, "expected 1 to 8 bits"),
        ({"grid": replace(GRID, name="Größe")}, "expected a grid whose name"),
        ({"grid": replace(GRID, cell_m=float("nan"))}, "cell_m in mm from 1 to 65535"),
        ({"grid": replace(GRID, channels=65)}, "channels from 1 to 64"),
        ({"grid": replace(GRID, rows=60)}, "rows that are a multiple of 8"),
    ],
)
def test_maps_that_cannot_be_sent_are_refused_in_a_sentence(change: dict[str, object], why: str) -> None:
    values, confidence = draw_map(1)
    arguments = {"features": values, "confidence": confidence, "pose": POSE, "grid": GRID} | change
    with pytest.raises(MessageError, match=why):
        encode_feature_map(**arguments)  # pyright: ignore[reportArgumentType]


def test_tiles_of_another_grid_version_or_map_are_refused() -> None:
    (one, *_) = read(encode_feature_map(*draw_map(1), POSE, GRID))
    with pytest.raises(MessageError, match=r"expected the grid bev-a version 4 \(.*found bev-a version 3"):
        assemble_feature_map([one], replace(GRID, version=4))
    later = replace(one, pose=replace(POSE, tick=41))
    with pytest.raises(MessageError, match="messages of one map, found poses of ticks 40 and 41"):
        assemble_feature_map([one, later], GRID)
    with pytest.raises(MessageError, match="expected at least one message"):
        assemble_feature_map([], GRID)


def test_few_bytes_do_not_stand_for_many_values() -> None:
    grid = FeatureGrid("wide", 0, 0.1, 160, 160, 64, 16)
    none = np.zeros(0, dtype=np.int64)
    with pytest.raises(MessageError, match="at most 255 tiles and 262144 values in them, found 17 tiles"):
        encode(Feature(PLACE, grid, np.zeros(64), np.arange(17), np.ones(17), none, none))


# ---- the channel and attackers


def send(comm: CommSettings, messages: tuple[Message, ...], ticks: int = 30) -> dict[str, list[Message]]:
    """What b and c receive of a map that a sends in tick 40."""
    channel, inbox = Channel(comm, 1), {"b": list[Message](), "c": list[Message]()}
    positions = {"a": (0.0, 0.0), "b": (30.0, 40.0), "c": (60.0, 0.0)}
    channel.send(40, {"a": messages}, positions)
    for tick in range(41, 41 + ticks):
        for name, arrived in channel.deliver(tick, ("b", "c")).items():
            inbox[name] += arrived
    return inbox


def test_loss_drops_packets_by_receiver_and_budget_the_least_confident() -> None:
    messages = encode_feature_map(*draw_map(5), POSE, GRID, bits=8)
    arrived = send(CommSettings(link=LinkSettings(loss=0.3)), messages)
    counts = {name: len(inbox) for name, inbox in arrived.items()}
    assert all(0 < count < len(messages) for count in counts.values())
    assert [one.payload for one in arrived["b"]] != [one.payload for one in arrived["c"]]
    limited = send(CommSettings(budget_bytes_s=5000.0), messages)["b"]
    assert [one.payload for one in limited] == [one.payload for one in messages[: len(limited)]]
    assert 2 < len(limited) < len(messages)
    assert send(CommSettings(mute=("a/feature",)), messages)["b"] == []
    assert send(PRESETS["off"], messages)["b"] == []


def test_a_pose_error_displaces_the_tiles_of_a_map_alike() -> None:
    messages = encode_feature_map(*draw_map(5), POSE, GRID)
    arrived = send(PRESETS["paper-pose"], messages)
    poses = {name: {one.pose for one in read(tuple(inbox))} for name, inbox in arrived.items()}
    assert [len(found) for found in poses.values()] == [1, 1] and poses["b"] != poses["c"]
    assert POSE not in poses["b"]
    assert assemble_feature_map(read(tuple(arrived["b"])), GRID).arrived.any()


def test_attackers_hide_shift_and_repeat_features() -> None:
    messages = encode_feature_map(*draw_map(5), POSE, GRID)

    def falsify(text: str, tick: int) -> list[Feature]:
        attack = parse_attack(text)
        assert attack is not None
        return read(Falsifier(attack, {"a": "a"}, 1).falsify(tick, {"a": messages}, {}, ("a",))["a"])

    assert [len(one.tiles) for one in falsify("hide", 40)] == [0] * len(messages)
    shifted = falsify("shift", 100)
    assert len({one.pose for one in shifted}) == 1 and shifted[0].pose != POSE
    later = decode(restamp(messages[0], 60))
    assert isinstance(later, Feature) and later.pose.tick == 100
    assert restamp(messages[0], 60).payload[HEADER:] == messages[0].payload[HEADER:]
