"""Casting of rays on upright prisms: oriented boxes of any height, and walls that are higher than the sensor.

Everything is seen from the outside only: what encloses the sensor does not exist for it. Distances are horizontal.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mdrive_sumo.core import portable
from mdrive_sumo.core.compiled import twin
from mdrive_sumo.core.geometry import TAU, Bool, Float, Int, wrap_angles
from mdrive_sumo.sensing.lidar_rays import LidarRays

HitKeys = npt.NDArray[np.int64]
"""Distance as the bits of a float32, which sort as the numbers do, and behind it the owner: the least one wins."""

EDGE_SLACK = 1e-9
"""Share of a wall's length, and a direction [rad], by which walls are longer: neighbouring walls leave no gap."""
CORNERS = np.array(((1, -1, -1, 1), (1, 1, -1, -1)))[:, :, None]
"""Signs of the corners of a box: ahead or behind, and left or right."""
TOUCH_M = 1e-9
"""What is nearer counts as so far away."""


@dataclass(frozen=True, slots=True)
class LidarBoxes:
    """Boxes (N,) in the frame of the level sensor [m, rad]; tops are heights above the sensor."""

    x: Float
    y: Float
    yaw: Float
    length: Float
    width: Float
    top: Float
    owner: Int


@dataclass(frozen=True, slots=True)
class LidarWalls:
    """Walls (E,) from start to end (E, 2), outside to the right, in the frame of the level sensor [m]."""

    start: Float
    end: Float
    top: float
    owner: Int


@dataclass(frozen=True, slots=True)
class RayIntersections:
    """Columns that meet something between two horizontal distances [m], all (M,)."""

    column: Int
    near: Float
    far: Float
    top: Float
    owner: Int

    def take(self, rows: Bool) -> "RayIntersections":
        """Some of them."""
        return RayIntersections(self.column[rows], self.near[rows], self.far[rows], self.top[rows], self.owner[rows])


def pack_keys(distance: Float, owner: Int) -> HitKeys:
    """Sortable pairs; distance >= 0."""
    return distance.astype(np.float32).view(np.int32).astype(np.int64) << 32 | owner


def unpack_keys(key: HitKeys) -> tuple[npt.NDArray[np.float32], Int]:
    """Distances and owners."""
    return (key >> 32).astype(np.int32).view(np.float32), key & 0xFFFFFFFF


def expand_ranges(low: Int, count: Int) -> tuple[Int, Int]:
    """For every i the numbers low[i] ... low[i] + count[i] - 1: (i of each, the numbers)."""
    which = np.repeat(np.arange(len(count)), count)
    ends = np.cumsum(count)
    return which, np.arange(len(which)) + (low - ends + count)[which]


def _columns(rays: LidarRays, low: Float, high: Float) -> tuple[Int, Int]:
    """Columns between two directions [rad], low in [-pi, pi), high - low <= 2 pi: (i of each, column)."""
    first, last = _first_at(rays, low - EDGE_SLACK), _first_at(rays, high + EDGE_SLACK)
    which, column = expand_ranges(first, np.minimum(last - first, len(rays.azimuth)))
    return which, column % len(rays.azimuth)


def _first_at(rays: LidarRays, angle: Float) -> Int:
    """Index of the first column at or after the angle, counted on over whole turns."""
    turn = np.floor(angle / TAU)
    return np.searchsorted(rays.azimuth, angle - turn * TAU) + turn.astype(np.int64) * len(rays.azimuth)


def intersect_boxes(rays: LidarRays, boxes: LidarBoxes) -> RayIntersections:
    """Where columns enter and leave boxes; near is 0 above a box."""
    cos, sin = portable.cos_sin(boxes.yaw)
    # The sensor in the frame of each box.
    own_x, own_y = -boxes.x * cos - boxes.y * sin, boxes.x * sin - boxes.y * cos
    over = (abs(own_x) <= boxes.length / 2) & (abs(own_y) <= boxes.width / 2)
    which, column = _columns(rays, *_spans(boxes, cos, sin, over))
    across = rays.across[column]
    cos, sin = cos[which], sin[which]
    step_x, step_y = across[:, 0] * cos + across[:, 1] * sin, across[:, 1] * cos - across[:, 0] * sin
    in_x, out_x = _slab(own_x[which], step_x, boxes.length[which] / 2)
    in_y, out_y = _slab(own_y[which], step_y, boxes.width[which] / 2)
    near, far = np.maximum(in_x, in_y), np.minimum(out_x, out_y)
    met = (near <= far) & (far > 0) & ((near > 0) | (boxes.top[which] < 0))
    which = which[met]
    return RayIntersections(column[met], np.maximum(near[met], 0.0), far[met], boxes.top[which], boxes.owner[which])


