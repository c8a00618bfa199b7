"""Recordings for tests of the V2XPnP writers."""

import math
from typing import Any

import numpy as np
from hypothesis import strategies as st

from mdrive_sumo.core.geometry import Float, wrap_angles
from real2sim.hd_map import HdMap
from real2sim.recording import ObjectCategory, ObserverView, RecordedTrack, Recording

FRAMES = 60


HALF_MM = 0.00051


def track(
    name: str, x: Any, y: Any, yaw: Any = 0.0, category: ObjectCategory = ObjectCategory.CAR, **more: Any
) -> RecordedTrack:
    size = {ObjectCategory.PEDESTRIAN: (0.6, 0.5), ObjectCategory.TRUCK: (12.0, 3.0)}.get(category, (4.5, 1.9))
    columns = [np.broadcast_to(np.asarray(v, dtype=np.float64), FRAMES).copy() for v in (x, y, yaw, *size)]
    return RecordedTrack(name, category, np.ones(FRAMES, dtype=np.bool_), *columns, **more)


def scene(
    *tracks: RecordedTrack, cavs: tuple[str, ...] = (), stations: tuple[tuple[float, float, float], ...] = ()
) -> Recording:
    posts = [ObserverView(f"post {i}", (), np.tile(pose, (FRAMES, 1)), True) for i, pose in enumerate(stations)]
    return Recording("scene", "test", 0.1, FRAMES, (ObserverView("log", tracks), *posts), HdMap(), cavs)


def same_tracks(written: RecordedTrack, found: RecordedTrack) -> None:
    assert (found.id, found.category, found.parked) == (written.id, written.category, written.parked)
    np.testing.assert_array_equal(found.valid, written.valid)
    there = written.valid
    np.testing.assert_allclose(found.xy, np.where(there[:, None], written.xy, np.nan), atol=HALF_MM)
    turn = wrap_angles(found.yaw - written.yaw)[there]
    np.testing.assert_allclose(turn, 0.0, atol=math.radians(HALF_MM))
    np.testing.assert_allclose(found.length[there], written.length[there], atol=2 * HALF_MM)
    np.testing.assert_allclose(found.width[there], written.width[there], atol=2 * HALF_MM)


@st.composite
def tracks(draw: st.DrawFn, name: str, frames: int) -> RecordedTrack:
    valid = np.array(draw(st.lists(st.booleans(), min_size=frames, max_size=frames).filter(any)))

    def column(low: float, high: float) -> Float:
        drawn = draw(st.lists(st.floats(low, high), min_size=frames, max_size=frames))
        return np.where(valid, np.array(drawn), np.nan)

    return RecordedTrack(
        name,
        draw(st.sampled_from(list(ObjectCategory))),
        valid,
        *(column(-5000, 5000), column(-5000, 5000), column(-math.pi, math.pi), column(0.1, 30), column(0.1, 5)),
        parked=draw(st.booleans()),
    )


def by_id(view: ObserverView) -> dict[str, RecordedTrack]:
    return {track.id: track for track in view.tracks}
