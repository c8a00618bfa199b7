"""Networks of the detectors: warping, what each fusion does with what is missing, losses, and exported files."""

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from mdrive_sumo.agents.learned.box_decoding import decode_boxes
from mdrive_sumo.agents.learned.fusion_network import load_detector
from mdrive_sumo.agents.learned.fusion_spec import FEATURE_CELLS, FEATURE_CHANNELS, FUSIONS, OUTPUT_CELLS
from mdrive_sumo.agents.learned.point_grid import expand_cells, merge_cells
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.learning.fusion.conditions import CONDITIONS, choose_scans
from mdrive_sumo.learning.fusion.frames import FusionFrames
from mdrive_sumo.learning.fusion.networks.detection_head import compute_scores
from mdrive_sumo.learning.fusion.networks.fusion_network import FusionAnswer, FusionNetwork
from mdrive_sumo.learning.fusion.networks.fusions import FUSION_MODULES, _cut_windows, _join_windows
from mdrive_sumo.learning.fusion.networks.warp import warp_maps
from mdrive_sumo.learning.fusion.synthetic_frames import build_synthetic_frames
from mdrive_sumo.learning.fusion.training import export_fusion as exporting
from mdrive_sumo.learning.fusion.training.augment_sharing import draw_arrived, draw_sharing, quantise
from mdrive_sumo.learning.fusion.training.detect_frames import answer_frames
from mdrive_sumo.learning.fusion.training.export_fusion import MAX_FILES_BYTES, export_fusion
from mdrive_sumo.learning.fusion.training.frame_store import FrameStore, TrueBoxes, mirror
from mdrive_sumo.learning.fusion.training.fusion_losses import (
    build_targets,
    compute_detection_losses,
    draw_centres,
    estimate_iou,
    locate_cells,
)
from mdrive_sumo.learning.training.checkpoint import Checkpoint
from mdrive_sumo.perception.box_iou import compute_ious

CPU = torch.device("cpu")


@pytest.fixture(scope="module")
def frames() -> FusionFrames:
    return build_synthetic_frames(3, 0, cavs=3)


def make_checkpoint(detector: str, is_gated: bool = False) -> Checkpoint:
    torch.manual_seed(0)
    weights = FusionNetwork(detector, is_gated).state_dict()
    return Checkpoint(detector, 1, 1.0, {}, weights, {}, None, {"is_gated": is_gated})


def test_a_map_is_warped_to_where_its_sender_is() -> None:
    """A cell 8.8 m ahead of a sender that stands 16 m to the left and looks to the right is 8.8 m nearer."""
    maps = torch.zeros(1, 1, FEATURE_CELLS, FEATURE_CELLS)
    maps[0, 0, int((51.2 - 8.8) / 1.6), int(51.2 / 1.6)] = 1.0  # ahead 8.8 m, left -0.8 m of the middle line
    warped = warp_maps(maps, torch.tensor([(0.0, 16.0, -math.pi / 2)]))
    row, column = divmod(int(warped.flatten().argmax()), FEATURE_CELLS)
    x, y = 51.2 - (row + 0.5) * 1.6, 51.2 - (column + 0.5) * 1.6
    assert (x, y) == pytest.approx((-0.8, 7.2), abs=1e-4) and float(warped.max()) == pytest.approx(1.0, abs=1e-4)
    assert torch.allclose(warp_maps(maps, torch.zeros(1, 3)), maps, atol=1e-5)


@pytest.mark.parametrize("is_sparse", [False, True])
def test_windows_join_to_what_was_cut(is_sparse: bool) -> None:
    cells = torch.randn(2, 1, 16, 16, 3)
    tokens = _cut_windows(cells, is_sparse)
    assert torch.equal(_join_windows(tokens, 16, is_sparse), cells[:, 0])
    rows = torch.arange(16.0)[:, None].expand(16, 16)[None, None, ..., None]
    first = _cut_windows(rows, is_sparse)[0, 0, :, 0].unique().tolist()
    assert first == ([0.0, 4.0, 8.0, 12.0] if is_sparse else [0.0, 1.0, 2.0, 3.0])


