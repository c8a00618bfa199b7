"""Images against oracles: corners by the pinhole, depth by casting rays on the triangles, ground by the polygons."""

import math

import numpy as np
import pytest
import shapely
from testing.camera_scenes import Box, build_scene, find_eye, load_town, needs_opengl, place_car, take_image

from mdrive_sumo.contract import SemanticClass, SensorSpec
from mdrive_sumo.core.geometry import Float, box_corners
from mdrive_sumo.core.state import Kind
from mdrive_sumo.roads import RoadMap, find_network_folder, load_road_map
from mdrive_sumo.roads.drawing.map_geometry import build_map_geometry
from mdrive_sumo.sensing.camera.camera_model import FAR_PLANE_M, CameraModel
from mdrive_sumo.sensing.camera.camera_sensor import read_camera_model
from mdrive_sumo.sensing.camera.instances import MESHES, load_instances
from mdrive_sumo.sensing.camera.static_scene import load_static_scene
from mdrive_sumo.sensing.lidar_world import assume_heights
from mdrive_sumo.sensing.sensing_frame import SensingFrame

pytestmark = [needs_opengl, pytest.mark.slow]
DEEP_M = 0.01
"""[m] Largest error of a depth."""


def find_street(roads: RoadMap, count: int, seed: int) -> list[tuple[float, float, float]]:
    """Poses on lanes."""
    random = np.random.default_rng(seed)
    lanes = [lane for lane in roads.driving if not lane.junction and lane.centre.length > 20]
    found: list[tuple[float, float, float]] = []
    for _ in range(count):
        lane = lanes[random.integers(len(lanes))]
        s = random.uniform(0.0, lane.centre.length)
        found.append((*lane.centre.at(s), lane.centre.yaw_at(s)))
    return found


def get_model(**options: float | str) -> CameraModel:
    return read_camera_model(SensorSpec("camera", options=options))


@pytest.mark.parametrize("seed", range(6))
def test_the_corners_of_a_block_are_where_the_pinhole_puts_them(seed: int) -> None:
    random, roads = np.random.default_rng(seed), load_town()
    x, y, yaw = find_street(roads, 1, seed)[0]
    away, aside, turn = random.uniform(8, 25), random.uniform(-3, 3), random.uniform(-3, 3)
    at = x + away * math.cos(yaw) - aside * math.sin(yaw), y + away * math.sin(yaw) + aside * math.cos(yaw)
    block: Box = (*at, turn, random.uniform(0.5, 3), random.uniform(0.5, 3), Kind.STATIC)
    scene = build_scene([place_car(x, y, yaw), block])
    size = {"width": 900, "height": 256}
    shown = take_image(scene, roads, kind="instance", **size)
    rows, columns = np.nonzero(shown.pixels == 0)
    corners = box_corners(*block[:5])
    model = get_model(**size)
    solid = np.concatenate([np.column_stack((corners, np.full(4, z))) for z in (0.0, 1.0)])
    points = model.project(model.find_view(x, y, yaw), solid)
    edges = columns.min(), columns.max() + 1, rows.min(), rows.max() + 1
    wanted = points[:, 0].min(), points[:, 0].max(), points[:, 1].min(), points[:, 1].max()
    assert np.abs(np.array(edges) - wanted).max() <= 1.0


def list_triangles(roads: RoadMap, scene: SensingFrame) -> Float:
    """All triangles (T, 3, 3) [m] that are drawn, in the world."""
    static = load_static_scene(roads)
    found = [static.vertices["position"].astype(np.float64).reshape(-1, 3, 3)]
    instances = load_instances(scene, static)
    for place, model in zip(instances.rows, instances.model.tolist(), strict=True):
        if place["tag"] != 1:  # the own car is not shown
            cos, sin = place["turn"]
            turn = np.array(((cos, sin, 0.0), (-sin, cos, 0.0), (0.0, 0.0, 1.0)))
            solid = (MESHES[model]["position"] * place["size"]).astype(np.float64) @ turn + place["place"]
            found.append(solid.reshape(-1, 3, 3))
    return np.concatenate(found) + static.origin


def cast_rays(triangles: Float, start: Float, rays: Float) -> Float:
    """Distances (R,) along rays (R, 3) to the first triangle or the ground (Moeller and Trumbore 1997)."""
    a, ab, ac = triangles[:, 0], triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    nearest = np.where(rays[:, 2] < 0, -start[2] / np.minimum(rays[:, 2], -1e-12), np.inf)
    for i, ray in enumerate(rays):
        across = np.cross(ray, ac)
        det = (ab * across).sum(-1)
        with np.errstate(divide="ignore", invalid="ignore"):
            u = ((start - a) * across).sum(-1) / det
            q = np.cross(start - a, ab)
            v, t = (q @ ray) / det, (ac * q).sum(-1) / det
            hit = (np.abs(det) > 1e-12) & (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0.1)
        nearest[i] = min(nearest[i], t[hit].min(initial=np.inf))
    return nearest


