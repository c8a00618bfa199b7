"""The bird's-eye raster against shapely, pixel by pixel."""

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from testing.sampling import examples
from testing.worlds import straight_road

from mdrive_sumo.contract import Briefing, Objects, Raster, SensorSpec, VehicleFacts
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Bool, Float, Polyline, box_corners
from mdrive_sumo.core.state import EgoState, Kind
from mdrive_sumo.roads import RoadMap, find_network_folder, load_road_map
from mdrive_sumo.scenario.weather import WEATHERS
from mdrive_sumo.sensing.polygon_fill import box_edges, fill_polygons, polygon_edges
from mdrive_sumo.sensing.raster_sensor import LAYERS, RasterSensor
from mdrive_sumo.sensing.sensing_frame import SensingFrame, SensorPose, SensorSetup

CAR = VehicleFacts(4.9, 2.1, 2.85, 1.4, 1700.0, 1.2, 50.0, 3.0, 8.0)


def told(xy: Float, width: float = 3.5) -> Briefing:
    """A briefing with a route."""
    n = len(xy)
    return Briefing("a", 0, 0.05, 30.0, CAR, xy, np.zeros(n), np.arange(float(n)), np.full(n, width), np.full(n, 10.0))


def sensor(roads: RoadMap, route: Float | None = None, **options: float | str | bool) -> RasterSensor:
    xy = np.array([(0.0, 0.0), (1.0, 0.0)]) if route is None else route
    return RasterSensor(
        SensorSpec("bev", "top", options=options), SensorSetup("a", 1, roads, WEATHERS["default"], told(xy))
    )


def objects(*boxes: tuple[Kind, float, float, float, float, float]) -> Objects:
    """Objects of kind, x, y, yaw, length and width."""
    x, y, yaw, length, width = np.array([box[1:] for box in boxes]).reshape(-1, 5).T
    return Objects(
        tuple(f"t{i}" for i in range(len(boxes))),
        np.array([box[0] for box in boxes], dtype=np.uint8),
        x,
        y,
        yaw,
        np.zeros(len(boxes)),
        length,
        width,
    )


def look(top: RasterSensor, pose: tuple[float, float, float], seen: Objects, *others: tuple[float, float]) -> Raster:
    """What the sensor draws for a car at the pose; the others are there, but not seen."""
    cars = [(Kind.VEHICLE, *pose, 4.9, 2.1), *((Kind.VEHICLE, x, y, 0.0, 4.9, 2.1) for x, y in others)]
    return top.draw(SensingFrame(0, objects(*cars), {"a": EgoState(*pose, 0.0)}), SensorPose(*pose, 0), seen)


def layer(raster: Raster, name: str) -> Bool:
    return raster.pixels[raster.layers.index(name)] == 255


def centres(raster: Raster, pose: tuple[float, float, float]) -> Float:
    """(H, W, 2) world position [m] of the pixels' centres, by rotation of a grid: ahead is up, left is left."""
    size = raster.pixels.shape[1]
    steps = (np.arange(size) - (size - 1) / 2) * raster.metres_per_pixel
    ahead, left = np.meshgrid(-steps, -steps, indexing="ij")
    x, y, yaw = pose
    cos, sin = math.cos(yaw), math.sin(yaw)
    return np.stack((x + cos * ahead - sin * left, y + sin * ahead + cos * left), axis=-1)


def beside(roads: RoadMap, points: Float, streets_only: bool) -> Float:
    """(M, L) distance of points to the lanes' borders [m], negative inside; infinite before and after the lane."""
    lanes = [lane for lane in roads.driving if not (streets_only and lane.junction)]
    lines = np.array([shapely.LineString(lane.centre.xy) for lane in lanes])
    here = np.asarray(shapely.points(points))[:, None]
    along = shapely.line_locate_point(lines, here)
    outside = (along <= 0) | (along >= shapely.length(lines))
    return np.where(outside, np.inf, shapely.distance(lines, here) - np.array([lane.width / 2 for lane in lanes]))


def poses(roads: RoadMap, count: int) -> list[tuple[float, float, float]]:
    rng = np.random.default_rng(5)
    middles = [lane.centre.at(lane.centre.length / 2) for lane in roads.driving]
    chosen = [middles[i] for i in rng.integers(len(middles), size=count)]
    return [(x + rng.normal(0, 5), y + rng.normal(0, 5), rng.uniform(-math.pi, math.pi)) for x, y in chosen]