@pytest.mark.parametrize("name", FUSIONS)
def test_what_did_not_arrive_changes_nothing(name: str) -> None:
    torch.manual_seed(1)
    fusion = FUSION_MODULES[name]()
    maps = torch.rand(2, 3, FEATURE_CHANNELS, 16, 16)
    arrived, age = torch.ones(2, 3, 1, 16, 16), torch.zeros(2, 3, 1, 1, 1)
    arrived[:, 2] = 0.0
    fused = fusion(maps, arrived, age)
    other = maps.clone()
    other[:, 2] = 7.0
    assert fused.shape == (2, FEATURE_CHANNELS, 16, 16) and torch.equal(fused, fusion(other, arrived, age))
    assert torch.allclose(fused, fusion(maps[:, :2], arrived[:, :2], age[:, :2]), atol=1e-5)
    other[:, 1] = 7.0
    assert not torch.allclose(fused, fusion(other, arrived, age))


def test_max_fusion_is_the_maximum() -> None:
    maps = torch.rand(1, 2, FEATURE_CHANNELS, 4, 4)
    fused = FUSION_MODULES["fcooper"]()(maps, torch.ones(1, 2, 1, 4, 4), torch.zeros(1, 2, 1, 1, 1))
    assert torch.equal(fused, torch.maximum(maps[:, 0], maps[:, 1]))


def test_grids_on_the_device_are_those_of_numpy(frames: FusionFrames) -> None:
    store = FrameStore(frames, CPU)
    scans = torch.tensor([5, 0])
    grids = store.build_grids(scans)
    for grid, scan in zip(grids.numpy(), scans.tolist(), strict=True):
        np.testing.assert_allclose(grid, expand_cells(frames.get_scan(scan)), rtol=1e-6)
    shared = choose_scans(frames, CONDITIONS[1])
    merged = store.build_merged_grids(store.to_sharing(shared, slice(1, 2)))[0].numpy()
    expected = expand_cells(merge_cells([frames.get_scan(i) for i in shared.scan[1, :3]], shared.pose[1, :3]))
    assert (
        ~np.isclose(merged, expected)
    ).mean() < 1e-5 and merged.sum() > 0  # single and double precision differ on edges


def test_mirrored_frames_are_consistent(frames: FusionFrames) -> None:
    """The merged grid of a mirrored frame is the mirrored merged grid."""
    store = FrameStore(frames, CPU)
    rows = torch.tensor([0])
    sharing = store.share(rows, torch.zeros((1, 5), dtype=torch.int64), torch.tensor([False]))
    boxes = store.take_boxes(rows, sharing.scan >= 0).boxes
    grid = store.build_merged_grids(sharing)
    turned, pose, moved = mirror(grid, sharing.pose, boxes, torch.tensor([True]), torch.tensor([0]))
    assert torch.equal(turned.flip(-1), grid) and torch.equal(pose[..., 1], -sharing.pose[..., 1])
    assert torch.equal(moved[..., 0], boxes[..., 0]) and torch.equal(moved[..., 2], -boxes[..., 2])
    assert torch.equal(mirror(grid, pose, boxes, torch.tensor([False]), torch.tensor([0]))[0], grid)


def test_errors_are_drawn_for_senders_only(frames: FusionFrames) -> None:
    store = FrameStore(frames, CPU)
    rows = torch.arange(3).repeat(40)
    drawn = draw_sharing(store, rows, torch.Generator().manual_seed(0))
    assert not drawn.sharing.pose[:, 0].any() and (drawn.sharing.scan[:, 0] >= 0).all()
    true = torch.from_numpy(frames.true_pose[:, :3, 0])[rows]
    still = (drawn.sharing.pose[:, :3] - true).abs().amax(dim=(1, 2)) < 1e-6
    assert torch.equal(still, drawn.is_perfect) and 0.1 < float(still.float().mean()) < 0.5
    confidence = torch.rand(120, 5, FEATURE_CELLS, FEATURE_CELLS)
    arrived = draw_arrived(confidence, drawn.sharing.scan >= 0, drawn.is_perfect, torch.Generator().manual_seed(0))
    assert (
        arrived[:, 0].all() and arrived[drawn.is_perfect][:, 1][drawn.sharing.scan[drawn.is_perfect][:, 1] >= 0].all()
    )
    assert not arrived[:, 4].any() and 0.2 < float(arrived[~drawn.is_perfect, 1].mean()) < 0.9
    tiles = arrived[:, 1].unfold(1, 8, 8).unfold(2, 8, 8).flatten(3)
    assert torch.equal(tiles.amin(dim=3), tiles.amax(dim=3))  # whole tiles


