"""FrameStore: frames in the memory of one device, and batches of grids, poses and boxes of them."""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from mdrive_sumo.agents.learned.fusion_spec import (
    DELAYS_TICKS,
    FORECAST_S,
    GRID_CELL_M,
    GRID_CELLS,
    GRID_LAYERS,
    GRID_REACH_M,
    MAX_COUNT,
)
from mdrive_sumo.agents.learned.point_grid import GRID_SIZE
from mdrive_sumo.core.clock import TICKS_PER_SECOND
from mdrive_sumo.learning.fusion.conditions import SharedScans
from mdrive_sumo.learning.fusion.frames import MOTION_S, FusionFrames

LAYER_CELLS = GRID_CELLS * GRID_CELLS


@dataclass(frozen=True, slots=True)
class Sharing:
    """What is shared in a batch of F frames: `SharedScans` as tensors."""

    scan: Tensor
    """(F, N) index of a scan; -1: none."""
    pose: Tensor
    """(F, N, 3)"""
    age_s: Tensor
    """(F, N)"""


@dataclass(frozen=True, slots=True)
class TrueBoxes:
    """Boxes of F frames in the own frame. Rows that are neither seen nor hidden hold nothing."""

    boxes: Tensor
    """(F, B, 5)"""
    classes: Tensor
    """(F, B) int64"""
    is_seen: Tensor
    """(F, B): a scan that the detector gets has points on the box."""
    is_hidden: Tensor
    """(F, B): no scan has. Training neither rewards nor punishes what is found there."""


@dataclass(frozen=True, slots=True)
class BoxMotion:
    """Where the boxes of F frames go, in the own frame."""

    boxes: Tensor
    """(F, B, len(FORECAST_S), 5) at FORECAST_S; the sides do not change. 0 where a box is not there."""
    is_there: Tensor
    """(F, B, len(FORECAST_S)): whether the road user is in the world then."""
    velocity: Tensor
    """(F, B, 2) [m/s] mean of the last half second; 0 where it is not known."""
    is_moving: Tensor
    """(F, B): whether the velocity is known."""


