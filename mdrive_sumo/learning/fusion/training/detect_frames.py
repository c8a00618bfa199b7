"""detect_frames: the boxes that a network finds in frames under a condition, in batches on one device."""

import numpy as np
import torch
from torch import Tensor

from mdrive_sumo.agents.learned.box_decoding import DetectedBoxes, decode_boxes, merge_boxes
from mdrive_sumo.agents.learned.fusion_spec import FEATURE_CELLS, MAX_CAVS, SHARING
from mdrive_sumo.learning.fusion.conditions import CONDITIONS, SharingCondition, choose_scans
from mdrive_sumo.learning.fusion.frames import FusionFrames
from mdrive_sumo.learning.fusion.networks.fusion_network import FusionAnswer, FusionNetwork
from mdrive_sumo.learning.fusion.training.forecast_losses import build_occupancy_truth, draw_track_maps, know_tracks
from mdrive_sumo.learning.fusion.training.frame_store import FrameStore, Sharing

BATCH = 16
"""Frames that are detected at once."""


def detect_frames(
    network: FusionNetwork,
    frames: FusionFrames,
    store: FrameStore,
    condition: SharingCondition,
    is_late: bool = False,
    batch: int = BATCH,
) -> list[DetectedBoxes]:
    """Return the boxes of every frame. store: of the same frames. is_late: merge the boxes that `network`, a `none`,
    finds in the scan of each car."""
    shared = choose_scans(frames, condition)
    found: list[DetectedBoxes] = []
    for begin in range(0, len(frames), batch):
        sharing = store.to_sharing(shared, slice(begin, begin + batch))
        with torch.no_grad():
            if is_late:
                found += _detect_late(network, store, sharing)
            else:
                found += decode_answer(answer_frames(network, store, sharing))
    return found


def answer_frames(network: FusionNetwork, store: FrameStore, sharing: Sharing) -> FusionAnswer:
    """Return what a network in evaluation mode answers of what is shared; all tiles arrive."""
    if network.detector == "early":
        return answer_own(network, store.build_merged_grids(sharing))
    if network.detector not in SHARING:
        return answer_own(network, store.build_grids(sharing.scan[:, 0]))
    frame, car = torch.nonzero(sharing.scan >= 0, as_tuple=True)
    features, _ = network.encoder(store.build_grids(sharing.scan[frame, car]))
    dense = features.new_zeros((len(sharing.scan), MAX_CAVS, *features.shape[1:]))
    dense[frame, car] = features
    arrived = (sharing.scan >= 0).to(features.dtype)[..., None, None].expand(-1, -1, FEATURE_CELLS, FEATURE_CELLS)
    return network(dense, arrived, sharing.pose, sharing.age_s)


def answer_own(network: FusionNetwork, grids: Tensor) -> FusionAnswer:
    """Return what a network without fusion answers of grids (M, ...)."""
    features, _ = network.encoder(grids)
    ones = features.new_ones((len(features), 1, FEATURE_CELLS, FEATURE_CELLS))
    return network(features[:, None], ones, features.new_zeros((len(features), 1, 3)), ones[:, :, 0, 0])


def decode_answer(answer: FusionAnswer) -> list[DetectedBoxes]:
    """Return the boxes of each frame of an answer."""
    scores, numbers = answer.scores.float().cpu().numpy(), answer.numbers.float().cpu().numpy()
    return [decode_boxes(*each) for each in zip(scores, numbers, strict=True)]


def _detect_late(network: FusionNetwork, store: FrameStore, sharing: Sharing) -> list[DetectedBoxes]:
    frame, car = torch.nonzero(sharing.scan >= 0, as_tuple=True)
    single = decode_answer(answer_own(network, store.build_grids(sharing.scan[frame, car])))
    frames, poses = frame.cpu().numpy(), sharing.pose[frame, car].cpu().numpy()
    rows = [np.flatnonzero(frames == i) for i in range(len(sharing.scan))]
    return [merge_boxes([single[row] for row in each], poses[each]) for each in rows]


def measure_forecast(network: FusionNetwork, frames: FusionFrames, store: FrameStore, batch: int = BATCH) -> float:
    """Return the overlap of forecast and true occupancy, in [0, 1]: the mean over times of sums of the smaller of both
    over sums of the larger. All tiles arrive, and tracks have no errors."""
    assert network.forecast is not None, "of codriving only"
    shared = choose_scans(frames, CONDITIONS[0])
    both: list[Tensor] = []
    for begin in range(0, len(frames), batch):
        sharing = store.to_sharing(shared, slice(begin, begin + batch))
        rows = torch.arange(begin, begin + len(sharing.scan), device=store.device)
        truth, motion = store.take_boxes(rows, sharing.scan >= 0), store.take_motion(rows)
        with torch.no_grad():
            fused = answer_frames(network, store, sharing).fused
            logits = network.forecast(fused, draw_track_maps(know_tracks(motion, truth.is_seen)))
        wanted = build_occupancy_truth(motion, truth)
        found = torch.sigmoid(logits.float()) * wanted.is_taught
        overlap = [each(found, wanted.occupied).sum(dim=(0, 2, 3)) for each in (torch.minimum, torch.maximum)]
        both.append(torch.stack(overlap))
    smaller, larger = torch.stack(both).sum(dim=0)
    return float((smaller / larger.clamp(min=1e-6)).mean())