def test_quantised_features_pass_the_gradient() -> None:
    features = torch.rand(1, 2, 4, 4, requires_grad=True)
    rounded = quantise(features)
    steps = rounded.detach() / (features.detach().amax(dim=(2, 3), keepdim=True) / 63)
    assert torch.allclose(steps, steps.round(), atol=1e-3) and not torch.equal(rounded, features)
    rounded.sum().backward()
    assert torch.equal(features.grad, torch.ones_like(features))


def make_truth(frames: FusionFrames) -> TrueBoxes:
    return FrameStore(frames, CPU).take_boxes(torch.arange(3), torch.ones(3, 5, dtype=torch.bool))


def test_a_perfect_answer_decodes_to_the_truth_and_costs_little(frames: FusionFrames) -> None:
    truth = make_truth(frames)
    heat, _ = draw_centres(truth, OUTPUT_CELLS)
    row, column = locate_cells(truth.boxes, OUTPUT_CELLS)
    near = torch.arange(-1, 2)
    numbers = torch.zeros(3, 7, OUTPUT_CELLS, OUTPUT_CELLS)
    for i, j in truth.is_seen.nonzero().tolist():
        rows, columns = (row[i, j] + near[:, None]).expand(3, 3), (column[i, j] + near).expand(3, 3)
        built = build_targets(
            truth.boxes[i : i + 1, j : j + 1], rows.reshape(1, 1, 9), columns.reshape(1, 1, 9), OUTPUT_CELLS
        )
        built[..., 6] = 10 * (2 * built[..., 6] - 1)
        inside = (rows >= 0) & (rows < OUTPUT_CELLS) & (columns >= 0) & (columns < OUTPUT_CELLS)
        numbers[i, :, rows[inside], columns[inside]] = built[0, 0][inside.flatten()].T
    logits = torch.where(heat >= 1, 8.0, -8.0)
    answer = FusionAnswer(logits, numbers, torch.full((3, OUTPUT_CELLS, OUTPUT_CELLS), 8.0), torch.zeros(1))
    parts = {name: float(part) for name, part in compute_detection_losses(answer, truth).items()}
    assert parts["centre"] < 0.05 and parts["box"] < 0.05 and parts["overlap"] < 0.05 and parts["fit"] < 0.05
    found = decode_boxes(compute_scores(logits, answer.fit)[0].numpy(), numbers[0].numpy())
    expected = truth.boxes[0][truth.is_seen[0]].numpy().astype(np.float64)
    assert len(found.boxes) == len(expected)
    assert compute_ious(found.boxes, expected).max(axis=0) == pytest.approx(1.0, abs=1e-3)


def test_hidden_boxes_are_neither_rewarded_nor_punished(frames: FusionFrames) -> None:
    truth = make_truth(frames)
    nothing = TrueBoxes(truth.boxes, truth.classes, torch.zeros_like(truth.is_seen), truth.is_seen)
    at_boxes, elsewhere = (torch.full((3, 3, OUTPUT_CELLS, OUTPUT_CELLS), -9.0) for _ in range(2))
    row, column = locate_cells(truth.boxes, OUTPUT_CELLS)
    i, j = truth.is_seen.nonzero(as_tuple=True)
    at_boxes[i, truth.classes[i, j], row[i, j], column[i, j]] = 3.0
    elsewhere[0, 0, 1, 1] = 3.0
    zeros = torch.zeros(3, OUTPUT_CELLS, OUTPUT_CELLS)
    numbers = torch.zeros(3, 7, OUTPUT_CELLS, OUTPUT_CELLS)
    costs = [
        float(compute_detection_losses(FusionAnswer(heat, numbers, zeros, zeros), nothing)["centre"])
        for heat in (at_boxes, elsewhere)
    ]
    assert costs[0] < 0.01 < costs[1]


