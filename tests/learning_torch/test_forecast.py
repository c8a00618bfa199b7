"""Forecasts of occupancy: what is drawn, what is taught, tracks with errors, training, and exported files."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from mdrive_sumo.agents.learned.fusion_network import load_detector
from mdrive_sumo.agents.learned.fusion_spec import CODRIVING, FEATURE_CELLS, FORECAST_S, OUTPUT_CELLS
from mdrive_sumo.agents.learned.occupancy_grid import draw_boxes
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.learning.fusion.conditions import CONDITIONS, choose_scans
from mdrive_sumo.learning.fusion.frames import MOTION_S, FusionFrames
from mdrive_sumo.learning.fusion.networks.forecast_head import ForecastHead
from mdrive_sumo.learning.fusion.networks.fusion_network import FusionNetwork
from mdrive_sumo.learning.fusion.synthetic_frames import build_synthetic_frames
from mdrive_sumo.learning.fusion.training import fusion_trainer as training
from mdrive_sumo.learning.fusion.training.detect_frames import answer_frames, measure_forecast
from mdrive_sumo.learning.fusion.training.export_fusion import build_trained_network, export_fusion
from mdrive_sumo.learning.fusion.training.forecast_losses import (
    build_occupancy_truth,
    compute_occupancy_loss,
    draw_occupancy,
    draw_track_maps,
    draw_tracks,
    know_tracks,
    mirror_motion,
)
from mdrive_sumo.learning.fusion.training.frame_store import FrameStore, TrueBoxes
from mdrive_sumo.learning.fusion.training.fusion_trainer import FusionTrainer
from mdrive_sumo.learning.fusion.training.run_fusion_training import FusionRun, run_fusion_training
from mdrive_sumo.learning.training.checkpoint import Checkpoint, load_checkpoint
from mdrive_sumo.learning.training.training_curves import read_curves
from mdrive_sumo.learning.training.training_options import TrainingOptions

CPU = torch.device("cpu")
TIMES = len(FORECAST_S)
GATED = {"is_gated": True}


@pytest.fixture(scope="module")
def frames() -> FusionFrames:
    return build_synthetic_frames(4, 0, cavs=3, boxes=12)


@pytest.fixture(scope="module")
def store(frames: FusionFrames) -> FrameStore:
    return FrameStore(frames, CPU)


def make_truth(store: FrameStore, rows: int = 4) -> TrueBoxes:
    return store.take_boxes(torch.arange(rows), torch.ones(rows, 5, dtype=torch.bool))


def test_training_draws_as_driving_does() -> None:
    random = np.random.default_rng(0)
    places = random.uniform(-54, 54, (20, 2, 2))
    boxes = np.concatenate((places, random.uniform(-4, 4, (20, 2, 1)), random.uniform(0.3, 12, (20, 2, 2))), axis=-1)
    drawn = draw_occupancy(torch.from_numpy(boxes[None]).float(), torch.ones(1, 20, 2, dtype=torch.bool))
    expected = draw_boxes(boxes)
    assert (drawn[0].numpy() != expected).mean() < 1e-4 and expected.sum() > 100  # single precision on edges
    assert not draw_occupancy(torch.from_numpy(boxes[None]).float(), torch.zeros(1, 20, 2, dtype=torch.bool)).any()


def test_truth_moves_with_the_boxes_and_what_no_scan_shows_is_not_taught(store: FrameStore) -> None:
    motion, truth = store.take_motion(torch.arange(4)), make_truth(store)
    found = build_occupancy_truth(motion, truth)
    i, j = (int(each[0]) for each in truth.is_seen.nonzero(as_tuple=True))
    for time in range(TIMES):
        x, y = motion.boxes[i, j, time, :2].tolist()
        row, column = int((51.2 - x) / 0.8), int((51.2 - y) / 0.8)
        if 0 <= row < OUTPUT_CELLS and 0 <= column < OUTPUT_CELLS:
            assert found.occupied[i, time, row, column] == 1
    hidden = build_occupancy_truth(motion, replace(truth, is_seen=truth.is_hidden, is_hidden=truth.is_seen))
    both = (found.occupied > 0) & (hidden.occupied > 0)
    assert torch.equal(found.is_taught == 0, (hidden.occupied > 0) & ~both) and hidden.occupied.sum() > 10


def test_times_after_the_end_of_a_drive_are_not_taught(frames: FusionFrames) -> None:
    assert frames.box_motion is not None
    ended = frames.box_motion.copy()
    ended[0, :, 4:] = np.nan
    store = FrameStore(replace(frames, box_motion=ended), CPU)
    found = build_occupancy_truth(store.take_motion(torch.arange(4)), make_truth(store))
    taught = found.is_taught.amax(dim=(2, 3))
    assert taught[0].tolist() == [1, 1, 1, 1, 0, 0] and bool((taught[1:] == 1).all())
    logits = torch.zeros(4, TIMES, OUTPUT_CELLS, OUTPUT_CELLS)
    wrong = logits.clone()
    wrong[0, 4:] = 9.0
    assert compute_occupancy_loss(logits, found) == compute_occupancy_loss(wrong, found)


def test_velocities_are_those_of_the_last_half_second(frames: FusionFrames, store: FrameStore) -> None:
    motion = store.take_motion(torch.arange(4))
    used = torch.from_numpy(frames.box_class >= 0)
    step = (motion.boxes[:, :, 2, :2] - motion.boxes[:, :, 0, :2]) / FORECAST_S[2]
    assert torch.allclose(step[used], motion.velocity[used], atol=1e-3) and bool(motion.is_moving[used].all())
    assert MOTION_S[0] == -0.5 and float(motion.velocity[used].norm(dim=-1).max()) > 5.0


def test_tracks_lack_some_boxes_have_errors_and_never_tell_what_no_scan_shows(store: FrameStore) -> None:
    motion, truth = store.take_motion(torch.arange(4)), make_truth(store)
    generator = torch.Generator().manual_seed(0)
    known, count = 0, 0
    gaps: list[float] = []
    for _ in range(30):
        tracks = draw_tracks(motion, truth.is_seen, generator)
        real = tracks.is_there[:, : truth.is_seen.shape[1]]
        assert not bool((real & ~truth.is_seen).any())
        known, count = known + int(real.sum()), count + int(truth.is_seen.sum())
        gap = tracks.boxes[:, : real.shape[1], :, :2] - motion.boxes[..., :2]
        gaps += gap[real].norm(dim=-1).mean(dim=0).tolist()
    assert 0.5 < known / count < 0.85
    mean = np.array(gaps).reshape(-1, TIMES).mean(axis=0)
    assert 0.3 < mean[0] < 0.5 and (np.diff(mean) > 0).all()  # speeds are wrong, so places are, the more the later
    exact = draw_track_maps(know_tracks(motion, truth.is_seen))
    assert float((exact != build_occupancy_truth(motion, truth).occupied).float().mean()) < 1e-3


def test_mirrored_motion_is_the_mirrored_map(store: FrameStore) -> None:
    motion, truth = store.take_motion(torch.arange(1)), make_truth(store, 1)
    there = motion.is_there & truth.is_seen[..., None]
    turned = mirror_motion(motion, torch.tensor([True]))
    drawn, again = draw_occupancy(motion.boxes, there), draw_occupancy(turned.boxes, there)
    assert float((again.flip(-1) != drawn).float().mean()) < 1e-4 and drawn.sum() > 50
    assert torch.equal(turned.velocity[..., 1], -motion.velocity[..., 1])


def make_run(frames: FusionFrames, folder: Path, **changes: Any) -> FusionRun:
    options = TrainingOptions(steps=2, batch=1, learning_rate=2e-3, log_every=1, average_decay=0.9)
    judged = build_synthetic_frames(1, 0, split="val")
    return replace(FusionRun(CODRIVING, options, "cpu", folder, frames, judged, is_gated=True), **changes)


def test_a_forecast_learns_what_its_tracks_do_not_tell(store: FrameStore) -> None:
    torch.manual_seed(0)
    motion, truth = store.take_motion(torch.arange(1)), make_truth(store, 1)
    wanted = build_occupancy_truth(motion, truth)
    maps = torch.rand(1, 16, FEATURE_CELLS, FEATURE_CELLS)
    nothing = torch.zeros(1, TIMES, OUTPUT_CELLS, OUTPUT_CELLS)
    head = ForecastHead().train()
    optimizer = torch.optim.AdamW(head.parameters(), lr=1e-2)
    losses: list[float] = []
    for _ in range(8):
        loss = compute_occupancy_loss(head(maps, nothing), wanted)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        losses.append(float(loss.detach()))
    assert losses[-1] < 0.8 * losses[0]


def test_a_run_keeps_the_best_weights_with_their_forecast(
    frames: FusionFrames, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(training, "SETTLED_BATCHES", 1)
    best = run_fusion_training(make_run(frames, tmp_path / "run"), str)
    rows = read_curves(tmp_path / "run" / "curves.csv")
    assert any(name == "validation/occupancy" and 0 < value < 1 for _, name, value in rows)
    assert build_trained_network(load_checkpoint(best, CODRIVING)).forecast is not None


def test_exported_files_answer_as_pytorch(frames: FusionFrames, tmp_path: Path) -> None:
    torch.manual_seed(0)
    checkpoint = Checkpoint(CODRIVING, 1, 1.0, {}, FusionNetwork(CODRIVING, True).state_dict(), {}, None, GATED)
    exported = export_fusion(checkpoint, tmp_path)
    assert exported.bytes < 2_000_000 and exported.difference < 1e-4
    loaded, network = load_detector(CODRIVING, tmp_path), build_trained_network(checkpoint)
    assert network.forecast is not None
    store, shared = FrameStore(frames, CPU), choose_scans(frames, CONDITIONS[1])
    tracks = draw_track_maps(know_tracks(store.take_motion(torch.arange(1)), make_truth(store, 1).is_seen))
    with torch.no_grad():
        fused = answer_frames(network, store, store.to_sharing(shared, slice(0, 1))).fused
        expected = torch.sigmoid(network.forecast(fused, tracks))[0].numpy()
    features = np.stack([loaded.encode(frames.get_scan(scan)).features for scan in shared.scan[0, :3]])
    arrived = np.ones((3, FEATURE_CELLS, FEATURE_CELLS), np.float32)
    _, occupied = loaded.forecast(features, arrived, shared.pose[0, :3], shared.age_s[0, :3], tracks[0].numpy())
    assert occupied.shape == (TIMES, OUTPUT_CELLS, OUTPUT_CELLS) and np.abs(occupied - expected).max() < 5e-3


def test_every_number_of_the_network_learns(frames: FusionFrames, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(training, "LONE_SHARE", 0.0)
    trainer = FusionTrainer(CODRIVING, TrainingOptions(batch=1), CPU, is_gated=True)
    before = {name: value.clone() for name, value in trainer.network.named_parameters()}
    parts = trainer._take_step(FrameStore(frames, CPU), torch.ones(4), 0.0)
    assert "occupancy" in parts and bool(parts["total"].isfinite())
    assert [name for name, value in trainer.network.named_parameters() if torch.equal(value, before[name])] == []


def test_the_twin_is_trained_without_what_others_send(frames: FusionFrames) -> None:
    """Other cars' scans change nothing of a step."""
    alone = frames.scan.copy()
    alone[:, 1:] = -1
    losses: list[float] = []
    for scan in (frames.scan, alone):
        trainer = FusionTrainer(CODRIVING, TrainingOptions(batch=1), CPU, is_gated=True, is_alone=True)
        parts = trainer._take_step(FrameStore(replace(frames, scan=scan), CPU), torch.ones(4), 0.0)
        losses.append(float(parts["total"].detach()))
        assert trainer.summary["is_alone"] is True
    assert losses[0] == losses[1]


