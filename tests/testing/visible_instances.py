"""Compare the road users that an image shows with the exact line of sight. No tests in here."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from enum import StrEnum

import numpy as np

from mdrive_sumo.contract import SensorSpec
from mdrive_sumo.core.geometry import Float, box_corners, boxes_corners, boxes_overlap
from mdrive_sumo.core.state import Kind
from mdrive_sumo.roads import RoadMap, find_network_folder, load_road_map
from mdrive_sumo.sensing.building_edges import BuildingEdges
from mdrive_sumo.sensing.camera.camera_sensor import read_camera_model
from mdrive_sumo.sensing.sensing_frame import SensingFrame, SensorPose, derive_track_name
from mdrive_sumo.sensing.visibility import SightView
from testing.camera_scenes import Box, build_scene, place_car, take_image

NETWORKS = (
    *("town_crossing", "old_town", "main_street", "market_crossing"),
    *("freeway", "roundabout", "staggered", "avenue"),
)
OTHERS = 14
"""Road users of a frame besides the CAV."""
RANGE_M = 80.0
OPTIONS: dict[str, float | str] = {"kind": "instance", "width": 1600, "height": 64, "z": 0.5, "x": 0.0}
LEVEL_ROWS = slice(31, 33)
"""The rows around the horizon show a section at the height of the camera, where the body of a car fills its box: that
is what the line of sight in the plane means. Other rows rightly show heads above cars."""
SLIVER_PX = 2.0
SIZES: Sequence[tuple[float, float, Kind, float]] = (
    (4.6, 1.85, Kind.VEHICLE, 0.8),
    (0.6, 0.6, Kind.PEDESTRIAN, 0.1),
    (1.8, 0.6, Kind.CYCLIST, 0.1),
)
"""Length, width [m], kind and share of the road users"""
FRAMES_OF_NETWORK = 125
"""Scenes of networks are built when frames come to them."""


class Agreement(StrEnum):
    """What image and line of sight say of a road user that is wholly within the field of view."""

    BOTH = "shown and in line of sight"
    NEITHER = "neither"
    SLIVER = "in line of sight, but less than two pixels wide"
    EDGE = "shown by at most two pixels beside what hides it"
    THIN = "only the boxes of people or bicycles are seen or hide: they are thinner"
    UNEXPLAINED = "unexplained"


def count_agreements(frames: range) -> Counter[Agreement]:
    """Return how often each happens, over (camera, road user) pairs of random frames on packaged networks."""
    found: Counter[Agreement] = Counter()
    for number in frames:
        roads = load_road_map(find_network_folder(NETWORKS[number // FRAMES_OF_NETWORK % len(NETWORKS)]))
        found.update(_compare_frame(roads, build_frame(roads, number)))
    return found


def build_frame(roads: RoadMap, seed: int) -> SensingFrame:
    """Return road users at random places of lanes, half of them near the CAV "me", none in another one."""
    random = np.random.default_rng(seed)
    lanes = [lane for lane in roads.driving if lane.centre.length > 5]
    boxes: list[Box] = []
    for _ in range(20 * OTHERS):
        lane = lanes[random.integers(len(lanes))]
        s = random.uniform(0.0, lane.centre.length)
        (x, y), yaw = lane.centre.at(s), lane.centre.yaw_at(s)
        if not boxes:
            boxes.append(place_car(x, y, yaw))
            continue
        length, width, kind, _ = SIZES[random.choice(len(SIZES), p=[size[3] for size in SIZES])]
        if np.hypot(x - boxes[0][0], y - boxes[0][1]) > (RANGE_M if len(boxes) % 2 else np.inf):
            continue
        one = (x, y, yaw, length, width, kind)
        corners = box_corners(x, y, yaw, length + 0.4, width + 0.4)
        if not any(boxes_overlap(corners, box_corners(*other[:5])) for other in boxes):
            boxes.append(one)
    return build_scene(boxes[: OTHERS + 1])


def _compare_frame(roads: RoadMap, scene: SensingFrame) -> list[Agreement]:
    image = take_image(scene, roads, **OPTIONS)
    shown = {name: int((image.pixels[LEVEL_ROWS] == i).sum()) for i, name in enumerate(image.names)}
    me = scene.egos["me"]
    model = read_camera_model(SensorSpec("camera", options=OPTIONS))
    view = model.find_view(me.x, me.y, me.yaw)
    all_hide = np.zeros_like(scene.boxes.kind)  # as vehicles do: in an image people hide what is behind them
    opaque = replace(scene, boxes=replace(scene.boxes, kind=all_hide))
    sight = SightView(SensorPose(me.x, me.y, me.yaw, 0), opaque, BuildingEdges(roads), RANGE_M)
    free, found, boxes = sight.visible_fractions(), list[Agreement](), scene.boxes
    corners, distances = boxes_corners(boxes.x, boxes.y, boxes.yaw, boxes.length, boxes.width), sight.distances()
    for row in range(1, len(boxes)):
        points = model.project(view, np.column_stack((corners[row], np.full(4, 0.5))))
        inside = (points[:, 2] > 1.0).all() and points[:, 0].min() > 1 and points[:, 0].max() < model.width - 1
        if inside and distances[row] < RANGE_M:
            pixels = shown.get(derive_track_name("me", boxes.ids[row], 3), 0)
            found.append(_judge(scene, row, points, float(free[row]), pixels))
    return found


def _judge(scene: SensingFrame, row: int, points: Float, free: float, pixels: int) -> Agreement:
    """Return what holds for a road user with corners on the image, its free share, and the pixels that show it."""
    if bool(pixels) == (free > 0.0):
        return Agreement.BOTH if pixels else Agreement.NEITHER
    if pixels and pixels <= 2 * SLIVER_PX:
        return Agreement.EDGE
    if not pixels and free * np.ptp(points[:, 0]) < SLIVER_PX:
        return Agreement.SLIVER
    return Agreement.THIN if _are_people_concerned(scene, row) else Agreement.UNEXPLAINED


def _are_people_concerned(scene: SensingFrame, row: int) -> bool:
    """Return whether a road user, or one that is nearer to the CAV, is a person or cyclist."""
    boxes, me = scene.boxes, scene.egos["me"]
    away = np.hypot(boxes.x - me.x, boxes.y - me.y)
    return bool(((boxes.kind != Kind.VEHICLE) & (away <= away[row])).any())
