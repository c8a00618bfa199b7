"""build_synthetic_frames: made-up frames with the arrays of real ones, for tests.

Cars drive among boxes. A scan has points on the sides of a box that face the car, fewer with distance, and on the
ground around the car. Nothing occludes anything: instead a draw hides a box from a car as a whole.
"""

from dataclasses import dataclass

import numpy as np

from mdrive_sumo.agents.learned.ego_frame import convert_to_frame
from mdrive_sumo.agents.learned.fusion_spec import DELAYS_TICKS, MAX_CAVS
from mdrive_sumo.agents.learned.network_inputs import LIDAR_HEIGHT_M
from mdrive_sumo.agents.learned.point_grid import Cells, build_point_cells
from mdrive_sumo.core import portable
from mdrive_sumo.core.clock import TICKS_PER_SECOND
from mdrive_sumo.core.geometry import Bool, Float, Int, wrap_angles
from mdrive_sumo.core.seeding import derive_seed
from mdrive_sumo.learning.fusion.frames import MAX_BOXES, MOTION_S, FusionFrames
from mdrive_sumo.perception.box_iou import suppress_overlaps

SIZES_M = np.array(((4.5, 1.9, 1.5), (1.8, 0.7, 1.75), (0.6, 0.6, 1.75)))
"""Length, width, height of the boxes of each class."""
CLASS_SHARES = (0.8, 0.1, 0.1)
PLACES, PLACE_FRAMES = 12, 4
"""Frames change the place after PLACE_FRAMES of them, and begin again after PLACES."""
BOX_REACH_M, CAR_REACH_M = 48.0, 25.0
"""[m] From the own car, along each axis."""
MOST_SPEED = 12.0
"""[m/s] Of cars and boxes."""
POINTS_AT_10_M = 150
"""On a car; the number falls with the square of the distance, as that of a spinning LiDAR."""
GROUND_POINTS = 400


@dataclass(frozen=True, slots=True)
class _SyntheticScene:
    """Cars and boxes at the tick of the frame, in the own car's frame."""

    cars: Float
    """(N, 5), the own car first."""
    boxes: Float
    """(M, 5)"""
    classes: Int
    """(M,)"""
    speeds: Float
    """(N + M,) [m/s], of cars and then boxes; all drive straight on."""
    is_hidden: Bool
    """(M, N): from each car."""


def build_synthetic_frames(
    count: int, seed: int, *, cavs: int = 2, boxes: int = 8, hidden_share: float = 0.4, split: str = "train"
) -> FusionFrames:
    """Return made-up frames. Frame i is the same however many are built.

    cavs: cars in each frame. boxes: at most so many in each. hidden_share: probability that a box is hidden from a car,
    for each pair. split: part of the seed, and of the names of places.
    """
    slots = (count, MAX_CAVS, len(DELAYS_TICKS))
    scan, pose = np.full(slots, -1, np.int32), np.full((*slots, 3), np.nan, np.float32)
    estimated = pose.copy()
    truth, motion = (np.full((count, MAX_BOXES, *each), np.nan, np.float32) for each in ((5,), (len(MOTION_S), 3)))
    box_class, box_id = np.full((count, MAX_BOXES), -1, np.int8), np.full((count, MAX_BOXES), -1, np.int32)
    box_points = np.zeros((count, MAX_BOXES, MAX_CAVS), np.uint16)
    scans: list[Cells] = []
    for i in range(count):
        random = np.random.default_rng(derive_seed(seed, "fusion frame", split, str(i)))
        scene = _draw_scene(random, cavs, boxes, hidden_share)
        found = len(scene.boxes)
        truth[i, :found], box_class[i, :found], box_id[i, :found] = scene.boxes, scene.classes, np.arange(found)
        ways = [_move_back(scene.boxes, -time_s * scene.speeds[cavs:])[:, :3] for time_s in MOTION_S]
        motion[i, :found] = np.stack(ways, axis=1)
        for car in range(cavs):
            for j, delay in enumerate(DELAYS_TICKS if car else DELAYS_TICKS[:1]):
                cells, points, where = _scan_scene(scene, car, delay / TICKS_PER_SECOND, random)
                scan[i, car, j] = len(scans)
                scans.append(cells)
                pose[i, car, j] = where
                estimated[i, car, j] = where + (random.normal(0.0, (0.1, 0.1, 0.002)) if car else 0.0)
                if not delay:
                    box_points[i, :found, car] = points
    numbers = np.arange(count, dtype=np.int32)
    return FusionFrames(
        places=tuple(f"{split}_{i}" for i in range(PLACES)),
        cells=np.concatenate(scans),
        scan_starts=np.cumsum([0, *map(len, scans)]),
        scan=scan,
        true_pose=pose,
        estimated_pose=estimated,
        boxes=truth,
        box_class=box_class,
        box_points=box_points,
        box_id=box_id,
        place=numbers // PLACE_FRAMES % PLACES,
        episode=numbers // PLACE_FRAMES,
        tick=numbers % PLACE_FRAMES * TICKS_PER_SECOND,
        box_motion=motion,
    )


