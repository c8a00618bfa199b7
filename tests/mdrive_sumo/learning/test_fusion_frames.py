"""Point grids, made-up frames, their files and what is refused, and what senders share under a condition."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mdrive_sumo.agents.learned.fusion_spec import DELAYS_TICKS, GRID_CELLS, MAX_CAVS, check_detector
from mdrive_sumo.agents.learned.network_inputs import LIDAR_HEIGHT_M
from mdrive_sumo.agents.learned.point_grid import GRID_SIZE, build_point_cells, expand_cells, merge_cells
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.learning.fusion.conditions import CONDITIONS, SharingCondition, choose_scans
from mdrive_sumo.learning.fusion.frame_files import INDEX_NAME, read_frames, write_frames
from mdrive_sumo.learning.fusion.frames import (
    ARRAYS,
    FusionFrames,
    check_frames,
    check_motion,
    check_places_differ,
    concatenate_frames,
    take_frames,
)
from mdrive_sumo.learning.fusion.synthetic_frames import build_synthetic_frames


@pytest.fixture(scope="module")
def frames() -> FusionFrames:
    return build_synthetic_frames(6, 0, cavs=3)


def make_points(*places: tuple[float, float, float]) -> np.ndarray[Any, np.dtype[np.float32]]:
    """Points at heights above the ground."""
    return np.array([(x, y, z - LIDAR_HEIGHT_M, 0.5) for x, y, z in places], np.float32)


def test_a_point_falls_into_the_cell_of_its_place_and_height() -> None:
    cells = build_point_cells(make_points((51.0, 51.0, 0.1), (0.1, -0.1, 1.5), (0.1, -0.1, 1.4), (-51.1, -51.1, 9.0)))
    grid = expand_cells(cells)
    assert [tuple(place) for place in np.argwhere(grid).tolist()] == [(0, 0, 0), (3, 127, 128), (7, 255, 255)]
    assert np.expm1(grid[3, 127, 128]) == pytest.approx(2.0) and np.expm1(grid).sum() == pytest.approx(4.0)


def test_points_outside_of_the_grid_do_not_count_and_counts_end_at_255() -> None:
    assert len(build_point_cells(make_points((51.3, 0, 1), (0, 51.3, 1), (-51.3, 0, 1), (0, -51.3, 1)))) == 0
    assert build_point_cells(make_points(*[(3.0, 3.0, 1.0)] * 300)).tolist()[0] & 255 == 255


@given(st.lists(st.tuples(*[st.floats(-60, 60)] * 2, st.floats(-1, 12)), max_size=40))
def test_cells_are_the_histogram_of_the_points_inside(places: list[tuple[float, float, float]]) -> None:
    points = make_points(*places).reshape(-1, 4)
    cells = build_point_cells(points)
    assert (np.diff(cells.astype(np.int64)) > 0).all() and len(cells) == np.count_nonzero(expand_cells(cells))
    inside = (np.abs(points[:, :2]) < 51.19).all(axis=1)
    assert inside.sum() <= int((cells & 255).sum()) <= len(points)


def test_merged_scans_lie_where_the_poses_say() -> None:
    one = build_point_cells(make_points((10.2, 0.2, 1.0)))
    turned = np.array([(0.0, 0.0, 0.0), (20.0, 0.0, np.pi)])
    merged = expand_cells(merge_cells([one, one], turned))
    rows = np.argwhere(merged)[:, 1:].tolist()
    # 10.2 ahead of the own car, and 10.2 m behind x = 20 m: cells on both sides of 10 m, and of the middle line.
    assert sorted(rows) == [[102, 127], [103, 128]]
    assert np.array_equal(merge_cells([one], np.zeros((1, 3))), one)


def test_made_up_frames_are_frames_and_hide_boxes_from_one_car(frames: FusionFrames) -> None:
    check_frames(frames, "here")
    only_other = (frames.box_points[..., 0] == 0) & (frames.box_points[..., 1:].sum(axis=2) > 0)
    assert only_other.any() and frames.is_target[only_other].all()
    assert (frames.scan[:, :3, 0] >= 0).all() and (frames.scan[:, 3:] == -1).all()
    again = build_synthetic_frames(2, 0, cavs=3)
    assert np.array_equal(again.boxes, frames.boxes[:2], equal_nan=True)
    assert np.array_equal(again.get_scan(3), frames.get_scan(3))


def test_points_of_a_scan_lie_on_its_boxes(frames: FusionFrames) -> None:
    """A box with many points has occupied cells above the ground at its place."""
    i, row = np.argwhere(frames.box_points[..., 0] > 30)[0]
    x, y = frames.boxes[i, row, :2]
    grid = np.expm1(expand_cells(frames.get_scan(frames.scan[i, 0, 0]))[1:]).sum(axis=0)
    line, column = int((51.2 - x) / 0.4), int((51.2 - y) / 0.4)
    assert grid[max(line - 6, 0) : line + 7, max(column - 6, 0) : column + 7].sum() > 29.9


def test_files_hold_what_was_written(frames: FusionFrames, tmp_path: Path) -> None:
    other = build_synthetic_frames(2, 5, split="val")
    write_frames(tmp_path, "train", [frames, other])
    found = read_frames(tmp_path)
    assert found.places == (*frames.places, *other.places) and len(found) == 8
    check_frames(found, "here")
    assert np.array_equal(found.get_scan(found.scan[7, 1, 2]), other.get_scan(other.scan[1, 1, 2]))
    assert np.array_equal(found.get_scan(found.scan[2, 2, 3]), frames.get_scan(frames.scan[2, 2, 3]))
    assert found.places[found.place[6]] == "val_0" and found.episode[6] > frames.episode.max()


def test_taken_frames_keep_their_scans(frames: FusionFrames) -> None:
    taken = take_frames(frames, np.array([4, 1]))
    check_frames(taken, "here")
    assert np.array_equal(taken.get_scan(taken.scan[1, 0, 0]), frames.get_scan(frames.scan[1, 0, 0]))
    assert taken.tick.tolist() == frames.tick[[4, 1]].tolist()


def change(frames: FusionFrames, name: str, index: Any, value: Any) -> FusionFrames:
    array = getattr(frames, name).copy()
    array[index] = value
    return replace(frames, **{name: array})


@pytest.mark.parametrize(
    ("name", "index", "value", "sentence"),
    [
        ("cells", 0, GRID_SIZE << 8 | 1, "cells: expected cells below 524288, found a larger one"),
        ("cells", 0, 256, "cells: expected counts from 1 to 255, found 0"),
        ("scan_starts", -1, 0, "scan_starts: expected ascending numbers from 0"),
        ("scan", (0, 0, 0), -1, "scan: expected a scan of the own car in every frame, found none"),
        ("scan", (0, 1, 0), 999, "scan: expected -1 to 53, of 54 scans, found -1 to 999"),
        ("true_pose", (0, 1, 0, 2), np.nan, "true_pose: expected a pose of every scan"),
        ("true_pose", (0, 0, 0, 0), 1.0, "true_pose: expected 0, 0, 0 of the own car's newest scan"),
        ("estimated_pose", (0, 1, 3, 0), np.inf, "estimated_pose: expected a pose of every scan"),
        ("boxes", (0, 0, 0), 99.0, "boxes: expected centres within 51.2 m and sides above 0"),
        ("boxes", (0, 0, 3), np.nan, "boxes: expected finite numbers in used rows"),
        ("box_class", (0, 0), 3, "box_class: expected classes below 3, found a larger one"),
        ("place", 0, 12, "place: expected numbers of the 12 places, found others"),
        ("box_motion", (0, 0, 0, 0), np.inf, "box_motion: expected finite numbers, or NaN where a box is not in"),
    ],
)  # fmt: skip
def test_wrong_arrays_are_one_sentence(frames: FusionFrames, name: str, index: Any, value: Any, sentence: str) -> None:
    with pytest.raises(InputError) as caught:
        check_frames(change(frames, name, index, value), "set.npz")
    assert str(caught.value).startswith(f"set.npz: {sentence}")


@pytest.mark.parametrize("name", sorted(ARRAYS))
def test_arrays_of_another_type_are_refused(frames: FusionFrames, name: str) -> None:
    with pytest.raises(InputError, match=f"set: {name}: expected .*, found complex128"):
        check_frames(replace(frames, **{name: getattr(frames, name).astype(complex)}), "set")


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (None, "expected the index of fusion frames, found No such file"),
        ("{", "expected JSON, found an error"),
        ("[" * 100_000, "expected JSON, found an error"),
        ("[]", "expected the format 'mdrive-sumo fusion frames 1', found 'list'"),
        ({"format": "tar"}, "expected the format 'mdrive-sumo fusion frames 1', found 'tar'"),
        ({"grid_version": 9}, "expected scans in the point grid of version 1, found 9; collect them again"),
        ({"shards": []}, "shards: expected the names of one archive or more, found []"),
        ({"shards": ["../x.npz"]}, "shards: expected names such as frames-000000.npz, found '../x.npz'"),
        ({"shards": ["frames-000009.npz"]}, "expected an archive of fusion frames, found No such file"),
    ],
)
def test_bad_indices_are_one_sentence(frames: FusionFrames, tmp_path: Path, content: Any, sentence: str) -> None:
    path = write_frames(tmp_path, "val", [frames])
    if content is None:
        path.unlink()
    elif isinstance(content, str):
        path.write_text(content)
    else:
        path.write_text(json.dumps(json.loads(path.read_text()) | content))
    with pytest.raises(InputError) as caught:
        read_frames(tmp_path)
    assert sentence in str(caught.value) and str(tmp_path) in str(caught.value)


def test_damaged_and_incomplete_archives_are_one_sentence(frames: FusionFrames, tmp_path: Path) -> None:
    write_frames(tmp_path, "val", [frames])
    path = tmp_path / "frames-000000.npz"
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    with pytest.raises(InputError, match=r"frames-000000\.npz: expected an archive of arrays, found a damaged one"):
        read_frames(tmp_path)
    arrays = {name: getattr(frames, name) for name in ARRAYS if name != "cells"}
    np.savez(path, places=np.array(frames.places), **arrays)
    with pytest.raises(InputError, match="expected an array cells, found none; frames need LiDAR scans"):
        read_frames(tmp_path)
    assert (tmp_path / INDEX_NAME).is_file()


def test_places_that_were_trained_on_do_not_judge(frames: FusionFrames) -> None:
    check_places_differ(frames, build_synthetic_frames(1, 0, split="val"), "validation")
    with pytest.raises(InputError, match="validation set: expected none of the training set, found 'train_0' and 11"):
        check_places_differ(frames, concatenate_frames([frames]), "validation")


def test_unknown_detectors_are_refused() -> None:
    with pytest.raises(InputError, match="detector 'late': expected one of none, early, attfuse"):
        check_detector("late")


def test_a_condition_moves_senders_only_and_delays_them(frames: FusionFrames) -> None:
    clean = choose_scans(frames, CONDITIONS[0])
    assert np.array_equal(clean.scan, frames.scan[:, :, 0]) and not clean.age_s.any()
    assert np.array_equal(clean.pose[:, :3], frames.true_pose[:, :3, 0])
    noisy = choose_scans(frames, SharingCondition("x", 0.4, 0.4, 4))
    assert (noisy.scan[:, 1:3] == frames.scan[:, 1:3, DELAYS_TICKS.index(4)]).all()
    assert np.array_equal(noisy.scan[:, 0], frames.scan[:, 0, 0]) and not noisy.pose[:, 0].any()
    assert np.allclose(noisy.age_s[:, :3], [[0.0, 0.2, 0.2]] * 6) and noisy.pose.shape == (6, MAX_CAVS, 3)
    error = noisy.pose[:, 1:3] - frames.true_pose[:, 1:3, DELAYS_TICKS.index(4)]
    assert 0.1 < error[..., :2].std() < 0.8 and 0 < np.abs(error[..., 2]).max() < np.radians(2)
    again = choose_scans(frames, SharingCondition("x", 0.4, 0.4, 4))
    assert np.array_equal(again.pose, noisy.pose)
    estimated = choose_scans(frames, CONDITIONS[-1])
    assert np.array_equal(estimated.pose[:, :3], frames.estimated_pose[:, :3, 0])


def test_the_grid_of_features_covers_the_point_grid() -> None:
    from mdrive_sumo.agents.learned import fusion_spec as spec

    assert pytest.approx(GRID_CELLS * spec.GRID_CELL_M) == spec.FEATURE_CELLS * spec.FEATURE_CELL_M
    assert pytest.approx(2 * spec.GRID_REACH_M) == spec.OUTPUT_CELLS * spec.OUTPUT_CELL_M
    assert spec.TILE_ROWS * spec.TILE_CELLS == spec.FEATURE_CELLS


def test_frames_without_motion_are_read_and_teach_no_forecast(frames: FusionFrames, tmp_path: Path) -> None:
    assert frames.box_motion is not None
    still = replace(frames, box_motion=None)
    write_frames(tmp_path, "train", [frames, still])
    both = read_frames(tmp_path)
    assert len(both) == 12 and both.box_motion is None
    with pytest.raises(InputError, match=r"training set: expected frames with an array box_motion, .*, found none in"):
        check_motion(both, "training set")
    write_frames(tmp_path, "train", [frames])
    again = read_frames(tmp_path)
    assert np.array_equal(again.box_motion, frames.box_motion, equal_nan=True)  # pyright: ignore[reportArgumentType]
    check_motion(again, "training set")
    assert take_frames(still, np.array([1])).box_motion is None


def test_boxes_of_made_up_frames_drive_straight_on(frames: FusionFrames) -> None:
    assert frames.box_motion is not None
    used = frames.box_class >= 0
    before, boxes, after = frames.box_motion[used][:, 0], frames.boxes[used], frames.box_motion[used][:, 2]
    assert np.allclose(boxes[:, :2] - before[:, :2], (after - boxes[:, :3])[:, :2] / 2, atol=1e-4)
    assert np.abs(after[:, 0] - boxes[:, 0]).max() > 3.0 and np.isnan(frames.box_motion[~used]).all()
