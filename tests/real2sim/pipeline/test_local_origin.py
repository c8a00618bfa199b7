"""Logs in coordinates of a map projection are moved to an origin beside them."""

from dataclasses import replace

import numpy as np
import pytest
from testing.map_faults import lane, lanes_map

from real2sim.hd_map import MapArea, StopLine
from real2sim.pipeline.log_conversion import LARGEST_M, move_to_origin
from real2sim.recording import ObjectCategory, ObserverView, RecordedTrack, Recording

SQUARE = np.array(((0.0, 0.0), (10.0, 0.0), (10.0, 10.0)))


def log_at(x: float, y: float) -> Recording:
    """One car on one lane, with everything else that has coordinates."""
    there = np.array((x, y))
    full = np.array((1.0, 1.0, np.nan))
    car = RecordedTrack(
        "a", ObjectCategory.CAR, full == 1.0, (x + np.arange(3)) * full, y * full, 0 * full, 4.5 * full, 1.8 * full
    )
    drawn = lanes_map(lane("w", [(x, y), (x + 100, y)]))
    hd_map = replace(
        drawn,
        crosswalks=(SQUARE + there,),
        stop_lines=(StopLine(SQUARE[:2] + there, ("w",), "stop"),),
        drivable_areas=(MapArea(SQUARE + there, (SQUARE / 2 + there,)),),
    )
    pose = np.array(((x, y, 0.1), (np.nan,) * 3, (x + 2, y, 0.1)))
    return Recording("log", "test", 0.1, 3, (ObserverView("1", (car,), pose),), hd_map)


@pytest.mark.parametrize("place", [(690_000.0, 5_330_000.0), (-2_000_000.0, 3.0), (0.0, LARGEST_M + 1000.0)])
def test_everything_is_moved_by_the_recorded_origin(place: tuple[float, float]) -> None:
    log = log_at(*place)
    moved = move_to_origin(log)
    origin = np.array(moved.origin)
    assert (origin % 1000 == 0).all()
    assert any("coordinates shifted" in note for note in moved.notes)
    local = log_at(*(np.array(place) - origin))
    assert np.abs(local.map.lanes["w"].centre).max() < 1000.0
    (track,), (expected,) = moved.views[0].tracks, local.views[0].tracks
    np.testing.assert_allclose(track.xy, expected.xy)
    np.testing.assert_allclose(moved.views[0].pose, local.views[0].pose)
    for one, other in ((moved.map, local.map),):
        np.testing.assert_allclose(one.lanes["w"].centre, other.lanes["w"].centre)
        np.testing.assert_allclose(one.crosswalks[0], other.crosswalks[0])
        np.testing.assert_allclose(one.stop_lines[0].line, other.stop_lines[0].line)
        np.testing.assert_allclose(one.drivable_areas[0].outline, other.drivable_areas[0].outline)
        np.testing.assert_allclose(one.drivable_areas[0].holes[0], other.drivable_areas[0].holes[0])


def test_a_log_that_fits_stays_where_it_is() -> None:
    log = log_at(5000.0, LARGEST_M - 200.0)
    assert move_to_origin(log) is log