@pytest.mark.parametrize("seed", range(3))
def test_depth_is_that_of_cast_rays(seed: int) -> None:
    """But at silhouettes, where the centre of a pixel and its ray may lie on either side of an edge."""
    roads = load_town()
    poses = find_street(roads, 12, seed)
    kinds = [Kind.VEHICLE, Kind.PEDESTRIAN, Kind.CYCLIST, Kind.STATIC]
    sizes = [(4.5, 1.8), (0.6, 0.6), (1.8, 0.6), (1.0, 1.0), (12.0, 2.5), (6.0, 2.0), (2.1, 0.8), (16.0, 2.5)]
    others = [(*pose, *sizes[i % 8], kinds[i % 4 if i % 8 < 4 else 0]) for i, pose in enumerate(poses[1:])]
    scene = build_scene([place_car(*poses[0]), *others])
    image = take_image(scene, roads, kind="depth", width=320, height=180)
    model = get_model(kind="depth", width=320, height=180)
    view = model.find_view(*poses[0])
    random = np.random.default_rng(seed)
    rows, columns = random.integers(0, 180, 250), random.integers(0, 320, 250)
    aside, up = (160 - columns - 0.5) / model.focal_px, (90 - rows - 0.5) / model.focal_px
    rays = np.column_stack((np.ones(250), aside, up)) @ view.axes.T
    wanted = np.minimum(cast_rays(list_triangles(roads, scene), view.place, rays), FAR_PLANE_M)
    near = wanted < 300.0  # beyond, the terrain ends, and a pixel covers metres
    error = np.abs(image.pixels[rows, columns] - wanted)[near]
    assert near.sum() > 100
    assert np.median(error) < DEEP_M / 10
    assert (error > np.maximum(DEEP_M, 1e-4 * wanted[near])).mean() <= 0.02


def test_semantic_classes_and_sky() -> None:
    roads = load_town()
    x, y, yaw = find_street(roads, 1, 4)[0]
    ahead = [(x + d * math.cos(yaw), y + d * math.sin(yaw), yaw) for d in (9.0, 14.0)]
    scene = build_scene(
        [place_car(x, y, yaw), (*ahead[0], 0.6, 0.6, Kind.PEDESTRIAN), (*ahead[1], 4.5, 1.8, Kind.VEHICLE)]
    )
    classes = take_image(scene, roads, kind="semantic")
    found = set(np.unique(classes.pixels).tolist())
    wanted = {
        SemanticClass.ROAD,
        SemanticClass.PEDESTRIAN,
        SemanticClass.VEHICLE,
        SemanticClass.SKY,
        SemanticClass.BUILDING,
    }
    assert wanted <= found <= set(SemanticClass)
    depth = take_image(scene, roads, kind="depth").pixels
    assert (depth[classes.pixels == SemanticClass.SKY] == FAR_PLANE_M).all()
    assert (depth[classes.pixels != SemanticClass.SKY] < FAR_PLANE_M).mean() > 0.99
    heights = assume_heights(scene.boxes.kind, scene.boxes.length)
    assert heights[1] == pytest.approx(1.75)
    assert find_eye(scene).carrier_row == 0


@pytest.mark.parametrize("network", ["main_street", "old_town", "freeway", "roundabout"])
def test_ground_has_the_class_of_the_topmost_layer(network: str) -> None:
    """Layers lie at one height: a rounding error of their depths would show one through another."""
    roads = load_road_map(find_network_folder(network))
    asphalt = shapely.union_all(list(build_map_geometry(roads, shapely.box(-5e3, -5e3, 5e3, 5e3)).asphalt))
    options = {"kind": "semantic", "width": 160, "height": 90, "x": 0.4, "z": 1.4}
    model = get_model(**options)
    rows, columns = np.mgrid[50:90, 0:160]
    rays = np.stack((np.ones(rows.shape), 79.5 - columns, 44.5 - rows), axis=-1) / (1.0, model.focal_px, model.focal_px)
    for pose in find_street(roads, 8, 5):
        view = model.find_view(*pose)
        directions = rays @ view.axes.T
        ground = view.place + directions * (view.place[2] / -directions[..., 2:])
        inside = shapely.contains_xy(asphalt.buffer(-0.4), ground[..., 0], ground[..., 1])
        shown = take_image(build_scene([place_car(*pose)]), roads, **options).pixels[50:90]
        is_ground = np.isin(shown, [SemanticClass.TERRAIN, SemanticClass.SIDEWALK, SemanticClass.ROAD])
        assert (inside & is_ground).sum() > 500
        assert (shown[inside & is_ground] == SemanticClass.ROAD).all()
