"""Bird's-eye raster: semantic layers of a virtual camera that looks straight down on the car."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from types import MappingProxyType

import numpy as np
import shapely

from mdrive_sumo.contract import Briefing, Objects, Raster, SensorSpec
from mdrive_sumo.core import portable
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float, box_corners, boxes_corners
from mdrive_sumo.core.state import Kind
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.sensing.polygon_fill import box_edges, fill_polygons, polygon_edges
from mdrive_sumo.sensing.sensing_frame import SensingFrame, SensorPose, SensorSetup
from mdrive_sumo.sensing.sensor_options import check_option_names, read_choice, read_number

LAYERS = ("drivable", "lane_lines", "route", "vehicles", "walkers", "static", "self")
LAYER_OF_KIND = np.zeros(len(Kind), dtype=np.int64)
LAYER_OF_KIND[[Kind.VEHICLE, Kind.PEDESTRIAN, Kind.CYCLIST, Kind.STATIC]] = (3, 4, 4, 5)
CAMERA_HEIGHT_M = 50.0
"""Of the paper's top views above the car's origin. The paper names only pixels and field of view; 50 m is what the
public agents of Bench2Drive declare for theirs, and our assumption for the others."""
LINE_WIDTH_M = 0.15
"""[m] Of lane markings in the image, at least one pixel."""
MAX_SIZE = 1024
"""Pixels along a side at most."""
RASTER_MS, PIXEL_MS = 1.0, 2.8e-5
"""Price of a raster, the sight of its objects included, and of each pixel [ms]; measured 29 ms for 1024 x 1024
(`sensor_kinds.price_sensor`)."""
GAP_M = 0.1
"""Gaps between lanes up to this width are closed: neighbouring strips do not meet exactly in bends."""


@dataclass(frozen=True, slots=True)
class TopView:
    """A top view: pixels along each side and metres on the ground that they cover."""

    size: int
    extent_m: float


def _camera(size: int, fov_deg: float) -> TopView:
    return TopView(size, 2 * CAMERA_HEIGHT_M * portable.tan(math.radians(fov_deg) / 2))


PROFILES: Mapping[str, TopView] = MappingProxyType(
    {
        "default": TopView(256, 64.0),
        "perception-swap": _camera(800, 90.0),
        "tcp": _camera(256, 120.0),
        "b2d": _camera(512, 50.0),
    }
)
"""The paper's top views by the name of its agents; "b2d" is that of UniAD and VAD."""


class RasterSensor:
    """Bird's-eye raster of the map, the own route and visible objects.

    Options: profile (a name in `PROFILES`), size [pixels] (keeps what the profile's image covers), metres_per_pixel.
    """

    def __init__(self, spec: SensorSpec, fitting: SensorSetup) -> None:
        """Raises InputError."""
        check_option_names(spec, ("profile", "size", "metres_per_pixel"))
        view = PROFILES[read_choice(spec, "profile", "default", PROFILES)]
        self._size = _whole(spec, "size", view.size)
        self._metres = read_number(spec, "metres_per_pixel", view.extent_m / self._size, 0.02, 5.0)
        fixed = [*_map_edges(fitting.roads, max(LINE_WIDTH_M, self._metres)), _route_edges(fitting.briefing)]
        self._look = fitting.look
        self._fixed = np.concatenate(fixed)
        self._layer = np.repeat(np.arange(len(fixed)), [len(edges) for edges in fixed])

    def sense(self, scene: SensingFrame, eye: SensorPose) -> Raster:
        """Return the raster of this tick, centred on where the car takes itself to be.

        It shows what an ideal detector sees, so that it does not show objects behind walls.
        """
        return self.draw(scene, eye.to_estimate(), self._look(scene, eye))

    def draw(self, scene: SensingFrame, eye: SensorPose, seen: Objects) -> Raster:
        """Return the raster around a pose; seen: objects drawn besides the map, the route and the car itself."""
        corners = boxes_corners(seen.x, seen.y, seen.yaw, seen.length, seen.width)
        boxes = np.concatenate((corners, _own_box(scene, eye)[None]))
        layer = np.append(LAYER_OF_KIND[seen.kind], LAYERS.index("self"))
        edges = _in_pixels(np.concatenate((self._fixed, box_edges(boxes))), eye, self._size, self._metres)
        pixels = fill_polygons(edges, np.concatenate((self._layer, np.repeat(layer, 4))), (len(LAYERS), self._size))
        return Raster(LAYERS, pixels, self._metres)