def test_what_cannot_be_trained_is_one_sentence(frames: FusionFrames, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="training set: expected frames with an array box_motion") as caught:
        run_fusion_training(make_run(replace(frames, box_motion=None), tmp_path / "a"), str)
    assert "\n" not in str(caught.value)
    still = replace(build_synthetic_frames(1, 0, split="val"), box_motion=None)
    with pytest.raises(InputError, match="validation set: expected frames with an array box_motion"):
        run_fusion_training(make_run(frames, tmp_path / "b", validation=still), str)


def test_a_fresh_forecast_knows_tracks_and_nothing_else(frames: FusionFrames) -> None:
    torch.manual_seed(0)
    network = FusionNetwork(CODRIVING, True).eval()
    assert network.forecast is not None
    tracks = torch.zeros(1, TIMES, OUTPUT_CELLS, OUTPUT_CELLS)
    tracks[0, :, 40:46, 60:63] = 1.0
    with torch.no_grad():
        answer = torch.sigmoid(network.forecast(torch.zeros(1, 16, FEATURE_CELLS, FEATURE_CELLS), tracks))
    assert float(answer[tracks > 0].min()) > 0.5 > 0.1 > float(answer[tracks == 0].median())
    assert 0.0 < measure_forecast(network, frames, FrameStore(frames, CPU)) < 1.0
