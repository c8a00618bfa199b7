"""What lies between the antennas of two stations: nothing, a vehicle, or a building. Exact lines of sight."""

import numpy as np

from mdrive_sumo.contract import Objects
from mdrive_sumo.core import portable
from mdrive_sumo.core.compiled import twin
from mdrive_sumo.core.geometry import Float, Int
from mdrive_sumo.core.state import Kind
from mdrive_sumo.sensing.lidar_world import assume_vehicle_heights
from mdrive_sumo.sensing.sensing_frame import LOW_M
from mdrive_sumo.v2x.radio.path_loss import Classes, LinkClass


def list_blockers(boxes: Objects) -> Float:
    """Return (N, 6): x, y, yaw, length, width, and height [m] of each box; height 0 for what hides nothing.

    Vehicles and high static props block, with the height that `lidar_world` assumes for their length.
    """
    longest = np.maximum(boxes.length, boxes.width)
    blocks = (boxes.kind == Kind.VEHICLE) | ((boxes.kind == Kind.STATIC) & (longest > LOW_M))
    rows = np.empty((len(longest), 6))
    columns = boxes.x, boxes.y, boxes.yaw, boxes.length, boxes.width, assume_vehicle_heights(longest) * blocks
    for i, column in enumerate(columns):
        rows[:, i] = column
    return rows


@twin
def classify_links(
    places: Float, carriers: Int, count: int, blockers: Float, walls: Float, ends: Int, circles: Float, /
) -> tuple[Classes, Float]:
    """Return the `LinkClass` (count, K) of the first `count` stations with all, and the height of what blocks them [m].

    places: (K, 2) of the antennas [m]. carriers: (K,) row of each station's own box in `blockers`, which does not
    block it; -1 for none. blockers: (N, 6) as `list_blockers`. walls, ends, circles: as `BuildingEdges`. The height is
    that of the highest vehicle in between; 0 if there is none, or a building. A pair has the same values both ways.
    What a line only touches does not block it.
    """
    del circles  # with them, the twin passes over buildings that a line does not reach
    classes = np.full((count, len(places)), LinkClass.LOS, dtype=np.uint8)
    tops = np.zeros((count, len(places)))
    boxes = blockers.tolist()
    if len(ends) and not 0 <= ends[0] <= ends[-1] <= len(walls):
        raise ValueError("expected walls of every building")
    for i, (x, y) in enumerate(places[:count].tolist()):
        for k in range(i + 1, len(places)):
            ray = (x, y, *places[k].tolist())
            own = int(carriers[i]), int(carriers[k])
            between = (box[5] for row, box in enumerate(boxes) if row not in own and _crosses_box(ray, box))
            if any(_crosses_wall(ray, wall) for wall in walls[: ends[-1] if len(ends) else 0].tolist()):
                kind, top = LinkClass.NLOSB, 0.0
            else:
                top = max(between, default=0.0)
                kind = LinkClass.NLOSV if top > 0.0 else LinkClass.LOS
            classes[i, k], tops[i, k] = kind, top
            if k < count:
                classes[k, i], tops[k, i] = kind, top
    return classes, tops


def _crosses_box(ray: tuple[float, ...], box: list[float]) -> bool:
    """Return whether a ray (x, y of both ends) has a part inside a box."""
    cos, sin = portable.cos_sin(box[2])
    px, py, dx, dy = ray[0] - box[0], ray[1] - box[1], ray[2] - ray[0], ray[3] - ray[1]
    since, until = 0.0, 1.0
    for start, way, half in (
        (cos * px + sin * py, cos * dx + sin * dy, box[3] / 2),
        (cos * py - sin * px, cos * dy - sin * dx, box[4] / 2),
    ):
        if way == 0.0:
            if not abs(start) < half:
                return False
            continue
        first, last = (-half - start) / way, (half - start) / way
        if last < first:
            first, last = last, first
        since, until = max(since, first), min(until, last)
    return since < until


def _crosses_wall(ray: tuple[float, ...], wall: list[float]) -> bool:
    """Return whether a ray passes a wall (x, y of both ends) from one side to the other."""
    dx, dy = ray[2] - ray[0], ray[3] - ray[1]
    begin = dx * (wall[1] - ray[1]) - dy * (wall[0] - ray[0])
    end = dx * (wall[3] - ray[1]) - dy * (wall[2] - ray[0])
    ex, ey = wall[2] - wall[0], wall[3] - wall[1]
    near = ex * (ray[1] - wall[1]) - ey * (ray[0] - wall[0])
    far = ex * (ray[3] - wall[1]) - ey * (ray[2] - wall[0])
    return (begin < 0.0 < end or end < 0.0 < begin) and (near < 0.0 < far or far < 0.0 < near)
