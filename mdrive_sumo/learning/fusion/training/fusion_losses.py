"""What the answers of a detector cost: centres, boxes, how well boxes fit, confidence, and distance from a teacher."""

import math
from collections.abc import Mapping
from types import MappingProxyType

import torch
from torch import Tensor
from torch.nn import functional

from mdrive_sumo.agents.learned.box_decoding import HALF_TURN_FROM_RAD
from mdrive_sumo.agents.learned.fusion_spec import CLASSES, GRID_REACH_M
from mdrive_sumo.learning.fusion.networks.fusion_network import FusionAnswer
from mdrive_sumo.learning.fusion.training.frame_store import TrueBoxes

LOSS_WEIGHTS: Mapping[str, float] = MappingProxyType(
    {"centre": 1.0, "box": 1.0, "overlap": 1.0, "fit": 0.5, "confidence": 0.3, "teacher": 1.0, "occupancy": 0.5}
)
"""All parts are means over boxes of about 0.3 to 3 after the first steps."""
SPREAD_SHARE, LEAST_SPREAD = 0.25, 0.7
"""Standard deviation of a centre's target: a share of the root of the box's area, at least 0.7 cells."""
REACH_CELLS = 3
"""Targets of a centre end so many cells from it."""


def compute_detection_losses(answer: FusionAnswer, truth: TrueBoxes) -> dict[str, Tensor]:
    """Return the parts of the loss of a detector's answer, unweighted."""
    heat, ignored = draw_centres(truth, answer.heat.shape[-1])
    boxes, overlap, fit = compute_box_losses(answer, truth)
    return {"centre": compute_centre_loss(answer.heat, heat, ignored), "box": boxes, "overlap": overlap, "fit": fit}


