"""MCAP, read back with the library `mcap` and protobuf's own decoder of the schemas inside the file."""

import json
from collections import defaultdict
from typing import Any

import numpy as np
import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from mcap.reader import make_reader
from testing.mixed_run import CAVS, GUEST, SCENARIO

from mdrive_sumo.core.state import TICKS_PER_SECOND
from mdrive_sumo.episode import EpisodeRecord

from .conftest import Export

pytestmark = pytest.mark.slow  # of an episode that is driven

TICK_NS = 10**9 // TICKS_PER_SECOND
Log = dict[str, list[tuple[int, Any]]]
"""Topic -> its messages with their ticks."""


@pytest.fixture(scope="module")
def log(exported: Export) -> Log:
    found: Log = defaultdict(list)
    with (exported("mcap") / f"{SCENARIO}.mcap").open("rb") as file:
        for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages():
            assert schema is not None
            value = json.loads(message.data) if schema.encoding == "jsonschema" else decode(schema, message.data)
            assert message.log_time % TICK_NS == 0
            found[channel.topic].append((message.log_time // TICK_NS, value))
    return found


def decode(schema: Any, data: bytes) -> Any:
    pool = descriptor_pool.DescriptorPool()
    for file in descriptor_pb2.FileDescriptorSet.FromString(schema.data).file:
        pool.Add(file)
    factory: Any = message_factory.MessageFactory(pool)
    return factory.GetPrototype(pool.FindMessageTypeByName(schema.name)).FromString(data)


def yaw_of(turn: Any) -> float:
    return 2 * np.arctan2(turn.z, turn.w)


def test_boxes_lie_where_they_were_recorded(log: Log, record: EpisodeRecord) -> None:
    assert [tick for tick, _ in log["/scene"]] == list(range(record.ticks))
    for tick, update in log["/scene"]:
        assert {entity.id for entity in update.entities} == {record.ids[n] for n in np.flatnonzero(record.valid[tick])}
        for entity in update.entities:
            n, (cube,) = record.ids.index(entity.id), entity.cubes
            assert entity.frame_id == "world"
            assert (cube.size.x, cube.size.y) == (record.length[n], record.width[n])
            assert np.hypot(cube.pose.position.x - record.x[tick, n], cube.pose.position.y - record.y[tick, n]) < 1e-9
            assert cube.pose.position.z == cube.size.z / 2
            assert np.cos(yaw_of(cube.pose.orientation) - record.yaw[tick, n]) > 1 - 1e-12


def test_what_leaves_is_deleted_in_the_tick_after_its_last(log: Log) -> None:
    gone = {(tick, one.id) for tick, update in log["/scene"] for one in update.deletions}
    assert gone == {(round(GUEST[1] * TICKS_PER_SECOND) + 1, "guest")}


def test_every_cav_has_a_frame_and_plots(log: Log, record: EpisodeRecord) -> None:
    for tick, frames in log["/tf"]:
        assert [(one.parent_frame_id, one.child_frame_id) for one in frames.transforms] == [
            ("world", f"cav/{cav}") for cav in CAVS
        ]
        assert frames.transforms[0].translation.x == pytest.approx(record.x[tick, 0])
    assert [row["speed"] for _, row in log["/cav/1"]] == pytest.approx(record.speed[:, 1].tolist())


def test_map_messages_events_and_signals_are_topics(log: Log, record: EpisodeRecord) -> None:
    ((tick, update),) = log["/map"]
    shapes = {entity.id: len(entity.lines) + len(entity.triangles) for entity in update.entities}
    assert tick == 0 and shapes["map/roads"] == 1 and shapes["map/routes"] == len(CAVS) and shapes["map/bounds"] > 10
    assert len(log["/v2x/messages"]) == sum(len(sent.deliveries) for sent in record.messages)
    assert {tick for tick, _ in log["/v2x/messages"]} == {sent.message.tick for sent in record.messages}
    assert {one.name for _, one in log["/events"]} == set(CAVS)
    assert [row["state"] for _, row in log["/signals"]] == [change.state for change in record.signals]


def test_the_file_says_what_it_is_of(exported: Export, record: EpisodeRecord) -> None:
    with (exported("mcap") / f"{SCENARIO}.mcap").open("rb") as file:
        (about,) = make_reader(file).iter_metadata()
    assert about.metadata["digest"] == record.digest
    assert (about.metadata["scenario"], about.metadata["network"]) == (SCENARIO, "main_street")
