"""Occupancy that a forecast learns: maps of moving boxes, tracks with errors as input, and the loss."""

from dataclasses import dataclass, replace

import torch
from torch import Tensor
from torch.nn import functional

from mdrive_sumo.agents.learned.fusion_spec import FORECAST_S, GRID_REACH_M, OUTPUT_CELL_M, OUTPUT_CELLS
from mdrive_sumo.agents.learned.occupancy_grid import LEAST_SIDE_M
from mdrive_sumo.learning.fusion.training.frame_store import BoxMotion, TrueBoxes

REACH_CELLS = 12
"""A box is drawn up to so many cells from its centre: 9.6 m, half of an articulated bus."""
MOST_UNTRACKED = 0.5
"""Share of road users that a frame's tracks lack, drawn for each frame: they came into sight a moment ago."""
NO_TRACKS_SHARE = 0.1
"""Of frames without any track: the first scans of a drive."""
TRACK_SIGMA_M = 0.3
"""Standard deviation of a track's place, along each axis: that of `detection_tracker.DETECTION_ERRORS`, rounded up."""
LEAST_SPEED_SIGMA, MOST_SPEED_SIGMA = 0.2, 1.8
"""[m/s] Of each component of a track's velocity, drawn for each track: two positions 0.2 s apart tell a speed to 1.8
m/s, ten to 0.2 (`detection_tracker.TRACK_ERRORS`)."""
UNMOVED_SHARE = 0.1
"""Of tracks with speed 0: seen once so far."""
FALSE_TRACKS = 2
"""Tracks of nothing in a third of the frames, at random places."""


@dataclass(frozen=True, slots=True)
class DrawnTracks:
    """Tracks of F frames at constant velocity."""

    boxes: Tensor
    """(F, M, len(FORECAST_S), 5)"""
    is_there: Tensor
    """(F, M)"""


def draw_occupancy(boxes: Tensor, is_drawn: Tensor) -> Tensor:
    """Return maps (F, T, OUTPUT_CELLS, OUTPUT_CELLS) of 0 and 1: a cell is covered if its centre lies in a box.

    boxes: (F, B, T, 5). is_drawn: (F, B, T). `agents.learned.occupancy_grid` does the same as it drives.
    """
    frames, _, times = is_drawn.shape
    steps = torch.arange(-REACH_CELLS, REACH_CELLS + 1, device=boxes.device)
    place = torch.floor((GRID_REACH_M - boxes[..., :2]) / OUTPUT_CELL_M).clamp(-1e4, 1e4).long()
    rows, columns = place[..., 0, None, None] + steps[:, None], place[..., 1, None, None] + steps
    x, y, yaw, length, width = (each[..., None, None] for each in boxes.unbind(dim=-1))
    ahead, left = (GRID_REACH_M - (each + 0.5) * OUTPUT_CELL_M for each in (rows, columns))
    cos, sin = torch.cos(yaw), torch.sin(yaw)
    along, aside = cos * (ahead - x) + sin * (left - y), cos * (left - y) - sin * (ahead - x)
    half_length, half_width = (side.clamp(min=LEAST_SIDE_M) / 2 for side in (length, width))
    is_covered = (along.abs() <= half_length) & (aside.abs() <= half_width) & is_drawn[..., None, None]
    is_covered &= (rows >= 0) & (rows < OUTPUT_CELLS) & (columns >= 0) & (columns < OUTPUT_CELLS)
    time = torch.arange(times, device=boxes.device)[:, None, None]
    index = (time * OUTPUT_CELLS + rows.clamp(0, OUTPUT_CELLS - 1)) * OUTPUT_CELLS + columns.clamp(0, OUTPUT_CELLS - 1)
    maps = torch.zeros((frames, times * OUTPUT_CELLS * OUTPUT_CELLS), device=boxes.device)
    maps.scatter_reduce_(1, index.flatten(1), is_covered.float().flatten(1), "amax")
    return maps.reshape(frames, times, OUTPUT_CELLS, OUTPUT_CELLS)