def sum_losses(parts: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Return the parts and their weighted sum as `total`."""
    weighted = [LOSS_WEIGHTS[name] * part for name, part in parts.items()]
    return {**parts, "total": torch.stack(weighted).sum()}


def locate_cells(boxes: Tensor, cells: int) -> tuple[Tensor, Tensor]:
    """Return row and column (F, B), int64, of the cell of each centre, in maps of so many cells along an edge."""
    cell_m = 2 * GRID_REACH_M / cells
    place = torch.floor((GRID_REACH_M - boxes[..., :2]) / cell_m).long().clamp(0, cells - 1)
    return place[..., 0], place[..., 1]


def draw_centres(truth: TrueBoxes, cells: int) -> tuple[Tensor, Tensor]:
    """Return targets of centres and where training does not look: both (F, classes, cells, cells) in [0, 1].

    A target is 1 in the cell of a centre and falls as a normal distribution around it (Law and Deng 2018, CornerNet).
    """
    row, column = locate_cells(truth.boxes, cells)
    cell_m = 2 * GRID_REACH_M / cells
    area = truth.boxes[..., 3] * truth.boxes[..., 4]
    spread = (SPREAD_SHARE * torch.sqrt(area) / cell_m).clamp(min=LEAST_SPREAD)
    offsets = torch.arange(-REACH_CELLS, REACH_CELLS + 1, device=row.device)
    rows, columns = row[..., None, None] + offsets[:, None], column[..., None, None] + offsets
    squared = (offsets[:, None] * offsets[:, None] + offsets * offsets).float()
    values = torch.exp(-squared / (2 * (spread * spread)[..., None, None]))
    inside = (rows >= 0) & (rows < cells) & (columns >= 0) & (columns < cells)
    index = (truth.classes[..., None, None] * cells + rows.clamp(0, cells - 1)) * cells + columns.clamp(0, cells - 1)
    maps: list[Tensor] = []
    for chosen in (truth.is_seen, truth.is_hidden):
        drawn = torch.zeros((len(row), len(CLASSES) * cells * cells), device=row.device)
        kept = values * (inside & chosen[..., None, None])
        drawn.scatter_reduce_(1, index.flatten(1), kept.flatten(1), "amax")
        maps.append(drawn.reshape(-1, len(CLASSES), cells, cells))
    return maps[0], maps[1]


def compute_centre_loss(logits: Tensor, target: Tensor, ignored: Tensor) -> Tensor:
    """Return the focal loss of centres for each true box (Law and Deng 2018: alpha 2, beta 4).

    ignored: cells near hidden boxes count less, and not at all in their centres.
    """
    logits = logits.float()
    probability = torch.sigmoid(logits).clamp(1e-4, 1 - 1e-4)
    is_centre = target >= 1.0
    away = (1 - target) * (1 - target)
    found = (1 - probability) * (1 - probability) * torch.log(probability)
    wrong = probability * probability * torch.log(1 - probability) * away * away * (1 - ignored)
    return -torch.where(is_centre, found, wrong).sum() / (is_centre.sum() + 1.0)


def compute_box_losses(answer: FusionAnswer, truth: TrueBoxes) -> tuple[Tensor, Tensor, Tensor]:
    """Return losses of the numbers, of the overlap and of the expected overlap, at the cells in and around centres.

    Nine cells answer for a box, because the peak may lie in a neighbour; neighbours count a third.
    """
    cells = answer.numbers.shape[-1]
    row, column = locate_cells(truth.boxes, cells)
    steps = torch.arange(-1, 2, device=row.device)
    rows = (row[..., None, None] + steps[:, None]).expand(-1, -1, 3, 3).flatten(2)
    columns = (column[..., None, None] + steps).expand(-1, -1, 3, 3).flatten(2)
    inside = (rows >= 0) & (rows < cells) & (columns >= 0) & (columns < cells)
    share = torch.full((9,), 1 / 3, device=row.device)
    share[4] = 1.0
    weight = share * (inside & truth.is_seen[..., None])
    index = rows.clamp(0, cells - 1) * cells + columns.clamp(0, cells - 1)
    flat = index.flatten(1)
    numbers = answer.numbers.flatten(2).float().gather(2, flat[:, None].expand(-1, answer.numbers.shape[1], -1))
    numbers = numbers.transpose(1, 2).reshape(*index.shape, -1)
    fit = answer.fit.flatten(1).float().gather(1, flat).reshape(index.shape)
    target = build_targets(truth.boxes, rows, columns, cells)
    total = weight.sum() + 1.0
    smooth = functional.smooth_l1_loss(numbers[..., :6], target[..., :6], reduction="none", beta=0.1).sum(dim=-1)
    heading = functional.binary_cross_entropy_with_logits(numbers[..., 6], target[..., 6], reduction="none")
    overlap = estimate_iou(numbers, target)
    judged = functional.binary_cross_entropy_with_logits(fit, overlap.detach(), reduction="none")
    parts = (smooth + 0.2 * heading, 1 - overlap, judged)
    return tuple((part * weight).sum() / total for part in parts)  # pyright: ignore[reportReturnType]


def build_targets(boxes: Tensor, rows: Tensor, columns: Tensor, cells: int) -> Tensor:
    """Return the numbers (F, B, K, BOX_NUMBERS) that cells (F, B, K) should answer; the last one is 0 or 1."""
    cell_m = 2 * GRID_REACH_M / cells
    x, y, yaw, length, width = (each[..., None] for each in boxes.unbind(dim=-1))
    dx, dy = x - (GRID_REACH_M - (rows + 0.5) * cell_m), y - (GRID_REACH_M - (columns + 0.5) * cell_m)
    sides = [torch.log(side.clamp(min=0.1)).expand_as(dx) for side in (length, width)]
    turned = [each.expand_as(dx) for each in (torch.cos(2 * yaw), torch.sin(2 * yaw))]
    is_ahead = (torch.cos(yaw - HALF_TURN_FROM_RAD) > 0).float().expand_as(dx)
    return torch.stack((dx, dy, *sides, *turned, is_ahead), dim=-1)


def estimate_iou(numbers: Tensor, target: Tensor) -> Tensor:
    """Return an estimate of the intersection over union (...) of boxes given as numbers (..., BOX_NUMBERS).

    A surrogate: both boxes are taken to lie along the axis of the true one, and the result falls with the square of
    the cosine of the angle between their axes. For axes within 5 degrees it is near the exact value.
    """
    cos2, sin2 = target[..., 4], target[..., 5]
    cos, sin = torch.sqrt(((1 + cos2) / 2).clamp(min=0.0)), torch.sqrt(((1 - cos2) / 2).clamp(min=0.0))
    sin = torch.where(sin2 < 0, -sin, sin)
    step_x, step_y = (numbers[..., i] - target[..., i] for i in (0, 1))
    along, aside = (cos * step_x + sin * step_y).abs(), (cos * step_y - sin * step_x).abs()
    common = torch.ones_like(along)
    areas = torch.zeros_like(along)
    sides = [(torch.exp(numbers[..., i].clamp(-3.0, 4.0)), torch.exp(target[..., i])) for i in (2, 3)]
    for gap, (found, true) in zip((along, aside), sides, strict=True):
        common = common * torch.relu(torch.minimum(torch.minimum(found, true), (found + true) / 2 - gap))
    areas = sides[0][0] * sides[1][0] + sides[0][1] * sides[1][1]
    norm = torch.sqrt(numbers[..., 4] * numbers[..., 4] + numbers[..., 5] * numbers[..., 5] + 1e-6)
    aligned = (1 + (numbers[..., 4] * cos2 + numbers[..., 5] * sin2) / norm) / 2  # squared cosine of the angle between
    return common / (areas - common) * aligned


def compute_confidence_loss(logits: Tensor, truth: TrueBoxes) -> Tensor:
    """Return the loss of the own confidence (F, cells, cells): centres of any class that the own scan has points on."""
    heat, ignored = draw_centres(truth, logits.shape[-1])
    return compute_centre_loss(logits, heat.amax(dim=1), ignored.amax(dim=1))


def compute_teacher_loss(fused: Tensor, taught: Tensor) -> Tensor:
    """Return the mean squared distance of features (F, C, H, W) from a teacher's, where either has something.

    DiscoNet compares distributions of features over channels (Li et al. 2021, section 3.3); here features are at least
    0 and mostly 0, and have no distribution in empty cells.
    """
    gap = (fused.float() - taught.float()).square().sum(dim=1)
    is_filled = (taught.amax(dim=1) > 0) | (fused.detach().amax(dim=1) > 0)
    return (gap * is_filled).sum() / (is_filled.sum() + 1.0) / math.sqrt(fused.shape[1])