class FrameStore:
    """The arrays of frames as tensors; scans stay sparse until a batch needs their grids."""

    def __init__(self, frames: FusionFrames, device: torch.device) -> None:
        self.device = device
        self.frames = len(frames)
        # Indices take 27 bits: int32 holds them on devices where uint32 has few operations.
        self._cells = torch.from_numpy(frames.cells.view(np.int32)).to(device)
        self._starts = torch.from_numpy(frames.scan_starts).to(device)
        self._scan = torch.from_numpy(frames.scan).to(device, torch.int64)
        self._poses = torch.from_numpy(
            np.nan_to_num(np.stack((frames.true_pose, frames.estimated_pose)))
        ).to(device)  # fmt: skip
        self._boxes = torch.from_numpy(np.nan_to_num(frames.boxes)).to(device)
        self._classes = torch.from_numpy(frames.box_class).to(device, torch.int64)
        self._points = torch.from_numpy(frames.box_points.astype(np.int32)).to(device)
        self._motion = None if frames.box_motion is None else torch.from_numpy(frames.box_motion).to(device)

    def share(self, rows: Tensor, delay: Tensor, is_estimated: Tensor) -> Sharing:
        """Return the scans of frames. delay: (F, N) index into DELAYS_TICKS. is_estimated: (F,) which pose is taken."""
        frame, car = rows[:, None], torch.arange(delay.shape[1], device=self.device)
        scan = self._scan[frame, car, delay]
        pose = self._poses[is_estimated.long()[:, None], frame, car, delay]
        ages = torch.tensor(DELAYS_TICKS, device=self.device) / TICKS_PER_SECOND
        return Sharing(scan, pose, ages[delay])

    def to_sharing(self, shared: SharedScans, rows: slice) -> Sharing:
        """Return some frames of what a condition shares."""
        scan, pose, age = (
            torch.from_numpy(each[rows]).to(self.device) for each in (shared.scan, shared.pose, shared.age_s)
        )
        return Sharing(scan.long(), pose, age)

    def take_boxes(self, rows: Tensor, is_there: Tensor) -> TrueBoxes:
        """Return the boxes of frames; is_there: (F, N) whose scans the detector gets."""
        classes = self._classes[rows]
        has_points = ((self._points[rows] > 0) & is_there[:, None]).any(dim=2)
        return TrueBoxes(
            self._boxes[rows], classes.clamp(min=0), (classes >= 0) & has_points, (classes >= 0) & ~has_points
        )

    def take_motion(self, rows: Tensor) -> BoxMotion:
        """Return where the boxes of frames go. The frames need `box_motion`."""
        assert self._motion is not None, "checked by check_motion"
        now, motion, classes = self._boxes[rows], self._motion[rows], self._classes[rows]
        poses = torch.cat((now[:, :, None, :3], motion[:, :, 1:]), dim=2)
        is_there = torch.isfinite(poses).all(dim=-1) & (classes >= 0)[..., None]
        sides = now[:, :, None, 3:].expand(-1, -1, len(FORECAST_S), -1)
        before = motion[:, :, 0, :2]
        velocity = (now[..., :2] - before) / -MOTION_S[0]
        is_moving = torch.isfinite(before).all(dim=-1)
        return BoxMotion(
            torch.cat((torch.nan_to_num(poses), sides), dim=-1),
            is_there,
            torch.where(is_moving[..., None], velocity, 0.0),
            is_moving,
        )

    def build_grids(self, scans: Tensor) -> Tensor:
        """Return the grids (M, GRID_LAYERS, GRID_CELLS, GRID_CELLS) of scans (M,), ln(1 + count)."""
        which, cell, count = self._gather(scans)
        grids = torch.zeros(len(scans) * GRID_SIZE, device=self.device)
        grids[which * GRID_SIZE + cell] = torch.log1p(count)
        return grids.reshape(-1, GRID_LAYERS, GRID_CELLS, GRID_CELLS)

    def build_merged_grids(self, sharing: Sharing) -> Tensor:
        """Return one grid for each frame with the cells of all its cars (F, GRID_LAYERS, ...), as `merge_cells`."""
        frame, car = torch.nonzero(sharing.scan >= 0, as_tuple=True)
        which, cell, count = self._gather(sharing.scan[frame, car])
        x, y, yaw = sharing.pose[frame, car].unbind(dim=-1)
        cos, sin = torch.cos(yaw)[which], torch.sin(yaw)[which]
        ahead = GRID_REACH_M - (torch.div(cell, GRID_CELLS, rounding_mode="floor") % GRID_CELLS + 0.5) * GRID_CELL_M
        left = GRID_REACH_M - (cell % GRID_CELLS + 0.5) * GRID_CELL_M
        row = torch.floor((GRID_REACH_M - (x[which] + cos * ahead - sin * left)) / GRID_CELL_M).long()
        column = torch.floor((GRID_REACH_M - (y[which] + sin * ahead + cos * left)) / GRID_CELL_M).long()
        inside = (row >= 0) & (row < GRID_CELLS) & (column >= 0) & (column < GRID_CELLS)
        layer = torch.div(cell, LAYER_CELLS, rounding_mode="floor")
        index = frame[which] * GRID_SIZE + (layer * GRID_CELLS + row) * GRID_CELLS + column
        grids = torch.zeros(len(sharing.scan) * GRID_SIZE, device=self.device)
        grids.index_add_(0, index[inside], count[inside])
        return grids.clamp_(max=MAX_COUNT).log1p_().reshape(-1, GRID_LAYERS, GRID_CELLS, GRID_CELLS)

    def _gather(self, scans: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Return, for each occupied cell of scans (M,): which scan (of the M), index of the cell, count."""
        begin, size = self._starts[scans], self._starts[scans + 1] - self._starts[scans]
        which = torch.repeat_interleave(torch.arange(len(scans), device=self.device), size)
        first = torch.cumsum(size, 0) - size
        packed = self._cells[torch.arange(len(which), device=self.device) + (begin - first)[which]].long()
        return which, packed >> 8, (packed & 255).float()


def mirror(
    grids: Tensor, pose: Tensor, boxes: Tensor, is_mirrored: Tensor, frame: Tensor
) -> tuple[Tensor, Tensor, Tensor]:
    """Return a batch with left and right exchanged in some frames, of all cars alike.

    grids: (M, ...) of the frames `frame` (M,). pose: (F, N, 3). boxes: (F, B, 5). is_mirrored: (F,).
    """
    sign = torch.where(is_mirrored, -1.0, 1.0)
    turned = torch.where(is_mirrored[frame][:, None, None, None], grids.flip(-1), grids)
    signs = torch.stack((torch.ones_like(sign), sign, sign), dim=-1)[:, None]
    return turned, pose * signs, torch.cat((boxes[..., :3] * signs, boxes[..., 3:]), dim=-1)