def test_the_estimated_overlap_is_near_the_exact_one() -> None:
    random = np.random.default_rng(0)
    true = np.column_stack(
        (random.uniform(-40, 40, (50, 2)), random.uniform(-3, 3, 50), np.full(50, 4.5), np.full(50, 1.9))
    )
    near = true + random.normal(0, (0.3, 0.3, 0.03, 0.2, 0.1), true.shape)
    row, column = locate_cells(torch.from_numpy(true)[None].float(), OUTPUT_CELLS)
    both = [
        build_targets(torch.from_numpy(each)[None].float(), row[..., None], column[..., None], OUTPUT_CELLS)[0, :, 0]
        for each in (near, true)
    ]
    exact = np.diag(compute_ious(near, true))
    assert np.abs(estimate_iou(*both).numpy() - exact).max() < 0.06 and exact.min() < 0.7


# The other fusions have no operation that these lack; each is exported and compared when it is trained.
@pytest.mark.parametrize(("detector", "is_gated"), [("early", False), ("disconet", True), ("cobevt", False)])
def test_exported_files_answer_as_pytorch(detector: str, is_gated: bool, frames: FusionFrames, tmp_path: Path) -> None:
    exported = export_fusion(make_checkpoint(detector, is_gated), tmp_path)
    assert exported.bytes <= MAX_FILES_BYTES and exported.difference < 1e-4 < 1e-2
    loaded = load_detector(detector, tmp_path)
    network = exporting.build_trained_network(make_checkpoint(detector, is_gated))
    store, shared = FrameStore(frames, CPU), choose_scans(frames, CONDITIONS[1])
    with torch.no_grad():
        answer = answer_frames(network, store, store.to_sharing(shared, slice(0, 1)))
    cells = [frames.get_scan(scan) for scan in shared.scan[0, :3]]
    if detector == "early":
        cells = [merge_cells(cells, shared.pose[0, :3])]
    features = np.stack([loaded.encode(each).features for each in cells])
    inputs: dict[str, Any] = {"features": features[0]}
    if detector in FUSIONS:
        arrived = np.ones((3, FEATURE_CELLS, FEATURE_CELLS), np.float32)
        inputs = {"features": features, "arrived": arrived, "pose": shared.pose[0, :3], "age": shared.age_s[0, :3]}
        assert len(loaded.detect(**inputs).boxes) == 0  # fresh weights find nothing
    scores, numbers = loaded.fusion.session.run(None, inputs)
    assert np.abs(scores - answer.scores[0].numpy()).max() < 2e-3
    assert np.abs(numbers - answer.numbers[0].numpy()).max() < 2e-2


def test_files_that_differ_or_are_large_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    exported = exporting.ExportedDetector(tmp_path / "none-encoder.onnx", tmp_path / "none.onnx", 2e-3, 0.0)
    with pytest.raises(InputError, match=r"none.onnx: expected answers within 0.001 of PyTorch's, found .* of 0.002"):
        exporting._check(exported)
    with pytest.raises(InputError, match="found a difference of nan"):
        exporting._check(replace(exported, difference=math.nan))
    monkeypatch.setattr(exporting, "MAX_FILES_BYTES", 1000)
    with pytest.raises(InputError, match="expected at most 1000 bytes with its encoder, found 10"):
        export_fusion(make_checkpoint("none"), tmp_path)


def test_weights_of_another_detector_or_of_none_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        load_detector("fcooper", tmp_path)
    manifest = {"format_version": 1, "system": "none-encoder", "sha256": "0" * 64, "bytes": 1, "parameters": 0}
    (tmp_path / "early-encoder.json").write_text(json.dumps(manifest))
    with pytest.raises(InputError, match="expected those of the system 'early-encoder', found 'none-encoder'"):
        load_detector("early", tmp_path)
    with pytest.raises(InputError, match="detector 'late': expected one of"):
        load_detector("late", tmp_path)
