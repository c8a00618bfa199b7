"""Compare the road users that an image shows with the exact line of sight. No tests in here."""

from collections import Counter
from collections.abc import Sequence
from enum import StrEnum

import numpy as np

from mdrive_sumo.contract import SensorSpec
from mdrive_sumo.core.geometry import Float, box_corners, boxes_overlap
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
OPTIONS: dict[str, float | str] = {"kind": "instance", "width": 640, "height": 200, "z": 0.6, "x": 0.0}
"""At a height of 0.6 m the body of a car fills its box, and a car hides what is behind it as in the plane."""
SLIVER_PX = 2.0
SIZES: Sequence[tuple[float, float, Kind, float]] = (
    (4.6, 1.85, Kind.VEHICLE, 0.8),
    (0.6, 0.6, Kind.PEDESTRIAN, 0.1),
    (1.8, 0.6, Kind.CYCLIST, 0.1),
)
"""Length, width [m], kind and share of the road users: of one height, for the line of sight is one in the plane."""
FRAMES_OF_NETWORK = 125
"""Scenes of networks are built when frames come to them."""


class Agreement(StrEnum):
    """What image and line of sight say of a road user that is wholly within the field of view."""

    BOTH = "shown and in line of sight"
    NEITHER = "neither"
    SLIVER = "in line of sight, but less than two pixels wide"
    EDGE = "shown by at most two pixels beside what hides it"
    ABOVE = "the head of a person above the car that hides it in the plane"
    BEHIND_PEOPLE = "in line of sight, but hidden by people or cyclists, who hide nothing in the plane"
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
    shown = {name: int((image.pixels == i).sum()) for i, name in enumerate(image.names)}
    me = scene.egos["me"]
    model = read_camera_model(SensorSpec("camera", options=OPTIONS))
    view = model.find_view(me.x, me.y, me.yaw)
    sight = SightView(SensorPose(me.x, me.y, me.yaw, 0), scene, BuildingEdges(roads), RANGE_M)
    free, found = sight.visible_fractions(), list[Agreement]()
    for row in range(1, len(scene.boxes)):
        points = model.project(view, np.column_stack((scene.corners[row], np.full(4, 0.6))))
        inside = (points[:, 2] > 1.0).all() and points[:, 0].min() > 1 and points[:, 0].max() < model.width - 1
        if inside and sight.distances[row] < RANGE_M:
            pixels = shown.get(derive_track_name("me", scene.boxes.ids[row], 3), 0)
            found.append(_judge(scene, row, points, float(free[row]), pixels))
    return found


def _judge(scene: SensingFrame, row: int, points: Float, free: float, pixels: int) -> Agreement:
    """Return what holds for a road user with corners on the image, its free share, and the pixels that show it."""
    if bool(pixels) == (free > 0.0):
        return Agreement.BOTH if pixels else Agreement.NEITHER
    if not pixels:
        if free * np.ptp(points[:, 0]) < SLIVER_PX:
            return Agreement.SLIVER
        return Agreement.BEHIND_PEOPLE if _are_people_nearer(scene, row) else Agreement.UNEXPLAINED
    if pixels <= SLIVER_PX:
        return Agreement.EDGE
    return Agreement.ABOVE if scene.boxes.kind[row] != Kind.VEHICLE else Agreement.UNEXPLAINED


def _are_people_nearer(scene: SensingFrame, row: int) -> bool:
    """Return whether a person or cyclist is nearer to the CAV than a road user."""
    boxes, me = scene.boxes, scene.egos["me"]
    away = np.hypot(boxes.x - me.x, boxes.y - me.y)
    return bool(((boxes.kind != Kind.VEHICLE) & (away < away[row])).any())
