"""Shadows and lamplight: where they fall, by the geometry of rays from the sun."""

import math
from dataclasses import replace

import numpy as np
import pytest
from testing.camera_scenes import build_camera, build_scene, find_eye, load_town, needs_opengl, place_car, take_image

from mdrive_sumo.contract import SensorSpec
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import Kind
from mdrive_sumo.roads import RoadMap, find_network_folder, load_road_map
from mdrive_sumo.sensing.camera.camera_sensor import read_camera_model
from mdrive_sumo.sensing.camera.lighting import LIGHTS
from mdrive_sumo.sensing.sensing_frame import SensingFrame
from mdrive_sumo.sensing.street_furniture import FurnitureKind, load_street_furniture

pytestmark = [needs_opengl, pytest.mark.slow]
ABOVE = {"width": 200, "height": 200, "fov_deg": 60.0, "x": 0.0, "z": 30.0, "pitch_deg": 90.0}
"""A camera that looks straight down."""
FREEWAY = "freeway"


def find_road() -> tuple[RoadMap, tuple[float, float, float]]:
    """Return an open road, and a place on it."""
    roads = load_road_map(find_network_folder(FREEWAY))
    lane = max((lane for lane in roads.driving if lane.left), key=lambda one: one.centre.length)
    return roads, (*lane.centre.at(100.0), lane.centre.yaw_at(100.0))


def put(place: tuple[float, float, float], ahead: float, left: float) -> tuple[float, float, float]:
    """Return a pose beside another one."""
    x, y, yaw = place
    cos, sin = math.cos(yaw), math.sin(yaw)
    return x + cos * ahead - sin * left, y + sin * ahead + cos * left, yaw


def look_down(scene: SensingFrame, roads: RoadMap, points: Float, **options: float | str) -> Float:
    """Return the brightness at points (N, 2) of the ground."""
    me = scene.egos["me"]
    view = ABOVE | options
    model = read_camera_model(SensorSpec("camera", options={name: view[name] for name in ABOVE}))
    image = take_image(scene, roads, **view).pixels.astype(float).mean(axis=2)
    world = np.column_stack((points, np.zeros(len(points))))
    column, row, _ = model.project(model.find_view(me.x, me.y, me.yaw), world).T
    return image[row.astype(int), column.astype(int)]


@pytest.mark.parametrize("light", ["day", "dusk"])
def test_a_truck_throws_its_shadow_away_from_the_sun(light: str) -> None:
    roads, place = find_road()
    truck = put(place, 9.0, 0.0)
    empty, scene = (build_scene([place_car(*place), (*truck, 9.0, 2.5, Kind.VEHICLE)][:count]) for count in (1, 2))
    x, y, z = LIGHTS[light].to_sun
    middle, to_sun = np.array(truck[:2]), np.array((x, y)) / math.hypot(x, y)
    away = np.linspace(3.0, 3.4 * math.hypot(x, y) / z - 1.0, 7)[:, None] if light == "day" else np.full((1, 1), 6.0)
    shaded, sunny = middle - away * to_sun, middle + np.array(((6.0,), (7.0,))) * to_sun
    inside = np.abs(shaded - place[:2]).max(axis=1) < 15.0
    share = look_down(scene, roads, shaded[inside], light=light) / look_down(empty, roads, shaded[inside], light=light)
    assert share.max() < 0.9
    in_sun, before = (look_down(one, roads, sunny, light=light) for one in (scene, empty))
    assert in_sun == pytest.approx(before, rel=0.03)


def test_the_ground_beside_a_body_is_darker_without_sun() -> None:
    roads, place = find_road()
    scene, empty = (
        build_scene([place_car(*place), (*put(place, 6.0 + far, 0.0), 4.6, 1.85, Kind.VEHICLE)]) for far in (0.0, 200.0)
    )
    points = np.array([put(place, 6.0, left)[:2] for left in (-1.0, 1.0, -1.6, 1.6)])
    share = look_down(scene, roads, points, light="fog") / look_down(empty, roads, points, light="fog")
    assert share[:2].max() < 0.92
    assert share[2:].min() > 0.97


