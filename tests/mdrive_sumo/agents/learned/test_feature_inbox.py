"""Which maps of others a detector gets: newest, near, not too old, of its own grid; whatever strangers send."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mdrive_sumo.agents.learned.feature_inbox import MAX_MAP_PACKETS, FeatureInbox
from mdrive_sumo.agents.learned.fusion_spec import GRID_LAYERS, MAX_AGE_TICKS
from mdrive_sumo.agents.learned.point_grid import GRID_SIZE, Cells
from mdrive_sumo.agents.learned.shared_grids import (
    MAX_RECEIVED_FEATURE,
    POINT_GRID,
    encode_points,
    limit_features,
    read_points,
)
from mdrive_sumo.contract import Message, OwnState
from mdrive_sumo.core.state import DT
from mdrive_sumo.perception.late_fusion import OPV2V_LIMITS
from mdrive_sumo.v2x.content import Feature
from mdrive_sumo.v2x.feature_map import encode_feature_map
from mdrive_sumo.v2x.messages import FEATURE, FeatureGrid, ReferencePose, encode

GRID = FeatureGrid("tiny", 7, 1.6, 16, 16, 2)
TILES = 4
OWN = OwnState(10.0, 5.0, math.pi / 2, 3.0, 0.0, 0.0, 0.0)


def send(
    sender: str, tick: int, x: float = 10.0, y: float = 15.0, value: float = 1.0, grid: FeatureGrid = GRID
) -> list[Message]:
    """A map that is `value` everywhere, a packet each tile."""
    shape = grid.channels, grid.rows, grid.columns
    features, confidence = np.full(shape, value, np.float32), np.full(shape[1:], 0.5)
    sent: list[Message] = []
    side = grid.tile_cells
    for i in range(grid.rows // side):
        for j in range(grid.columns // side):
            mask = np.zeros(shape[1:])
            mask[i * side : (i + 1) * side, j * side : (j + 1) * side] = 1.0
            pose = ReferencePose(x, y, 0.0, tick)
            sent += encode_feature_map(features * mask.astype(np.float32), confidence * mask, pose, grid)
    return [replace(message, sender=sender, tick=tick) for message in sent]


def make_inbox(grid: FeatureGrid = GRID) -> FeatureInbox:
    return FeatureInbox(grid, OPV2V_LIMITS)


def test_poses_are_relative_to_the_own_scan_and_ages_in_seconds() -> None:
    inbox = make_inbox()
    assert inbox.receive(send("b", 96)) == ()
    (found,) = inbox.collect(100, OWN)
    assert found.pose == pytest.approx((10.0, 0.0, -math.pi / 2), abs=1e-6)  # 10 m north of a car that looks north
    assert found.age_s == pytest.approx(4 * DT) and found.map.arrived.all()
    assert found.map.features == pytest.approx(np.ones((2, 16, 16)), rel=1e-3)


def test_the_newest_map_that_is_not_newer_than_the_own_scan_counts_with_the_tiles_that_arrived() -> None:
    inbox = make_inbox()
    inbox.receive([*send("b", 96, value=1.0), *send("b", 100, value=2.0)[:3], *send("b", 101, value=3.0)])
    (found,) = inbox.collect(100, OWN)
    assert found.age_s == 0.0 and found.map.features.max() == pytest.approx(2.0, rel=1e-3)
    assert found.map.arrived.sum() == 3 * 64
    (later,) = inbox.collect(104, OWN)
    assert later.map.features.max() == pytest.approx(3.0, rel=1e-3) and later.age_s == pytest.approx(3 * DT)


@pytest.mark.parametrize(("age", "counts"), [(0, True), (MAX_AGE_TICKS, True), (MAX_AGE_TICKS + 1, False)])
def test_older_maps_than_detectors_were_trained_on_are_dropped(age: int, counts: bool) -> None:
    inbox = make_inbox()
    inbox.receive(send("b", 100 - age))
    assert len(inbox.collect(100, OWN)) == counts


def test_the_four_nearest_senders_within_70_m_count() -> None:
    inbox = make_inbox()
    for i, away in enumerate((69.0, 40.0, 71.0, 10.0, 30.0, 20.0)):
        inbox.receive(send(f"s{i}", 100, y=5.0 + away))
    assert [one.sender for one in inbox.collect(100, OWN)] == ["s3", "s5", "s4", "s1"]
    far = make_inbox()
    far.receive(send("b", 100, y=5.0 + 71.0))
    assert far.collect(100, OWN) == []


OTHERS = [
    (replace(GRID, version=8), "expected the grid tiny version 7, found tiny version 8"),
    (replace(GRID, name="else"), "found else version 7"),
    (replace(GRID, channels=3), "found tiny version 7 (3 x 16 x 16 of 1.6 m)"),
    (replace(GRID, rows=8, columns=8), "found tiny version 7 (2 x 8 x 8 of 1.6 m)"),
    (replace(GRID, cell_m=0.8), "found tiny version 7 (2 x 16 x 16 of 0.8 m)"),
    (replace(GRID, tile_cells=4), "found tiny version 7"),
]


@pytest.mark.parametrize(("grid", "words"), OTHERS)
def test_maps_of_another_grid_are_one_sentence_a_sender(grid: FeatureGrid, words: str) -> None:
    inbox = make_inbox()
    notes = inbox.receive([*send("b", 100, grid=grid), *send("c", 100)])
    (note,) = notes
    assert note.kind == "unreadable" and note.text.startswith("feature from b: expected the grid tiny version 7")
    assert words in note.text and "\n" not in note.text
    assert inbox.receive(send("b", 104, grid=grid)) == ()
    assert [one.sender for one in inbox.collect(104, OWN)] == ["c"]


@given(st.binary(max_size=300), st.booleans())
def test_random_bytes_are_a_note_and_nothing_else(data: bytes, has_header: bool) -> None:
    head = send("b", 100)[0].payload[:40] if has_header else b""
    inbox = make_inbox()
    (note,) = inbox.receive((Message(FEATURE, head + data, "b", 100),))
    assert note.kind == "unreadable" and inbox.collect(100, OWN) == []


@pytest.mark.parametrize("sign", [1, -1])
def test_well_formed_noise_stays_within_what_an_encoder_answers(sign: int) -> None:
    count = GRID.tile_values
    loud = Feature(
        ReferencePose(10.0, 15.0, 0.0, 100), GRID, np.full(2, 65504.0), np.arange(1), np.ones(1), np.arange(count),
        np.full(count, sign * 255),
    )  # fmt: skip
    inbox = make_inbox()
    assert inbox.receive((replace(encode(loud), sender="b", tick=100),)) == ()
    (found,) = inbox.collect(100, OWN)
    assert abs(found.map.features).max() == pytest.approx(255 * 65504.0)
    limited = limit_features(found.map.features)
    assert limited.min() == 0.0 and limited.max() == (MAX_RECEIVED_FEATURE if sign > 0 else 0.0)


def test_a_sender_that_repeats_itself_and_invents_poses_takes_no_lasting_room() -> None:
    inbox = make_inbox()
    packet = send("b", 100)[0]
    inbox.receive([packet] * (3 * MAX_MAP_PACKETS))
    inbox.receive([one for i in range(50) for one in send("b", 99, x=10.0 + 0.01 * i)[:1]])
    assert len(inbox._packets["b"]) == 51 and max(map(len, inbox._packets["b"].values())) == MAX_MAP_PACKETS
    assert len(inbox.collect(100, OWN)) == 1
    assert inbox.collect(200, OWN) == [] and inbox._packets == {}


def draw_cells(seed: int, most: int) -> Cells:
    random = np.random.default_rng(seed)
    index = np.sort(random.choice(GRID_SIZE, 6000, replace=False)).astype(np.uint32)
    return index * 256 + random.integers(1, most + 1, len(index)).astype(np.uint32)


@pytest.mark.parametrize("most", [1, 2, 3, 20, 200, 255])
def test_points_arrive_as_they_were_sent(most: int) -> None:
    cells = draw_cells(most, most)
    messages = encode_points(cells, ReferencePose(10.0, 15.0, 0.0, 100))
    inbox = make_inbox(POINT_GRID)
    assert inbox.receive(replace(message, sender="b") for message in messages) == ()
    (found,) = inbox.collect(100, OWN)
    assert read_points(found.map).tolist() == cells.tolist()
    assert POINT_GRID.channels == GRID_LAYERS


def test_a_scan_without_points_is_not_sent() -> None:
    assert encode_points(np.zeros(0, np.uint32), ReferencePose(0.0, 0.0, 0.0, 0)) == ()
