"""Argoverse 2 sensor logs: small logs with known answers, and damaged ones."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from testing.argoverse2_samples import (
    CAR,
    HALF,
    SWEEPS,
    Rows,
    box_rows,
    change_value,
    drop_column,
    ego_at,
    index_tracks,
    joined,
    log,
    no_fixture_check,
    pose_rows,
    standing,
)

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import wrap_angles
from real2sim.readers.argoverse2 import read_argoverse2
from real2sim.readers.argoverse2_sensor import AXLE_TO_CENTRE_M
from real2sim.recording import ObjectCategory


@pytest.mark.slow
@given(x=st.floats(600, 800), y=st.floats(1900, 2100), yaw=st.floats(-math.pi, math.pi))
@no_fixture_check
def test_boxes_come_from_the_egos_frame_into_the_citys(tmp_path: Path, x: float, y: float, yaw: float) -> None:
    track = index_tracks(read_argoverse2(log(tmp_path, box_rows("car", "BUS", standing(x, y, yaw)))))["car"]
    assert track.valid.all()
    np.testing.assert_allclose(track.xy, np.tile((x, y), (len(track.x), 1)), atol=2e-3)  # of interpolated poses
    np.testing.assert_allclose(wrap_angles(track.yaw - yaw), 0.0, atol=2e-4)
    assert (track.category, track.length[0], track.width[0]) == (ObjectCategory.BUS, 4.5, 2.0)


def test_sweeps_come_onto_a_grid_of_10_hz(tmp_path: Path) -> None:
    """A car at 20 m/s on a clock that is 0.3 % fast: rows by number instead of by time would be 0.06 m off a sweep."""
    car = box_rows("car", "REGULAR_VEHICLE", lambda t: (720.0 + 20 * t, 2000.0, 3.1 + 0.2 * t))
    recording = read_argoverse2(log(tmp_path, car))
    track, t = index_tracks(recording)["car"], np.arange(recording.frame_count) * 0.1
    assert (recording.dt_s, recording.frame_count) == (0.1, SWEEPS)
    np.testing.assert_allclose(track.x[:-1], (720.0 + 20 * t)[:-1], atol=5e-3)
    np.testing.assert_allclose(wrap_angles(track.yaw - 3.1 - 0.2 * t), 0.0, atol=1e-3)  # it passes pi


def test_frames_without_a_sweep_are_not_made_up(tmp_path: Path) -> None:
    gaps = (2, 3, 4, 7, 8)
    recording = read_argoverse2(log(tmp_path, CAR, box_rows("7", "TRUCK", standing(730.0), gaps)))
    track = index_tracks(recording)["7"]
    assert track.valid_frames.tolist() == list(gaps)
    assert np.isnan(track.x[~track.valid]).all()


def test_the_ego_is_the_connected_vehicle_at_its_box_centre(tmp_path: Path) -> None:
    recording = read_argoverse2(log(tmp_path))
    ego, t = index_tracks(recording)["AV"], np.arange(recording.frame_count) * 0.1
    yaw = 0.4 + 0.3 * t
    np.testing.assert_allclose(ego.x, 700.0 + 8 * t + AXLE_TO_CENTRE_M * np.cos(yaw), atol=2e-3)
    np.testing.assert_allclose(ego.y, 2000.0 + 2 * t + AXLE_TO_CENTRE_M * np.sin(yaw), atol=2e-3)
    np.testing.assert_allclose(ego.yaw, yaw, atol=1e-4)
    assert recording.cavs == ("AV",)
    assert np.isnan(ego.length).all()


def test_the_box_of_the_ego_gives_its_size_only(tmp_path: Path) -> None:
    own = box_rows("uuid", "EGO_VEHICLE", lambda t: (*ego_at(t)[0][:2], ego_at(t)[1]))
    recording = read_argoverse2(log(tmp_path, CAR, own, name="annotations_with_ego.feather"))
    assert set(index_tracks(recording)) == {"AV", "car"}
    assert index_tracks(recording)["AV"].length.tolist() == [4.5] * recording.frame_count
    assert any("the ego is a box" in note for note in recording.notes)


def test_annotations_with_the_ego_are_preferred(tmp_path: Path) -> None:
    log(tmp_path)
    log(tmp_path, box_rows("other", "REGULAR_VEHICLE", standing(720.0)), name="annotations_with_ego.feather")
    assert set(index_tracks(read_argoverse2(tmp_path))) == {"AV", "other"}


def test_riders_and_what_they_ride_are_one(tmp_path: Path) -> None:
    def riding(t: float) -> tuple[float, float, float]:
        return 720.0 + 4 * t, 2010.0, 0.0

    boxes = (
        box_rows("bike", "BICYCLE", riding),
        box_rows("rider", "BICYCLIST", lambda t: (riding(t)[0] - 0.2, 2010.1, 0.0)),
        box_rows("lone rider", "BICYCLIST", standing(760.0)),
        box_rows("parked", "BICYCLE", standing(750.0)),
        box_rows("held", "BICYCLE", standing(770.0)),
        box_rows("waiting", "BICYCLIST", standing(770.5)),
        box_rows("rolling", "WHEELED_DEVICE", lambda t: (780.0 + t * 3, 2010.0, 0.0)),
    )
    recording = read_argoverse2(log(tmp_path, *boxes))
    found = {id_: (track.category, track.parked) for id_, track in index_tracks(recording).items() if id_ != "AV"}
    assert found == {
        "bike": (ObjectCategory.BICYCLE, False),
        "lone rider": (ObjectCategory.BICYCLE, False),
        "parked": (ObjectCategory.STATIC, True),
        "held": (ObjectCategory.BICYCLE, False),
        "rolling": (ObjectCategory.BICYCLE, False),
    }
    assert any("2 riders" in note for note in recording.notes)


def test_unknown_categories_are_noted(tmp_path: Path) -> None:
    recording = read_argoverse2(log(tmp_path, CAR, box_rows("dog", "DOG", standing(730.0))))
    assert set(index_tracks(recording)) == {"AV", "car"}
    assert any("1 tracks of the unknown category DOG" in note for note in recording.notes)


def test_a_track_is_of_the_category_of_its_last_row(tmp_path: Path) -> None:
    """Damaged words of other rows do not matter."""
    recording = read_argoverse2(log(tmp_path, change_value(CAR, "category", "REGULAR_\x12@", row=0)))
    tracks = index_tracks(recording)
    assert set(tracks) == {"AV", "car"} and tracks["car"].category is ObjectCategory.CAR


LOGS: list[tuple[Rows, Rows, str]] = [
    (drop_column(CAR, "qz"), pose_rows(), r"annotations\.feather: expected the column qz"),
    (CAR, drop_column(pose_rows(), "tx_m"), r"egovehicle\.feather: expected the column tx_m"),
    (change_value(CAR, "tx_m", math.inf), pose_rows(), r"annotations\.feather: tx_m: .* found inf in row 3"),
    (change_value(CAR, "qw", 7.0), pose_rows(), r"annotations\.feather: qw, .* length 1, found 7\.\d+ in row 3"),
    (CAR, change_value(pose_rows(), "ty_m", math.nan), r"egovehicle\.feather: ty_m: .* found nan in row 3"),
    (joined(CAR, CAR), pose_rows(), "track car: expected one box a sweep, found two at 0 s"),
    (box_rows("car", "TRUCK", standing(720.0), (0,)), pose_rows(), "expected at least 2 sweeps, found 1"),
    (CAR, HALF, r"egovehicle\.feather: expected poses for all sweeps, 0 to 1\.0967 s .* from -0\.02 to 0\.57 s"),
]


@pytest.mark.parametrize(("boxes", "poses", "message"), LOGS)
def test_bad_logs_are_refused(tmp_path: Path, boxes: Rows, poses: Rows, message: str) -> None:
    with pytest.raises(InputError, match=message):
        read_argoverse2(log(tmp_path, boxes, poses=poses))