def draw_tracks(motion: BoxMotion, is_seen: Tensor, generator: torch.Generator) -> DrawnTracks:
    """Return what a tracker might know of the boxes: some are missing, all have errors, and a few are of nothing.

    is_seen: (F, B) boxes that the frame's scans have points on; others are not known.
    """
    frames, count = is_seen.shape
    device = is_seen.device

    def draw(*shape: int) -> Tensor:
        return torch.rand(shape, generator=generator, device=device)

    share = torch.where(draw(frames) < NO_TRACKS_SHARE, 1.0, draw(frames) * MOST_UNTRACKED)
    is_known = is_seen & (draw(frames, count) >= share[:, None])
    sigma = LEAST_SPEED_SIGMA + draw(frames, count, 1) * (MOST_SPEED_SIGMA - LEAST_SPEED_SIGMA)
    normals = torch.randn((frames, count, 4), generator=generator, device=device)
    is_moving = motion.is_moving & (draw(frames, count) >= UNMOVED_SHARE)
    velocity = torch.where(is_moving[..., None], motion.velocity + sigma * normals[..., :2], 0.0)
    now = motion.boxes[:, :, 0].clone()
    now[..., :2] += TRACK_SIGMA_M * normals[..., 2:]
    false = torch.zeros((frames, FALSE_TRACKS, 5), device=device)
    false[..., :3] = (2 * draw(frames, FALSE_TRACKS, 3) - 1) * torch.tensor((40.0, 40.0, 3.14), device=device)
    false[..., 3:] = torch.tensor((4.5, 1.9), device=device)
    is_false = (draw(frames, 1) < 1 / 3).expand(-1, FALSE_TRACKS)
    false_velocity = 10.0 * (2 * draw(frames, FALSE_TRACKS, 2) - 1)
    boxes, velocity = torch.cat((now, false), dim=1), torch.cat((velocity, false_velocity), dim=1)
    return DrawnTracks(advance_boxes(boxes, velocity), torch.cat((is_known, is_false), dim=1))


def know_tracks(motion: BoxMotion, is_seen: Tensor) -> DrawnTracks:
    """Return tracks without errors: what a forecast is measured with."""
    return DrawnTracks(advance_boxes(motion.boxes[:, :, 0], motion.velocity), is_seen)


def advance_boxes(boxes: Tensor, velocity: Tensor) -> Tensor:
    """Return boxes (F, M, len(FORECAST_S), 5) at FORECAST_S, of boxes (F, M, 5) and velocities (F, M, 2) [m/s]."""
    times = torch.tensor(FORECAST_S, device=boxes.device)[:, None]
    moved = boxes[:, :, None].repeat(1, 1, len(FORECAST_S), 1)
    moved[..., :2] += times * velocity[:, :, None]
    return moved


def draw_track_maps(tracks: DrawnTracks) -> Tensor:
    """Return the input `tracks` (F, len(FORECAST_S), OUTPUT_CELLS, OUTPUT_CELLS) of tracks."""
    return draw_occupancy(tracks.boxes, tracks.is_there[..., None].expand(-1, -1, len(FORECAST_S)))


def mirror_motion(motion: BoxMotion, is_mirrored: Tensor) -> BoxMotion:
    """Return motion with left and right exchanged in some frames (F,)."""
    sign = torch.where(is_mirrored, -1.0, 1.0)
    one = torch.ones_like(sign)
    boxes = motion.boxes * torch.stack((one, sign, sign, one, one), dim=-1)[:, None, None]
    return replace(motion, boxes=boxes, velocity=motion.velocity * torch.stack((one, sign), dim=-1)[:, None])


@dataclass(frozen=True, slots=True)
class OccupancyTruth:
    """Maps (F, len(FORECAST_S), OUTPUT_CELLS, OUTPUT_CELLS)."""

    occupied: Tensor
    """1 where a box is that a scan of the frame has points on."""
    is_taught: Tensor
    """1 where training looks: not where only boxes are that no scan shows, and not after the end of the drive."""


def build_occupancy_truth(motion: BoxMotion, truth: TrueBoxes) -> OccupancyTruth:
    """Return what a forecast should answer."""
    occupied = draw_occupancy(motion.boxes, motion.is_there & truth.is_seen[..., None])
    hidden = draw_occupancy(motion.boxes, motion.is_there & truth.is_hidden[..., None])
    has_boxes = (truth.is_seen | truth.is_hidden).any(dim=1)
    is_over = has_boxes[:, None] & ~motion.is_there.any(dim=1)
    is_taught = (1 - hidden * (1 - occupied)) * ~is_over[..., None, None]
    return OccupancyTruth(occupied * is_taught, is_taught)


def compute_occupancy_loss(logits: Tensor, truth: OccupancyTruth) -> Tensor:
    """Return the cross entropy of all cells for each occupied one: its minimum are calibrated probabilities."""
    each = functional.binary_cross_entropy_with_logits(logits.float(), truth.occupied, reduction="none")
    return (each * truth.is_taught).sum() / (truth.occupied.sum() + 100.0)
