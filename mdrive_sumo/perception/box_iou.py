"""Intersection over union of oriented boxes."""

import numpy as np
import shapely

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Bool, Float, Int, boxes_corners


def compute_ious(first: Float, second: Float) -> Float:
    """Return the intersection over union (N, M) of oriented boxes (N, 5) and (M, 5): x, y, yaw, length, width."""
    reach = [portable.hypot(boxes[:, 3], boxes[:, 4]) / 2 for boxes in (first, second)]
    apart = first[:, None, :2] - second[None, :, :2]
    rows, columns = np.nonzero(portable.hypot(apart[..., 0], apart[..., 1]) < reach[0][:, None] + reach[1])
    own, other = (shapely.polygons(boxes_corners(*boxes.T)) for boxes in (first[rows], second[columns]))
    common = np.zeros((len(first), len(second)))
    common[rows, columns] = shapely.area(shapely.intersection(own, other))
    areas = [boxes[:, 3] * boxes[:, 4] for boxes in (first, second)]
    return common / (areas[0][:, None] + areas[1] - common)


def suppress_overlaps(boxes: Float, scores: Float, classes: Int, max_iou: float) -> Int:
    """Return the rows that are kept, best first: none overlaps a better one of its class by more than `max_iou`.

    boxes: (N, 5). scores, classes: (N,). Of equal scores the first row wins.
    """
    order = np.argsort(-scores, kind="stable")
    ranked, kinds = boxes[order], classes[order]
    clash: Bool = (compute_ious(ranked, ranked) > max_iou) & (kinds[:, None] == kinds)
    kept: list[int] = []
    is_free = np.ones(len(order), dtype=np.bool_)
    for i in range(len(order)):
        if is_free[i]:
            kept.append(i)
            is_free &= ~clash[i]
    return order[np.array(kept, dtype=np.int64)]
