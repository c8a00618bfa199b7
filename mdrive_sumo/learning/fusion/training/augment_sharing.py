"""What goes wrong on the way of features, drawn for each batch: poses, delays, lost tiles and senders, quantisation."""

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from mdrive_sumo.agents.learned.fusion_spec import DELAYS_TICKS, MAX_CAVS, TILE_CELLS, TILE_ROWS
from mdrive_sumo.learning.fusion.training.frame_store import FrameStore, Sharing

MAX_POSE_ERROR_M = 0.6
"""Each frame has a standard deviation of its own up to it, in metres and, as many, in degrees: the range of the
tables."""
MAX_TILE_LOSS = 0.5
FEWEST_TILES = 8
"""Of 64: a small budget."""
PERFECT_SHARE = 0.3
"""Of frames with true poses, newest scans and all tiles."""
MISSING_SHARE = 0.1
"""Of senders."""
BITS = 6
"""Of a quantised feature, as messages have by default."""
LEVELS = (1 << BITS) - 1


@dataclass(frozen=True, slots=True)
class DrawnFrames:
    """How the frames of a batch (F,) are changed."""

    sharing: Sharing
    is_perfect: Tensor
    """(F,)"""
    is_mirrored: Tensor
    """(F,)"""


def draw_sharing(store: FrameStore, rows: Tensor, generator: torch.Generator) -> DrawnFrames:
    """Return the scans and poses of frames, with errors."""
    count, device = len(rows), store.device

    def draw(*shape: int) -> Tensor:
        return torch.rand(shape, generator=generator, device=device)

    is_perfect = draw(count) < PERFECT_SHARE
    delay = (draw(count, MAX_CAVS) * len(DELAYS_TICKS)).long()
    delay = torch.where(is_perfect[:, None], 0, delay)
    delay[:, 0] = 0
    sharing = store.share(rows, delay, (draw(count) < 0.5) & ~is_perfect)
    is_lost = draw(count, MAX_CAVS) < MISSING_SHARE
    is_lost[:, 0] = False
    scale = draw(count) * MAX_POSE_ERROR_M * ~is_perfect
    unit = torch.tensor((1.0, 1.0, math.radians(1.0)), device=device)
    error = torch.randn((count, MAX_CAVS, 3), generator=generator, device=device) * scale[:, None, None] * unit
    error[:, 0] = 0.0
    scan = torch.where(is_lost, -1, sharing.scan)
    return DrawnFrames(Sharing(scan, sharing.pose + error, sharing.age_s), is_perfect, draw(count) < 0.5)


def draw_arrived(confidence: Tensor, is_there: Tensor, is_perfect: Tensor, generator: torch.Generator) -> Tensor:
    """Return which cells arrived (F, N, H, W) as 0 or 1: lost packets, and budgets that only confident tiles fit into.

    confidence: (F, N, H, W) of senders. is_there: (F, N). is_perfect: (F,). The own map is whole.
    """
    frames, cars = is_there.shape
    device = confidence.device
    peaks = torch.nn.functional.max_pool2d(confidence, TILE_CELLS).flatten(2)  # (F, N, tiles)
    order = torch.sort(peaks, dim=2, descending=True, stable=True).indices
    rank = torch.sort(order, dim=2).indices
    draws = torch.rand((frames, cars, 3), generator=generator, device=device)
    tiles = TILE_ROWS * TILE_ROWS
    budget = torch.where(draws[..., 0] < 0.5, FEWEST_TILES + draws[..., 1] * (tiles - FEWEST_TILES), tiles)
    loss = draws[..., 2] * MAX_TILE_LOSS
    is_lost = torch.rand((frames, cars, tiles), generator=generator, device=device) < loss[..., None]
    kept = ((rank < budget[..., None]) & ~is_lost) | is_perfect[:, None, None]
    kept[:, 0] = True
    arrived = (kept & is_there[..., None]).to(confidence.dtype).reshape(frames, cars, TILE_ROWS, TILE_ROWS)
    return arrived.repeat_interleave(TILE_CELLS, 2).repeat_interleave(TILE_CELLS, 3)


def quantise(features: Tensor) -> Tensor:
    """Return features (M, C, H, W) in the steps of a message; the gradient passes as if they were not rounded.

    Each channel of a map has steps of its own, so that its greatest value takes LEVELS.
    """
    exact = features.detach().float()  # 6 bits of a quotient need more than the 8 bits of bfloat16
    step = (exact.amax(dim=(2, 3), keepdim=True) / LEVELS).clamp(min=1e-6)
    return features + (torch.round(exact / step) * step - exact).to(features.dtype)
