"""Pictures of fused grids: which frames are drawn, where features of others lie, what counts as added by them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image
from testing.tiny_detector import save_tiny_detector

from mdrive_sumo.agents.learned.feature_inbox import ReceivedMap
from mdrive_sumo.agents.learned.fusion_network import load_detector
from mdrive_sumo.agents.learned.fusion_spec import FEATURE_CELLS, FEATURE_CHANNELS
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.learning.fusion.frame_files import write_frames
from mdrive_sumo.learning.fusion.frames import FusionFrames, take_frames
from mdrive_sumo.learning.fusion.synthetic_frames import build_synthetic_frames
from mdrive_sumo.v2x.feature_map import FeatureMap
from mdrive_sumo.v2x.messages import ReferencePose
from tools import draw_fused_grids
from tools.draw_fused_grids import build_scene, choose_frames


@pytest.fixture(scope="module")
def frames() -> FusionFrames:
    """Of three places, each with a frame of few hidden boxes and one of many."""
    return build_synthetic_frames(12, 0, cavs=3, boxes=12)


@pytest.fixture(scope="module")
def weights(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return save_tiny_detector(tmp_path_factory.mktemp("weights"), "attfuse").parent


def test_frames_with_the_most_hidden_vehicles_are_drawn_one_of_each_place(frames: FusionFrames) -> None:
    chosen = choose_frames(frames, 3)
    hidden = (frames.is_target & (frames.box_class == 0) & (frames.box_points[..., 0] == 0)).sum(axis=1)
    assert len({*frames.place[chosen].tolist()}) == 3
    assert [hidden[row] for row in chosen] == sorted((hidden[row] for row in chosen), reverse=True)
    for row in chosen:
        assert hidden[row] == hidden[frames.place == frames.place[row]].max()
    one_place = take_frames(frames, np.flatnonzero(frames.place == frames.place[chosen[0]]))
    assert len(choose_frames(one_place, 2)) == 1
    drives = replace(one_place, episode=np.arange(len(one_place), dtype=np.int32))
    assert len(choose_frames(drives, 2)) == 2
    with pytest.raises(InputError, match="expected some with vehicles that only senders see, found none"):
        choose_frames(take_frames(frames, np.flatnonzero(hidden == 0)[:0]), 3)


def test_features_lie_where_the_pose_of_their_sender_puts_them() -> None:
    """A sender 20 m ahead and 10 m to the left looks left; what is 9 m ahead of it is 19 m to the left of the car."""
    features = np.zeros((FEATURE_CHANNELS, FEATURE_CELLS, FEATURE_CELLS), np.float32)
    arrived = np.zeros((FEATURE_CELLS, FEATURE_CELLS), np.bool_)
    row, column = 26, 31  # x = 51.2 - 26.5 * 1.6 = 8.8, y = 51.2 - 31.5 * 1.6 = 0.8
    arrived[24:32, 24:32] = True
    features[:2, row, column] = 1.5
    confidence = np.zeros_like(arrived, np.float32)
    found = FeatureMap(ReferencePose(0.0, 0.0, 0.0, 0), features, arrived, confidence)
    pose = np.array((20.3, 10.1, np.pi / 2), np.float32)
    placed = draw_fused_grids._place_features([ReceivedMap("1", found, pose, 0.0)])  # pyright: ignore[reportPrivateUsage]
    ((ahead, left),) = 51.2 - (np.argwhere(placed == 3.0) + 0.5) * 1.6
    # in the own frame the feature is at (20.3 - 0.8, 10.1 + 8.8), and cells have sides of 1.6 m
    assert abs(ahead - 19.5) < 0.8 and abs(left - 18.9) < 0.8
    assert np.isnan(placed[-1]).all() and (placed == 0.0).sum() == pytest.approx(63, abs=12)


def test_a_scene_tells_what_others_added_from_what_the_own_scan_shows(frames: FusionFrames, weights: Path) -> None:
    row = choose_frames(frames, 1)[0]
    scene = build_scene(frames, row, load_detector("attfuse", weights))
    assert scene.cars.shape == (3, 3) and not scene.cars[0].any()
    assert len(scene.is_new) == len(scene.found.boxes) > 0
    near_own = [
        (np.hypot(*(box[:2] - truth[:2])) < 6.0)
        for box in scene.found.boxes
        for truth in scene.boxes[scene.is_seen[:, 0]]
    ]
    assert any(near_own) and scene.is_new.any() and not scene.is_new.all()
    hidden = int((scene.is_seen.any(axis=1) & ~scene.is_seen[:, 0]).sum())
    assert f"{len(scene.boxes)} road users, {hidden} of them seen by others only" in scene.describe()


@pytest.mark.slow
def test_the_command_draws_a_row_for_each_scene(frames: FusionFrames, weights: Path, tmp_path: Path) -> None:
    write_frames(tmp_path / "data", "test", [frames])
    words = [str(tmp_path / "data"), str(tmp_path / "a.png"), "--weights", str(weights)]
    done = CliRunner().invoke(draw_fused_grids.main, [*words, "--frame", "0", "--frame", "5"])
    assert done.exit_code == 0 and done.output.count("seen by others only") == 2, done.output
    with Image.open(tmp_path / "a.png") as picture:
        assert picture.width > 1.5 * picture.height
        assert (tmp_path / "a.png").stat().st_size < 100_000
    for more, says in (
        (["--frame", "12"], "--frame: expected a number below 12, found 12"),
        (["--weights", str(tmp_path)], "attfuse-encoder.json: cannot be read"),
    ):
        done = CliRunner().invoke(draw_fused_grids.main, [*words, *more])
        assert done.exit_code == 2 and says in done.output