def price_raster(spec: SensorSpec) -> float:
    """Return the price of a raster [ms a tick]."""
    view = PROFILES.get(str(spec.options.get("profile", "default")), PROFILES["default"])
    size = spec.options.get("size", view.size)
    pixels = float(size) if isinstance(size, int | float) and 0 <= size <= MAX_SIZE else float(MAX_SIZE)
    return RASTER_MS + PIXEL_MS * portable.square(pixels)


def _whole(spec: SensorSpec, name: str, default: int) -> int:
    value = read_number(spec, name, default, 16, MAX_SIZE)
    if not value.is_integer():
        raise InputError(f"sensor {spec.kind!r}: option {name!r}: expected a whole number, found {value}")
    return int(value)


def _own_box(scene: SensingFrame, eye: SensorPose) -> Float:
    boxes = scene.boxes
    return box_corners(eye.x, eye.y, eye.yaw, float(boxes.length[eye.carrier_row]), float(boxes.width[eye.carrier_row]))


def _in_pixels(xy: Float, eye: SensorPose, size: int, metres: float) -> Float:
    """Points (..., 2) [m] as (column, row) from the corner of the image: the car in the middle, looking up."""
    cos, sin = (part / metres for part in portable.cos_sin(eye.yaw))
    x, y = xy[..., 0] - eye.x, xy[..., 1] - eye.y
    return np.stack((size / 2 + x * sin - y * cos, size / 2 - x * cos - y * sin), axis=-1)


@lru_cache(maxsize=8)
def _map_edges(roads: RoadMap, line_width: float) -> tuple[Float, Float]:
    """Edges of the drivable area and of the lane lines; lines thinner than a pixel would fall apart."""
    areas = [shapely.Polygon(outline).buffer(0) for outline in roads.junctions]
    strips = [_strip(lane.centre.xy, lane.width) for lane in roads.driving]
    area = shapely.union_all(np.array([*areas, *strips], dtype=object))
    closed = shapely.buffer(shapely.buffer(area, GAP_M / 2, quad_segs=1), -GAP_M / 2, quad_segs=1)
    drivable = shapely.simplify(shapely.union(area, closed), 0.01)
    streets = [lane for lane in roads.driving if not lane.junction]
    outlines = np.array([shapely.LineString(lane.centre.xy) for lane in streets], dtype=object)
    half = np.array([lane.width / 2 for lane in streets])
    borders = np.concatenate((shapely.offset_curve(outlines, half), shapely.offset_curve(outlines, -half)))
    lines = shapely.union_all(shapely.buffer(borders, line_width / 2, cap_style="flat", quad_segs=2))
    return polygon_edges(drivable), polygon_edges(shapely.simplify(lines, 0.01))


def _strip(centre: Float, width: float) -> shapely.Geometry:
    return shapely.buffer(shapely.LineString(centre), width / 2, cap_style="flat", quad_segs=8)


def _route_edges(briefing: Briefing | None) -> Float:
    """Edges of the own route, as wide as its lanes."""
    if briefing is None:
        return np.zeros((0, 2, 2))
    xy = briefing.route_xy
    legs = np.array(shapely.linestrings(np.stack((xy[:-1], xy[1:]), axis=1)), dtype=object)
    strips = shapely.buffer(legs, briefing.route_lane_width[1:] / 2, quad_segs=8)
    return polygon_edges(shapely.simplify(shapely.union_all(strips), 0.01))
