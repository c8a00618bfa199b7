"""TopViewPainter: pictures from above, of the whole scene or around one CAV, and the layers of their ground."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import cycle

import numpy as np
import shapely

from mdrive_sumo.core.geometry import Float, box_corners
from mdrive_sumo.core.state import Kind
from mdrive_sumo.report.label_placement import LabelBox
from mdrive_sumo.report.map_view import (
    fit_view,
    list_route_points,
)
from mdrive_sumo.report.palette import CAV_COLOURS, LIGHT, MIN_SIZE_M
from mdrive_sumo.report.render.cameras import Camera, Rings, TopCamera, build_rings, lift
from mdrive_sumo.report.render.canvas import fade
from mdrive_sumo.report.render.frame_painter import FramePainter
from mdrive_sumo.report.render.rendered_episode import RenderedEpisode
from mdrive_sumo.roads.drawing.map_geometry import MapGeometry, build_map_geometry, list_signal_heads
from mdrive_sumo.roads.drawing.road_paint import build_road_paint, widen_line
from mdrive_sumo.scenario.scenario import Ego

LINE_M, STOP_LINE_M, ROUTE_M = 0.15, 0.4, 0.35
"""[m] Least widths of markings, stop lines and routes on the ground."""
LINE_PX, STOP_LINE_PX, ROUTE_PX = 1.1, 2.0, 2.0
"""[px] Least widths on a picture from above."""
ROUTE_OPACITY = 0.45
"""Markings of the road stay visible below a route."""
GOAL_M = 1.2
"""[m] Radius of the disc at the end of a route."""
FOLLOWED_M = 70.0
"""[m] Shorter side of the scene around a followed CAV."""
LABEL_M = 2.6
"""[m] Distance of a label from the middle of its CAV."""
LEAST_CAV_PX = 9.0
"""Every CAV stays visible from afar."""


@dataclass(frozen=True, slots=True)
class GroundLayer:
    """Areas of one colour on the ground."""

    colour: str
    areas: Rings


def build_ground_layers(geometry: MapGeometry, metres_per_px: float = 0.0) -> list[GroundLayer]:
    """Return the layers of a map from bottom to top, without buildings. metres_per_px: of a picture from above."""
    line = max(LINE_M, LINE_PX * metres_per_px)
    stop = max(STOP_LINE_M, STOP_LINE_PX * metres_per_px)
    paint = build_road_paint(geometry, line, stop)
    layers = [("footway", geometry.pavements), ("apron", geometry.aprons), ("road", geometry.asphalt), ("line", paint)]
    return [GroundLayer(LIGHT[name], build_rings(shapes)) for name, shapes in layers]


def build_route_layers(egos: Sequence[Ego], metres_per_px: float = 0.0) -> list[GroundLayer]:
    """Return the routes of CAVs with discs at their goals."""
    width = max(ROUTE_M, ROUTE_PX * metres_per_px)
    return [
        GroundLayer(
            fade(colour, ROUTE_OPACITY),
            build_rings(_build_route(ego.xy, width)),
        )
        for ego, colour in zip(egos, cycle(CAV_COLOURS))
    ]


def _build_route(xy: Float, width: float) -> list[shapely.Polygon]:
    disc = shapely.Point(xy[-1]).buffer(max(GOAL_M, 2 * width), quad_segs=6)
    whole = shapely.union_all([*widen_line(xy, width), disc])
    return [part for part in shapely.get_parts(whole).tolist() if isinstance(part, shapely.Polygon)]


class TopViewPainter(FramePainter):
    """Paints pictures from above with north up; the ground is painted once unless the camera moves."""

    def __init__(self, episode: RenderedEpisode, size: tuple[int, int], messages: bool, follow: int | None) -> None:
        super().__init__(episode, size, messages)
        self.follow = follow
        points = list_route_points(episode.record, episode.scenario)
        view = fit_view(points)
        width, height = view.size
        self._middle = (view.left + view.right) / 2, (view.low + view.high) / 2
        self._scale = min(size[0] / width, size[1] / height) if follow is None else min(size) / FOLLOWED_M
        area = self._find_area(points)
        geometry = build_map_geometry(episode.roads, area)
        pixel = 1 / self._scale
        self._layers = build_ground_layers(geometry, pixel) + build_route_layers(episode.scenario.egos, pixel)
        self._buildings = build_rings(geometry.buildings)
        self._signs = [mark.sign for mark in geometry.stop_signs if mark.sign is not None]
        self._heads = list_signal_heads(episode.roads, area)
        self._background: object | None = None

    def _find_area(self, points: Float) -> shapely.Polygon:
        """Return what the camera may see."""
        half = np.array(self.size) / self._scale / 2
        if self.follow is None:
            low, high = np.array(self._middle) - half, np.array(self._middle) + half
        else:
            low, high = points.min(0) - half, points.max(0) + half
        return shapely.box(float(low[0]), float(low[1]), float(high[0]), float(high[1]))

    def paint_world(self, tick: int) -> TopCamera:
        """Paint ground and road users, and return the camera."""
        x, y = self._middle if self.follow is None else self.episode.find_pose(self.follow, tick)[:2]
        camera = TopCamera(x, y, self._scale, *self.size)
        if self._background is None or self.follow is not None:
            self._paint_ground(camera)
            self._background = self.canvas.copy_background() if self.follow is None else None
        else:
            self.canvas.restore_background(self._background)
        self._draw_signals(camera, tick)
        for column in reversed(self.episode.list_present(tick)):  # CAVs last, on top
            self._draw_road_user(camera, column, tick)
        return camera

    def label_height(self, column: int) -> float:  # noqa: ARG002
        """Return 0: heights do not matter from above."""
        return 0.0

    def list_taken(self, camera: Camera, tick: int) -> list[LabelBox]:
        """Return the boxes of all CAVs: no label covers another CAV."""
        record = self.episode.record
        boxes: list[LabelBox] = []
        for column in (one for one in self.episode.list_present(tick) if one < record.egos):
            x, y, yaw = self.episode.find_pose(column, tick)
            corners = box_corners(x, y, yaw, float(record.length[column]), float(record.width[column]))
            outline = camera.project(Rings.concat([lift(corners, 0.0)])).points * (1.0, -1.0)
            low, high = outline.min(0), outline.max(0)
            middle, size = (low + high) / 2, high - low
            boxes.append(LabelBox(float(middle[0]), float(middle[1]), float(size[0]), float(size[1])))
        return boxes

    def label_clearance(self, camera: Camera) -> float:  # noqa: ARG002
        """Return the distance [px] between a label and the middle of its CAV."""
        return max(LABEL_M * self._scale, 0.6 * LEAST_CAV_PX)

    def _paint_ground(self, camera: TopCamera) -> None:
        self.canvas.fill_card((0, 0, *self.size), LIGHT["ground"])
        for layer in self._layers:
            self.canvas.fill(camera.project(layer.areas), layer.colour)
        self.canvas.fill(camera.project(self._buildings), LIGHT["building"], LIGHT["building-edge"])
        for sign in self._signs:
            pixel = camera.find_pixel((float(sign[0]), float(sign[1]), 0.0))
            angles = (np.arange(8) + 0.5) * np.pi / 4
            corners = np.array(pixel) + max(4.0, 0.8 * self._scale) * np.stack(
                (np.cos(angles), np.sin(angles)), axis=-1
            )
            self.canvas.fill_outline(corners, LIGHT["bad"], "#ffffff")

    def _draw_signals(self, camera: TopCamera, tick: int) -> None:
        """Draw the lights at the end of every lane as bars, as the replay does."""
        thick = max(0.35, 2.5 / self._scale)
        for head in self._heads:
            share = (head.width - 0.4) / len(head.lights)
            ahead, left = (
                np.array((np.cos(head.yaw), np.sin(head.yaw))),
                np.array((-np.sin(head.yaw), np.cos(head.yaw))),
            )
            for i, light in enumerate(head.lights):
                middle = head.place - ahead * (thick / 2 + 0.2) + left * (head.width / 2 - 0.2 - (i + 0.5) * share)
                bar = box_corners(float(middle[0]), float(middle[1]), head.yaw, thick, share - 0.1)
                self._fill(camera, bar, self.signals.find_colour(light, tick))

    def _draw_road_user(self, camera: TopCamera, column: int, tick: int) -> None:
        record, colour = self.episode.record, self.episode.colours[column]
        is_cav = column < record.egos
        x, y, yaw = self.episode.find_pose(column, tick)
        length, width = max(float(record.length[column]), MIN_SIZE_M), max(float(record.width[column]), MIN_SIZE_M)
        enlarged = max(1.0, LEAST_CAV_PX / (length * self._scale)) if is_cav else 1.0
        edge = "#ffffff" if is_cav else LIGHT["vehicle-edge"]
        if record.kind[column] == Kind.PEDESTRIAN:
            pixel = camera.find_pixel((x, y, 0.0))
            self.canvas.fill_disc(*pixel, max(2.5, max(length, width) / 2 * self._scale), colour, edge)
            return
        length, width = enlarged * length, enlarged * width
        self._fill(camera, box_corners(x, y, yaw, length, width), colour, edge)
        if record.kind[column] != Kind.STATIC:
            self._fill(camera, _build_arrow(x, y, yaw, length, width), edge)

    def _fill(self, camera: TopCamera, outline: Float, colour: str, edge: str = "") -> None:
        self.canvas.fill(camera.project(Rings.concat([lift(outline, 0.0)])), colour, edge)


def _build_arrow(x: float, y: float, yaw: float, length: float, width: float) -> Float:
    """Return an arrow head (3, 2) in the front part of a box."""
    ahead, left = np.array((np.cos(yaw), np.sin(yaw))), np.array((-np.sin(yaw), np.cos(yaw)))
    tip, back = 0.42 * length * ahead, 0.16 * length * ahead
    return np.array((x, y)) + np.array((tip, back + 0.32 * width * left, back - 0.32 * width * left))