def test_street_lamps_light_the_ground_below_them_at_night_only() -> None:
    roads = load_town()
    furniture = load_street_furniture(roads)
    row = furniture.kinds.index(FurnitureKind.LAMP)
    lamp = np.array((furniture.x[row], furniture.y[row]))
    lane = min(roads.driving, key=lambda one: float(np.hypot(*(one.centre.xy - lamp).T).min()))
    s, _ = lane.centre.project(*lamp.tolist())
    view = {"x": -10.0, "z": 6.0, "fov_deg": 120.0}
    shown: dict[str, list[float]] = {"night": [], "fog": []}
    for place in (s, s + 16.0):  # below the lamp, and half way to the next one; both behind the own head lamps
        car = place_car(*lane.centre.at(place + 18.0), lane.centre.yaw_at(place + 18.0))
        for light, values in shown.items():
            values.append(
                look_down(build_scene([car]), roads, np.array([lane.centre.at(place)]), light=light, **view)[0]
            )
    assert shown["night"][0] > 1.5 * shown["night"][1]
    assert shown["fog"][0] == pytest.approx(shown["fog"][1], rel=0.2)


def test_a_picture_does_not_depend_on_what_was_drawn_before() -> None:
    """Tiles of what stands still are kept, and begin at fixed places of the world."""
    roads = load_town()
    lane = max(roads.driving, key=lambda one: one.centre.length)
    poses = [(*lane.centre.at(s), lane.centre.yaw_at(s)) for s in np.linspace(1.0, lane.centre.length - 1.0, 5)]
    scenes = [
        build_scene([place_car(*pose), place_car(pose[0] + 6, pose[1], 0.0)], tick=i) for i, pose in enumerate(poses)
    ]
    forth = [take_image(scene, roads, light="dusk").pixels for scene in scenes]
    back = [take_image(replace(scene, derived={}), roads, light="dusk").pixels for scene in reversed(scenes)]
    assert all((a == b).all() for a, b in zip(forth, reversed(back), strict=True))


def test_a_walking_person_moves_its_limbs_and_a_standing_one_none() -> None:
    roads, place = find_road()
    widths: dict[float, list[int]] = {}
    for speed in (0.0, 1.4):
        for step in range(4):
            beside = put(place, 0.0, 0.17 * step)  # the car moves as the person does
            x, y, yaw = put(beside, 6.0, 0.0)
            person = (x, y, yaw + math.pi / 2, 0.6, 0.6, Kind.PEDESTRIAN)
            scene = build_scene([place_car(*beside), person])
            moved = replace(scene, boxes=replace(scene.boxes, speed=np.array((0.0, speed))), derived={})
            camera = build_camera(roads, kind="instance", width=800, height=448, fov_deg=50.0)
            image = camera.sense(moved, find_eye(moved))
            assert image is not None
            rows = np.flatnonzero((image.pixels == 0).any(axis=1))
            columns = np.flatnonzero((image.pixels == 0)[rows[-1] - 8 : rows[-1]].any(axis=0))
            widths.setdefault(speed, []).append(int(columns[-1] - columns[0]))
    assert max(widths[0.0]) - min(widths[0.0]) <= 3
    assert max(widths[1.4]) > 1.25 * max(widths[0.0])


def test_wet_ground_mirrors_a_car_and_dry_ground_does_not() -> None:
    roads, place = find_road()
    scenes = [build_scene([place_car(*place), place_car(*put(place, ahead, 0.0))]) for ahead in (14.0, 200.0)]
    bottom = np.flatnonzero((take_image(scenes[0], roads, kind="instance").pixels == 0).any(axis=1)).max()
    differences: list[float] = []
    for light in ("rain", "fog"):
        shown, without = (take_image(scene, roads, light=light).pixels.astype(float) for scene in scenes)
        strip = slice(bottom + 5, bottom + 12), slice(185, 215)
        differences.append(float(np.abs(shown[strip] - without[strip]).max()))
    assert differences[0] > 4 * max(differences[1], 1.0)
