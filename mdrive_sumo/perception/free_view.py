"""What a sensor must see: boxes through which its view goes cannot be there.

The free view of an `objects` sensor is exact: each of its rays ends at the first vehicle, high obstacle or building,
whatever the detector makes of it. What is not exact is where a reported box stands in that view: its sender, its
detector and the own car err. So a box is refuted only if at every place where it may stand a ray passes through it.
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

    certainty: float = 2.0
    """Standard deviations that a box may be off by. Larger errors, one in 20, count only while the own detector misses
    the box for a second as well. In the honest drives of docs/defence.md no box was refuted for more than half a second
    with 2, for 0.8 s with 1.5; with 1.5 one sender was distrusted."""
    size_sigma: float = 0.03
    """Relative standard deviation of detected lengths and widths, and of detected yaws [rad] below: of the surrogates
    of detectors (docs/detections.md)."""
    box_yaw_sigma: float = 0.02
    behind_m: float = 0.4
    """[m] What a ray must go on behind the furthest place: free views in messages have steps of 0.4 m."""
    near_m: float = 2.5
    """[m] A box with a detection of the own sensor nearer than this is none that it must have missed: centres of two
    vehicles are never nearer unless side by side."""
    own_radius_m: float = 3.5
    """[m] A box whose centre is nearer than this is the own car, late by up to 0.1 s at 13 m/s beside 2.5 m."""
    low_m: float = 2.5
    """[m] Obstacles up to this size hide nothing (docs/sensors.md), so that views go over them."""
    range_m: float = 60.0
    """[m] Further away two rays are 5 m apart, more than a car is long."""
    least_cos: float = 0.2
    """Cosine of the largest angle between a ray and the direction of the box: others miss it or run along it."""


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
    boxes: RoadUsers,
    sigmas: Float,
    eye: OwnState | ReferencePose,
    free_m: Float,
    parameters: FreeViewParameters = FREE_VIEW,
) -> Bool:
    """Return an (N,) mask of the boxes through which a ray of the free view passes, wherever they may stand.

    boxes: such as end a view (`find_opaque`). sigmas: (N,) standard deviation [m] of each of their coordinates.
    eye: where the view was taken from, with its own errors. free_m: (B,) as `Objects.free_m`.
    """
    dx, dy = eye.x - boxes.x, eye.y - boxes.y
    square = dx * dx + dy * dy
    rows = np.flatnonzero(
        (square > parameters.own_radius_m * parameters.own_radius_m)
        & (square < parameters.range_m * parameters.range_m)
    )
    is_refuted = np.zeros(len(boxes), dtype=np.bool_)
    if len(rows) and len(free_m):
        is_refuted[rows] = _cast_rays(boxes.take(rows), sigmas[rows], eye, free_m, parameters)
    return is_refuted


def _cast_rays(
    boxes: RoadUsers, sigmas: Float, eye: OwnState | ReferencePose, free_m: Float, parameters: FreeViewParameters
) -> Bool:
    """Return an (N,) mask as `find_seen_through`, for all rays at once.

    Rays and boxes are projected from the eye on a line through the middle of the box, across the view. A box of a
    width is hit wherever it stands on that line if no two rays that pass are further apart than its width.
    """
    dx, dy = boxes.x - eye.x, boxes.y - eye.y
    distance = portable.hypot(dx, dy)
    ahead = dx / distance, dy / distance
    low, high, near, far = _project_boxes(boxes, distance, ahead)
    error = parameters.certainty * np.sqrt(
        sigmas * sigmas + eye.position_sigma * eye.position_sigma + portable.square(eye.yaw_sigma * distance)
    )
    size_error = parameters.certainty * portable.hypot(
        parameters.size_sigma * (high - low), parameters.box_yaw_sigma * (far - near)
    )
    across, is_passing = _project_rays(eye.yaw, free_m, distance, ahead, far + error + parameters.behind_m, parameters)
    error = error * distance / np.maximum(near, 1e-9)
    begin, end = (low - error)[:, None], (high + error)[:, None]
    stations = np.sort(np.where(is_passing, np.clip(across, begin, end), end), axis=1, kind="stable")
    gaps = np.diff(np.concatenate((begin, stations, end), axis=1), axis=1)
    return np.asarray((near > 0.0) & (gaps.max(axis=1) < high - low - size_error))


def _project_boxes(boxes: RoadUsers, distance: Float, ahead: tuple[Float, Float]) -> tuple[Float, Float, Float, Float]:
    """Return the ends (N,) [m] of the boxes on the line across the view, and their least and largest depth [m]."""
    cos, sin = portable.cos_sin(boxes.yaw)
    along, across = cos * ahead[0] + sin * ahead[1], sin * ahead[0] - cos * ahead[1]
    half_length, half_width = boxes.length / 2, boxes.width / 2
    depths = np.stack([distance + i * along * half_length + j * across * half_width for i, j in CORNERS])
    sides = np.stack([i * across * half_length - j * along * half_width for i, j in CORNERS])
    near, far = depths.min(axis=0), depths.max(axis=0)
    projected = sides * distance / np.maximum(depths, 1e-9)
    return projected.min(axis=0), projected.max(axis=0), near, far


CORNERS = ((1, 1), (1, -1), (-1, -1), (-1, 1))


def _project_rays(
    yaw: float, free_m: Float, distance: Float, ahead: tuple[Float, Float], far: Float, parameters: FreeViewParameters
) -> tuple[Float, Bool]:
    """Return where the rays meet the line across the view (N, B) [m], and which of them reach a depth far (N,) [m]."""
    cos, sin = portable.cos_sin(yaw + TAU / len(free_m) * np.arange(len(free_m)))
    along = ahead[0][:, None] * cos + ahead[1][:, None] * sin
    across = ahead[0][:, None] * sin - ahead[1][:, None] * cos
    is_passing = (along > parameters.least_cos) & (free_m * along > far[:, None])
    return across * distance[:, None] / np.where(is_passing, along, 1.0), np.asarray(is_passing)
