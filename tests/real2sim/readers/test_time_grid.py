"""Uneven clocks: tracks are put on a grid of true times, and gaps are listed."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from testing.scenarionet_samples import FRAMES, describe_track, description, read

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float
from real2sim.readers.time_grid import build_time_grid
from real2sim.recording import ObjectCategory, RecordedTrack


def drive(times: Float, speed: float = 8.0) -> RecordedTrack:
    full = np.ones(len(times))
    yaw = np.angle(np.exp(1j * (3.0 + 0.2 * times)))  # passes pi
    return RecordedTrack("a", ObjectCategory.CAR, full > 0, speed * times, 0 * times, yaw, 4.5 * full, 1.8 * full)


def test_a_jump_of_the_clock_is_a_gap_and_not_slower_traffic() -> None:
    times = np.concatenate((np.arange(40) * 0.1, 4.9 + np.arange(40) * 0.1))
    grid = build_time_grid("log", times)
    assert (grid.dt_s, len(grid.times), grid.gaps) == (0.1, 89, ((3.9, 4.9),))
    assert grid.describe()[0].startswith("gaps in the clock of the source: 1 s from 3.9 s to 4.9 s; resampled")
    seen = grid.resample(drive(times))
    assert np.flatnonzero(~seen.valid).tolist() == list(range(40, 49))
    np.testing.assert_allclose(seen.x[seen.valid], 8.0 * grid.times[seen.valid], atol=1e-9)
    assert np.isnan(seen.x[~seen.valid]).all()


def test_an_even_clock_changes_nothing() -> None:
    times = np.arange(50) * 0.1
    track = drive(times)
    grid = build_time_grid("log", times + 17.0)
    assert grid.resample(track) is track
    assert grid.describe() == ()


@given(
    st.lists(st.floats(-0.04, 0.04), min_size=6, max_size=40),
    st.lists(st.integers(1, 8), max_size=3),
)
def test_positions_are_those_of_the_true_times(jitter: list[float], holes: list[int]) -> None:
    """A vehicle at constant speed is on its line whatever the clock does, with a heading that turns evenly."""
    steps = np.full(len(jitter), 0.1)
    for k, missing in enumerate(holes):
        steps[(k + 1) * len(steps) // 4] += 0.1 * missing
    times = np.cumsum(steps) + np.array(jitter)
    times -= times[0]
    grid = build_time_grid("log", times)
    seen = grid.resample(drive(times))
    if grid.is_source:
        return
    rows = np.flatnonzero(seen.valid)
    np.testing.assert_allclose(seen.x[rows], 8.0 * grid.times[rows], atol=8.0 * grid.dt_s / 10 + 1e-9)
    turned = np.angle(np.exp(1j * (seen.yaw[rows] - 3.0 - 0.2 * grid.times[rows])))
    assert np.abs(turned).max(initial=0.0) < 0.2 * grid.dt_s / 10 + 1e-9
    for before, after in grid.gaps:
        inside = (grid.times > before + 0.2 * grid.dt_s) & (grid.times < after - 0.2 * grid.dt_s)
        assert not seen.valid[inside].any()


def test_what_is_absent_at_one_end_of_a_step_is_not_interpolated() -> None:
    times = np.array((0.0, 0.14, 0.2, 0.3, 0.74, 0.8, 0.9))
    track = drive(times)
    valid = track.valid.copy()
    valid[1] = False
    grid = build_time_grid("log", times)
    assert not grid.is_source
    assert not grid.resample(track.replace_columns(valid=valid)).valid[1]


def test_a_clock_beyond_all_bounds_is_refused() -> None:
    with pytest.raises(InputError, match="expected times within 36000 frames"):
        build_time_grid("log", np.array((0.0, 0.1, 0.2, 1e6)))
    with pytest.raises(InputError, match="expected steps of at least 1 ms"):
        build_time_grid("log", np.arange(5) * 1e-6)


def test_a_description_with_a_gap_keeps_the_speed_of_its_tracks(tmp_path: Path) -> None:
    raw = description()
    along = np.column_stack(((0.0, 1.0, 2.0, 8.0, 9.0), np.zeros((FRAMES, 2))))
    raw["tracks"] = {"1": describe_track("VEHICLE", position=along)}
    raw["metadata"]["ts"] = np.array((0.0, 0.1, 0.2, 0.8, 0.9))
    recording = read(tmp_path, raw)
    (track,) = recording.views[0].tracks
    assert (FRAMES, recording.dt_s, recording.frame_count) == (5, 0.1, 10)
    np.testing.assert_allclose(track.x[[0, 1, 2, 8, 9]], [0, 1, 2, 8, 9])
    assert track.valid.sum() == 5
    assert recording.notes[0].startswith("gaps in the clock of the source: 0.6 s from 0.2 s to 0.8 s")


@pytest.mark.parametrize("empty", [[], None, np.zeros((0, 3))])
def test_map_features_without_points_are_skipped_and_counted(tmp_path: Path, empty: object) -> None:
    raw = description()
    lane = dict(raw["map_features"]["7"])
    raw["map_features"] |= {
        "8": lane | {"polyline": empty},
        "9": {"type": "CROSSWALK", "polygon": empty},
        "10": {"type": "CROSSWALK", "polygon": empty},
        "boundary_1": {"type": "ROAD_EDGE_BOUNDARY", "polyline": empty},
    }
    raw["map_features"]["7"] = lane | {"polygon": empty}
    recording = read(tmp_path, raw)
    assert set(recording.map.lanes) == {"7"}
    assert recording.map.crosswalks == ()
    skipped = [note for note in recording.notes if "without any point skipped" in note]
    assert len(skipped) == 3
    assert "2 map features CROSSWALK without any point skipped" in skipped