@pytest.mark.slow
@pytest.mark.parametrize("network", ["town_crossing", "old_town", "ramp_merge"])
def test_drivable_is_where_lanes_and_junctions_are(network: str) -> None:
    roads = load_road_map(find_network_folder(network))
    junctions = shapely.union_all([shapely.Polygon(outline) for outline in roads.junctions])
    rng, top = np.random.default_rng(1), sensor(roads)
    for pose in poses(roads, 4):
        raster = look(top, pose, objects())
        chosen = rng.integers(256, size=(2, 1500))
        points = centres(raster, pose)[chosen[0], chosen[1]]
        gap = np.minimum(
            beside(roads, points, streets_only=False).min(axis=1),
            np.where(shapely.contains_xy(junctions, points), -1, shapely.distance(junctions, shapely.points(points))),
        )
        drawn = layer(raster, "drivable")[chosen[0], chosen[1]]
        assert drawn[gap < -0.02].all()
        assert not drawn[gap > 0.1].any()  # gaps of 0.1 m between lanes are closed, arcs are chords
        assert 0 < drawn.mean() < 1


@pytest.mark.parametrize(("gap", "closed"), [(0.05, True), (0.2, False)])
def test_narrow_gaps_between_lanes_are_closed_and_nothing_else_grows(gap: float, closed: bool) -> None:
    road = straight_road()
    lane = road.lanes["r_0"]
    second = replace(lane, id="r_1", centre=Polyline(lane.centre.xy + np.array((0.0, 3.5 + gap))))
    top = sensor(replace(road, lanes={"r_0": lane, "r_1": second}), metres_per_pixel=0.02)
    drawn = layer(look(top, (50.0, 1.75 + gap / 2, 0.0), objects()), "drivable")
    across = drawn[128]  # the middle of the gap lies between the columns 127 and 128
    assert across[127] == across[128] == closed
    assert (~across).sum() == (0 if closed else round(gap / 0.02))
    edge = layer(look(top, (50.0, -1.75, 0.0), objects()), "drivable")[128]
    assert edge[:127].all()
    assert not edge[129:].any()


@pytest.mark.slow
@pytest.mark.parametrize("metres", [0.1, 0.5])
def test_lane_lines_are_at_the_borders_of_the_streets_lanes(metres: float) -> None:
    roads = load_road_map(find_network_folder("skewed_crossing"))
    top, half = sensor(roads, metres_per_pixel=metres), max(metres, 0.15) / 2
    for pose in poses(roads, 2):
        raster = look(top, pose, objects())
        gap = np.abs(beside(roads, centres(raster, pose)[::3, ::3].reshape(-1, 2), streets_only=True)).min(axis=1)
        drawn = layer(raster, "lane_lines")[::3, ::3].ravel()
        assert drawn[gap < half - 0.02].all()
        assert not drawn[(gap > half + 0.02) & np.isfinite(gap)].any()
        assert drawn.any()


def test_the_route_is_drawn_as_wide_as_its_lanes() -> None:
    turn = np.array([(10 * math.sin(a), 10 - 10 * math.cos(a)) for a in np.linspace(0, math.pi / 2, 17)])
    raster = look(sensor(straight_road(), route=turn), (5.0, 2.0, 0.7), objects())
    gap = shapely.distance(
        shapely.LineString(turn), shapely.points(centres(raster, (5.0, 2.0, 0.7)).reshape(-1, 2))
    ).reshape(256, 256)
    assert layer(raster, "route")[gap < 1.73].all()
    assert not layer(raster, "route")[gap > 1.77].any()


NEAR = st.floats(-20.0, 20.0)
BOX = st.tuples(st.sampled_from(Kind), NEAR, NEAR, st.floats(-4.0, 4.0), st.floats(0.3, 12.0), st.floats(0.3, 3.0))


@settings(max_examples=examples(15, 60), deadline=None)
@given(st.lists(BOX, max_size=8), NEAR, NEAR, st.floats(-4.0, 4.0))
def test_boxes_cover_the_pixels_whose_centres_they_contain(
    boxes: list[tuple[Kind, float, float, float, float, float]], x: float, y: float, yaw: float
) -> None:
    pose = (x, y, yaw)
    raster = look(sensor(straight_road(), size=48, metres_per_pixel=0.6), pose, objects(*boxes))
    points = np.moveaxis(centres(raster, pose), -1, 0)
    names = {Kind.VEHICLE: "vehicles", Kind.PEDESTRIAN: "walkers", Kind.CYCLIST: "walkers", Kind.STATIC: "static"}
    for name in ("vehicles", "walkers", "static"):
        shapes = [shapely.Polygon(box_corners(*box[1:])) for box in boxes if names[box[0]] == name]
        surely = np.zeros((48, 48), dtype=np.bool_)
        maybe = np.zeros((48, 48), dtype=np.bool_)
        for shape in shapes:
            surely |= shapely.contains_xy(shape.buffer(-1e-6), *points)
            maybe |= shapely.contains_xy(shape.buffer(1e-6), *points)
        drawn = layer(raster, name)
        assert not (surely & ~drawn).any()
        assert not (drawn & ~maybe).any()


