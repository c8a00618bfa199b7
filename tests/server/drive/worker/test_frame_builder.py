"""Rows, names and messages of frames as pages get them."""

from dataclasses import replace

import numpy as np
import pytest
from testing.worlds import straight_road

from mdrive_sumo.contract import Message, Objects
from mdrive_sumo.core.state import Actors, EgoState, Frame, Kind
from mdrive_sumo.v2x.messages import (
    Cam,
    Cpm,
    Denm,
    Direction,
    EventCause,
    Feature,
    FeatureGrid,
    Intention,
    Mcm,
    ReferencePose,
    encode,
    format_track_name,
)
from server.drive.protocol import ROW
from server.drive.worker.frame_builder import FrameBuilder, describe_messages
from server.drive.worker.motion import MotionCache

ORIGIN = (10.0, -5.0)


def make_frame(tick: int, *ids: str, speed: float = 10.0, signals: dict[str, str] | None = None) -> Frame:
    column = np.arange(len(ids), dtype=np.float64) * 20.0
    flat = np.zeros(len(ids))
    size = flat + 4.5, flat + 1.8
    moved = column + 30.0 + tick * speed * 0.05
    kinds = np.full(len(ids), Kind.VEHICLE, dtype=np.uint8)
    actors = Actors(ids, kinds, moved, flat, flat, flat + speed, *size)
    return Frame(tick, {"0": EgoState(12.0 + tick, -4.0, 0.5, 20.0)}, actors, signals or {})


def test_rows_are_relative_to_the_origin_and_numbers_stay() -> None:
    frames = FrameBuilder(straight_road(), ORIGIN)
    frames.add(make_frame(0, "a", "b"))
    frames.add(make_frame(1, "b", "c"))
    assert [row[1] for row in frames.names] == ["0", "a", "b", "c"]
    assert frames.names[1][:6] == [1, "a", int(Kind.VEHICLE), 4.5, 1.8, frames.names[1][5]]
    first, second = (np.frombuffer(rows, ROW) for rows in frames.rows)
    assert first["name"].tolist() == [0, 1, 2]
    assert second["name"].tolist() == [0, 2, 3]
    assert (first["x"][0], first["y"][0]) == (2.0, 1.0)
    assert first["yaw"][0] == pytest.approx(0.5)
    assert first["speed"].tolist() == [20.0, 10.0, 10.0]


def test_who_brakes_shows_lamps() -> None:
    frames = FrameBuilder(straight_road(), ORIGIN)
    for tick in range(8):
        frames.add(make_frame(tick, "a", speed=10.0 - 0.4 * tick))  # 8 m/s2
    last = np.frombuffer(frames.rows[-1], ROW)
    assert last["lamps"].tolist() == [0, 1]
    assert last["flags"].tolist() == [0, 1]


def test_signals_are_kept_when_they_change() -> None:
    frames = FrameBuilder(straight_road(), ORIGIN)
    for tick, letters in enumerate(({"j": "r"}, {"j": "r"}, {"j": "G", "k": "y"})):
        frames.add(make_frame(tick, signals=letters))
    assert frames.signals == [(0, "j", "r"), (2, "j", "G"), (2, "k", "y")]


def test_the_oldest_motions_are_dropped() -> None:
    cache = MotionCache(limit_bytes=10)
    for take in (1, 2, 3):
        cache.add(take, b"1234")
    assert [cache.find(take) for take in (1, 2, 3)] == [None, b"1234", b"1234"]
    cache.add(4, b"x" * 11)
    assert cache.find(4) is None


def test_messages_are_told_once_for_all_receivers() -> None:
    pose = ReferencePose(30.0, 5.0, 0.25, 7)
    seen = Objects((format_track_name(3),), *(np.array([value]) for value in (0, 40.0, 6.0, 0.1, 3.0, 4.5, 1.8)))
    seen = replace(seen, kind=np.array([0], dtype=np.uint8))
    grid = FeatureGrid("bev", 0, 1.0, 16, 16, 1)
    path = np.column_stack((np.arange(6) * 2.0 + 30.0, np.full(6, 5.0)))
    sent = {
        "cam": encode(Cam(pose, 5.0, 0.0, 0.0, 4.9, 2.0)),
        "cpm": encode(Cpm(pose, 60.0, seen, np.array([0], dtype=np.uint8))),
        "mcm": encode(Mcm(pose, 5.0, Intention.KEEP, Direction.FOLLOW, 0.5, path)),
        "denm": encode(Denm(pose, 2, EventCause.COLLISION_RISK, 0, 40.0, 6.0, 5, 1.0, 5.0, 4.9, 2.0)),
        "feature": encode(Feature(pose, grid, np.ones(1), np.arange(2), np.ones(2), *np.ones((2, 1), dtype=np.int64))),
        "text": encode("I wait for 0a1b2c3d"),
        "own": Message("own", b"x"),
        "bad": Message("cam", b"x"),
    }
    arrived = {name: replace(message, sender="1", tick=6) for name, message in sent.items()}
    received = {"0": tuple(arrived.values()), "2": (arrived["cam"],), "3": ()}
    rows = {row["kind"]: row for row in describe_messages(received, {"0a1b2c3d": "2"}, ORIGIN)}
    assert set(rows) == {"cam", "cpm", "mcm", "denm", "feature", "text"}
    assert rows["cam"] == {"from": "1", "to": ["0", "2"], "kind": "cam", "at": [20.0, 10.0], "speed": 5.0, "yaw": 0.25}
    assert rows["text"] == {"from": "1", "to": ["0"], "kind": "text", "text": "I wait for 2"}
    assert rows["cpm"]["objects"] == [pytest.approx([30.0, 11.0, 0.1, 4.5, 1.8, 3.0], abs=0.02)]
    assert rows["denm"]["event"] == pytest.approx([30.0, 11.0], abs=0.02)
    assert (rows["denm"]["cause"], rows["denm"]["valid_ticks"], rows["denm"]["ended"]) == ("collision risk", 20, False)
    assert rows["feature"]["tiles"] == 2
    assert rows["mcm"]["path"] == [[20.0, 10.0], [24.0, 10.0], [28.0, 10.0], [30.0, 10.0]]