def _draw_scene(random: np.random.Generator, cavs: int, boxes: int, hidden_share: float) -> _SyntheticScene:
    """Return cars at random places near the own one, and boxes that overlap neither them nor each other."""
    cars = np.zeros((cavs, 5))
    cars[:, 3:] = SIZES_M[0, :2]
    cars[1:, :2] = random.uniform(-CAR_REACH_M, CAR_REACH_M, (cavs - 1, 2))
    cars[1:, 2] = random.uniform(-np.pi, np.pi, cavs - 1)
    classes = random.choice(len(SIZES_M), boxes, p=CLASS_SHARES)
    centres = random.uniform(-BOX_REACH_M, BOX_REACH_M, (boxes, 2))
    drawn = np.column_stack((centres, random.uniform(-np.pi, np.pi, boxes), SIZES_M[classes, :2]))
    together = np.concatenate((cars, drawn))
    first = np.arange(len(together), 0, -1.0)  # cars win
    kept = suppress_overlaps(together, first, np.zeros(len(together), np.int64), 0.0)
    kept = kept[kept >= cavs] - cavs
    speeds = np.concatenate((np.zeros(1), random.uniform(0.0, MOST_SPEED, cavs - 1 + len(kept))))
    is_hidden = random.random((boxes, cavs)) < hidden_share
    return _SyntheticScene(cars, drawn[kept], classes[kept], speeds, is_hidden[kept])


def _scan_scene(
    scene: _SyntheticScene, car: int, age_s: float, random: np.random.Generator
) -> tuple[Cells, Int, Float]:
    """Return the cells of a scan, the points on each box (M,) and the car's pose (3,) when it was made."""
    earlier = _move_back(np.concatenate((scene.cars, scene.boxes)), scene.speeds * age_s)
    pose, boxes = earlier[car, :3], earlier[len(scene.cars) :].copy()
    boxes[:, :2] = convert_to_frame(boxes[:, :2], pose)
    boxes[:, 2] = wrap_angles(boxes[:, 2] - pose[2])
    distance = np.maximum(portable.hypot(boxes[:, 0], boxes[:, 1]), 3.0)
    expected = POINTS_AT_10_M * 100.0 / (distance * distance) * boxes[:, 3] / SIZES_M[0, 0]
    counts = np.where(scene.is_hidden[:, car], 0, random.poisson(expected))
    height = SIZES_M[scene.classes, 2]
    clouds = [_draw_points(*each, random) for each in zip(boxes, height, counts.tolist(), strict=True)]
    clouds.append(_draw_ground(random))
    return build_point_cells(np.concatenate(clouds).astype(np.float32)), counts, pose


def _move_back(boxes: Float, way_m: Float) -> Float:
    """Return boxes (N, 5) so far (N,) behind where they are; below 0: ahead."""
    cos, sin = portable.cos_sin(boxes[:, 2])
    moved = boxes.copy()
    moved[:, 0] -= cos * way_m
    moved[:, 1] -= sin * way_m
    return moved


def _draw_points(box: Float, height: float, count: int, random: np.random.Generator) -> Float:
    """Return points (count, 3) on the sides of a box (5,) that face the origin, with 2 cm of noise."""
    x, y, yaw, length, width = box.tolist()
    cos, sin = portable.cos_sin(yaw)
    own_x, own_y = -x * cos - y * sin, x * sin - y * cos
    # Shares of both facing sides in what the origin sees of the box.
    end, side = max(abs(own_x) - length / 2, 0.0) * width, max(abs(own_y) - width / 2, 0.0) * length
    on_end = random.random(count) * (end + side) < end
    along, aside = random.uniform(-length / 2, length / 2, count), random.uniform(-width / 2, width / 2, count)
    along = np.where(on_end, np.sign(own_x) * length / 2, along)
    aside = np.where(on_end, aside, np.sign(own_y) * width / 2)
    z = random.uniform(0.2, height, count) - LIDAR_HEIGHT_M
    points = np.column_stack((x + cos * along - sin * aside, y + sin * along + cos * aside, z))
    return points + random.normal(0.0, 0.02, points.shape)


def _draw_ground(random: np.random.Generator) -> Float:
    """Return points (GROUND_POINTS, 3) on the ground around the car."""
    reach = random.uniform(4.0, 60.0, GROUND_POINTS)
    cos, sin = portable.cos_sin(random.uniform(-np.pi, np.pi, GROUND_POINTS))
    return np.column_stack((reach * cos, reach * sin, np.full(GROUND_POINTS, -LIDAR_HEIGHT_M)))