def test_ahead_is_up_and_left_is_left() -> None:
    pose = (50.0, 3.0, 2.0)
    ahead, left = 20.0, 8.0
    x = 50.0 + ahead * math.cos(2.0) - left * math.sin(2.0)
    y = 3.0 + ahead * math.sin(2.0) + left * math.cos(2.0)
    raster = look(sensor(straight_road()), pose, objects((Kind.VEHICLE, x, y, 2.0, 4.0, 2.0)))
    rows, columns = np.nonzero(layer(raster, "vehicles"))
    assert (rows.min(), rows.max()) == (128 - 88, 128 - 72 - 1)  # 18 m to 22 m ahead, 0.25 m a pixel
    assert (columns.min(), columns.max()) == (128 - 36, 128 - 28 - 1)  # 7 m to 9 m to the left


def test_the_car_is_in_the_middle_of_its_own_layer_only() -> None:
    raster = look(sensor(straight_road(), size=64, metres_per_pixel=0.2), (50.0, 0.0, 1.0), objects())
    rows, columns = np.nonzero(layer(raster, "self"))
    assert (rows.min(), rows.max(), columns.min(), columns.max()) == (32 - 12, 32 + 11, 32 - 5, 32 + 4)
    assert layer(raster, "self").sum() == 24 * 10
    assert not layer(raster, "vehicles").any()


def test_only_what_is_seen_is_drawn() -> None:
    raster = look(sensor(straight_road()), (50.0, 0.0, 0.0), objects(), (60.0, 0.0), (40.0, 3.0))
    assert not layer(raster, "vehicles").any()


def test_the_raster_depends_on_nothing_but_the_scene() -> None:
    roads = load_road_map(find_network_folder("town_crossing"))
    boxes = [(Kind.VEHICLE, 3.0, 4.0, 0.3, 4.9, 2.1), (Kind.CYCLIST, -5.0, 2.0, 1.0, 1.8, 0.6)]
    used, fresh, pose = sensor(roads), sensor(roads), (0.5, -3.0, 1.2)
    look(used, (20.0, 5.0, 0.0), objects())
    first = look(used, pose, objects(*boxes)).pixels
    assert first.tobytes() == look(fresh, pose, objects(*reversed(boxes))).pixels.tobytes()
    assert (first.dtype, first.shape, set(np.unique(first))) == (np.uint8, (len(LAYERS), 256, 256), {0, 255})


def test_overlapping_boxes_and_holes_are_filled_right() -> None:
    stack = np.array([box_corners(8.0, 8.0, 0.1 * i, 8.0, 4.0) for i in range(200)])
    layers = np.zeros(800, dtype=np.int64)
    assert fill_polygons(box_edges(stack), layers, (1, 16))[0, 8, 8] == 255
    ring = shapely.Point(8, 8).buffer(6) - shapely.Point(8, 8).buffer(3)
    edges = polygon_edges(ring)
    drawn = fill_polygons(edges, np.zeros(len(edges), dtype=np.int64), (1, 16))[0] == 255
    assert (drawn == shapely.contains_xy(ring, *np.meshgrid(np.arange(16) + 0.5, np.arange(16) + 0.5))).all()


@pytest.mark.parametrize(
    ("options", "size", "metres"),
    [
        ({}, 256, 0.25),
        ({"profile": "perception-swap"}, 800, 2 * 50 / 800),
        ({"profile": "tcp"}, 256, 2 * 50 * math.sqrt(3) / 256),
        ({"profile": "b2d"}, 512, 2 * 50 * math.tan(math.radians(25)) / 512),
        ({"profile": "perception-swap", "size": 400}, 400, 0.25),
        ({"profile": "tcp", "metres_per_pixel": 0.3}, 256, 0.3),
        ({"size": 16}, 16, 4.0),
    ],
)
def test_profiles_and_options_set_the_view(options: dict[str, float | str | bool], size: int, metres: float) -> None:
    raster = look(sensor(straight_road(), **options), (50.0, 0.0, 0.0), objects())
    assert raster.pixels.shape == (7, size, size)
    assert raster.metres_per_pixel == pytest.approx(metres)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"profil": "tcp"}, "expected one of metres_per_pixel, profile, size, found option 'profil'"),
        ({"profile": "uniad"}, "'profile': expected one of default, perception-swap, tcp, b2d, found 'uniad'"),
        ({"profile": 3}, "'profile': expected one of .*, found 3"),
        ({"size": 15}, "'size': expected a number in .16, 1024., found 15"),
        ({"size": 1025}, "found 1025"),
        ({"size": 20.5}, "'size': expected a whole number, found 20.5"),
        ({"size": True}, "'size': .*found True"),
        ({"size": "big"}, "'size': .*found 'big'"),
        ({"metres_per_pixel": 0.0}, "'metres_per_pixel': expected a number in .0.02, 5., found 0.0"),
        ({"metres_per_pixel": math.nan}, "'metres_per_pixel': .*found nan"),
    ],
)
def test_bad_options_are_named(options: dict[str, float | str | bool], said: str) -> None:
    with pytest.raises(InputError, match=said):
        sensor(straight_road(), **options)