def _spans(boxes: LidarBoxes, cos: Float, sin: Float, over: Bool) -> tuple[Float, Float]:
    """First and last direction [rad] in which each box is seen."""
    ahead, left = CORNERS[0] * boxes.length / 2, CORNERS[1] * boxes.width / 2
    corners = portable.atan2(boxes.y + ahead * sin + left * cos, boxes.x + ahead * cos - left * sin)
    middle = portable.atan2(boxes.y, boxes.x)
    aside = wrap_angles(corners - middle)
    return np.where(over, -np.pi, middle + aside.min(0)), np.where(over, np.pi, middle + aside.max(0))


def _slab(start: Float, step: Float, half: Float) -> tuple[Float, Float]:
    """Distances at which start + distance * step enters and leaves [-half, half]."""
    inverse = 1 / np.where(abs(step) < 1e-300, 1e-300, step)  # the inverse of a smaller step is infinite
    middle, reach = -start * inverse, half * abs(inverse)
    return middle - reach, middle + reach


def intersect_walls(rays: LidarRays, walls: LidarWalls) -> RayIntersections:
    """Where columns meet walls from outside."""
    x, y = walls.start.T
    along = walls.end - walls.start
    area = x * along[:, 1] - y * along[:, 0]
    front = np.flatnonzero(area < 0)
    x, y, along, area = x[front], y[front], along[front], area[front]
    # Seen from outside, a wall runs clockwise: its end comes first.
    low = portable.atan2(y + along[:, 1], x + along[:, 0])
    which, column = _columns(rays, low, low + (portable.atan2(y, x) - low) % TAU)
    across, along = rays.across[column], along[which]
    turn = across[:, 0] * along[:, 1] - across[:, 1] * along[:, 0]
    where = x[which] * across[:, 1] - y[which] * across[:, 0]
    met = (turn < 0) & (where <= -EDGE_SLACK * turn) & (where >= (1 + EDGE_SLACK) * turn)
    which = which[met]
    near = area[which] / turn[met]
    top = np.full(len(near), walls.top)
    return RayIntersections(column[met], near, near, top, walls.owner[front[which]])


@twin
def cast_rays(rays: LidarRays, boxes: LidarBoxes, walls: LidarWalls, height: float, ground: HitKeys, /) -> HitKeys:
    """The first hit of every ray of the scan.

    height: of the sensor [m]; ground: what each ray hits without anything in its way. Walls are as high as each other
    and higher than all boxes, so that each hides whatever is behind it.
    """
    wall, box = intersect_walls(rays, walls), intersect_boxes(rays, boxes)
    nearest = np.full(len(rays.azimuth), np.inf)
    np.minimum.at(nearest, wall.column, wall.near)
    best = ground.copy()
    for met in (wall, box):
        before = met.take(met.near <= nearest[met.column])
        if rays.shared:
            _hit_by_columns(rays, before, height, best)
        else:
            _hit_one_by_one(rays, before, best)
    return best


def _hit_by_columns(rays: LidarRays, met: RayIntersections, height: float, best: HitKeys) -> None:
    """Channels between foot and top of a side hit it, channels between the top's near and far end hit the roof."""
    near, channels = np.maximum(met.near, TOUCH_M), len(rays.climb)
    foot = np.searchsorted(rays.climb, -height / near)
    edge = np.searchsorted(rays.climb, met.top / near, side="right")
    which, ray = expand_ranges(met.column * channels + foot, np.maximum(edge - foot, 0))
    np.minimum.at(best, ray, pack_keys(near, met.owner)[which])
    roofs = met.take(met.top < 0)
    low = edge[met.top < 0]
    end = np.searchsorted(rays.climb, roofs.top / roofs.far, side="right")
    which, ray = expand_ranges(roofs.column * channels + low, end - low)
    distance = roofs.top[which] / rays.climb[ray - roofs.column[which] * channels]
    np.minimum.at(best, ray, pack_keys(distance, roofs.owner[which]))


def _hit_one_by_one(rays: LidarRays, met: RayIntersections, best: HitKeys) -> None:
    """Every column has one ray; what it meets below the ground comes later than the ground."""
    climb = rays.climb[met.column]
    side = np.flatnonzero(met.near * climb <= met.top)
    np.minimum.at(best, rays.order[met.column[side]], pack_keys(met.near[side], met.owner[side]))
    roof = np.flatnonzero((met.near * climb > met.top) & (met.far * climb <= met.top))
    np.minimum.at(best, rays.order[met.column[roof]], pack_keys(met.top[roof] / climb[roof], met.owner[roof]))
