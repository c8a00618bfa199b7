"""What a sensor must see: boxes through which its view goes cannot be there.

The free view of an `objects` sensor is exact: each of its rays ends at the first vehicle, high obstacle or building,
whatever the detector makes of it. A ray that passes through the middle of a reported box and goes on refutes the box.
"""

from dataclasses import dataclass

import numpy as np

from mdrive_sumo.contract import Objects, OwnState
from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import TAU, Bool, Float
from mdrive_sumo.core.state import Kind, RoadUsers
from mdrive_sumo.v2x.messages import ReferencePose


@dataclass(frozen=True, slots=True)
class FreeViewParameters:
    """Parameters of `find_seen_through`."""

    edge_m: float = 0.3
    """[m] What the ray must miss the edges of a box by. Errors of poses and detections (0.2 and 0.13 m near the car)
    are larger together, so that a single refutation proves nothing: see `ClaimHistory`."""
    behind_m: float = 1.0
    """[m] How far the ray must go on behind the box: five standard deviations of an estimated position."""
    near_m: float = 2.5
    """[m] A box with a detection of the own sensor nearer than this is none that it must have missed: centres of two
    vehicles are never nearer unless side by side."""
    own_radius_m: float = 3.5
    """[m] A box whose centre is nearer than this is the own car, late by up to 0.1 s at 13 m/s beside 2.5 m."""
    low_m: float = 2.5
    """[m] Obstacles up to this size hide nothing (docs/sensors.md), so that views go over them."""
    range_m: float = 60.0
    """[m] Further away two rays are 5 m apart, and errors of yaw (0.2 degrees) add 0.2 m."""


FREE_VIEW = FreeViewParameters()


def find_opaque(boxes: RoadUsers, parameters: FreeViewParameters = FREE_VIEW) -> Bool:
    """Return an (N,) mask of the boxes that end a view: vehicles and high obstacles."""
    is_high = (boxes.kind == Kind.STATIC) & (np.maximum(boxes.length, boxes.width) > parameters.low_m)
    return np.asarray((boxes.kind == Kind.VEHICLE) | is_high)


def find_near(boxes: RoadUsers, seen: Objects, parameters: FreeViewParameters = FREE_VIEW) -> Bool:
    """Return an (N,) mask of the boxes near a detection."""
    if not seen.ids:
        return np.zeros(len(boxes), dtype=np.bool_)
    dx, dy = boxes.x[:, None] - seen.x, boxes.y[:, None] - seen.y
    return np.asarray((dx * dx + dy * dy).min(axis=1) < parameters.near_m * parameters.near_m)


def find_seen_through(
    boxes: RoadUsers, eye: OwnState | ReferencePose, free_m: Float, parameters: FreeViewParameters = FREE_VIEW
) -> Bool:
    """Return an (N,) mask of the boxes through whose middle a ray of the free view passes, and goes on.

    eye: where the view was taken from. free_m: (B,) as `Objects.free_m`.
    """
    dx, dy = eye.x - boxes.x, eye.y - boxes.y
    square = dx * dx + dy * dy
    rows = np.flatnonzero(
        (square > parameters.own_radius_m * parameters.own_radius_m)
        & (square < parameters.range_m * parameters.range_m)
        & find_opaque(boxes, parameters)
    )
    is_refuted = np.zeros(len(boxes), dtype=np.bool_)
    if len(rows) and len(free_m):
        is_refuted[rows] = _cast_rays(boxes.take(rows), eye, free_m, parameters)
    return is_refuted


def _cast_rays(boxes: RoadUsers, eye: OwnState | ReferencePose, free_m: Float, parameters: FreeViewParameters) -> Bool:
    """Return an (N,) mask as `find_seen_through`: the slab method in the frame of each box, for all rays at once."""
    cos, sin = portable.cos_sin(boxes.yaw)
    dx, dy = eye.x - boxes.x, eye.y - boxes.y
    begin = np.stack((cos * dx + sin * dy, cos * dy - sin * dx))[:, :, None]
    ray_cos, ray_sin = portable.cos_sin(eye.yaw + TAU / len(free_m) * np.arange(len(free_m)))
    cos, sin = cos[:, None], sin[:, None]
    direction = np.stack((cos * ray_cos + sin * ray_sin, cos * ray_sin - sin * ray_cos))
    direction = np.where(np.abs(direction) < 1e-12, 1e-12, direction)
    half = np.stack((boxes.length, boxes.width)) / 2 - parameters.edge_m
    half = np.maximum(half, 0.0)[:, :, None]
    first, second = (-half - begin) / direction, (half - begin) / direction
    enters, leaves = np.minimum(first, second).max(axis=0), np.maximum(first, second).min(axis=0)
    passes = (enters > 0.0) & (leaves > enters) & (free_m > leaves + parameters.edge_m + parameters.behind_m)
    return np.asarray(passes.any(axis=1))
