"""ChaseViewPainter: pictures in perspective from behind and above one CAV."""

import math
from itertools import chain

import numpy as np
import shapely

from mdrive_sumo.core.geometry import Float, boxes_corners
from mdrive_sumo.core.state import Kind
from mdrive_sumo.report.palette import LIGHT, SKY
from mdrive_sumo.report.render.cameras import ChaseCamera
from mdrive_sumo.report.render.frame_painter import FramePainter, list_route_points
from mdrive_sumo.report.render.ground_layers import GroundLayer, build_ground_layers, build_route_layers
from mdrive_sumo.report.render.rendered_episode import RenderedEpisode
from mdrive_sumo.report.render.rings import Rings, build_rings, lift
from mdrive_sumo.report.render.solids import (
    Solid,
    build_buildings,
    build_road_user,
    build_signal,
    build_stop_sign,
    sort_back_to_front,
)
from mdrive_sumo.roads.drawing.map_geometry import build_map_geometry, list_signal_heads

BEHIND_M, ABOVE_M = 15.0, 5.5
"""[m] Place of the camera relative to the middle of the followed CAV."""
PITCH = math.radians(12.0)
"""Downwards."""
FIELD_OF_VIEW = math.radians(60.0)
"""Horizontal."""
SEEN_M = 160.0
"""[m] Of what is farther away only the ground is drawn."""
BESIDE_M = 15.0
"""[m] A solid with its middle so far behind the camera may reach in front of it."""
SHADOW_M, SHADOW = 0.25, "#00000038"


class ChaseViewPainter(FramePainter):
    """Paints pictures from behind a CAV; buildings between camera and CAV are left out."""

    def __init__(self, episode: RenderedEpisode, size: tuple[int, int], messages: bool, follow: int) -> None:
        super().__init__(episode, size, messages)
        self.follow = follow
        self._focal_px = size[0] / 2 / math.tan(FIELD_OF_VIEW / 2)
        area = shapely.MultiPoint(list_route_points(episode)).convex_hull.buffer(SEEN_M)
        geometry = build_map_geometry(episode.roads, area)
        ground = GroundLayer(LIGHT["building"], build_rings(geometry.buildings))
        self._layers = [*build_ground_layers(geometry), *build_route_layers(episode.scenario.egos), ground]
        self._shapes = np.array(geometry.buildings, dtype=object)
        self._buildings = build_buildings(geometry.buildings)
        self._signs = [solid for mark in geometry.stop_signs if (solid := build_stop_sign(mark)) is not None]
        self._heads = list_signal_heads(episode.roads, area)

    def paint_world(self, tick: int) -> ChaseCamera:
        """Paint sky, ground and solids, and return the camera."""
        x, y, yaw = self.episode.find_pose(self.follow, tick)
        place = x - BEHIND_M * math.cos(yaw), y - BEHIND_M * math.sin(yaw)
        camera = ChaseCamera(*place, ABOVE_M, yaw, PITCH, self._focal_px, *self.size)
        self._paint_ground(camera, tick)
        eye = np.array((*place, ABOVE_M))
        solids = sort_back_to_front(self._select_solids(camera, (x, y), tick), eye)
        faces = [face for solid in solids for face in solid.list_visible(eye)]
        seen = camera.project(Rings.concat(face.corners for face in faces))
        for i, outline in zip(seen.numbers.tolist(), seen.split(), strict=True):
            self.canvas.fill_outline(outline, faces[i].colour, faces[i].edge)
        return camera

    def label_height(self, column: int) -> float:
        """Return the height [m] of the roof."""
        return float(self.episode.heights[column])

    def _paint_ground(self, camera: ChaseCamera, tick: int) -> None:
        width, height = self.size
        self.canvas.fill_card((0, 0, width, height), SKY)
        self.canvas.fill_card((0, min(max(camera.horizon, 0), height), width, height), LIGHT["ground"])
        for layer in (*self._layers, GroundLayer(SHADOW, self._find_shadows(tick))):
            self.canvas.fill(camera.project(layer.areas), layer.colour)

    def _find_shadows(self, tick: int) -> Rings:
        record, present = self.episode.record, self.episode.list_present(tick)
        corners = boxes_corners(
            record.x[tick, present],
            record.y[tick, present],
            record.yaw[tick, present],
            record.length[present] + SHADOW_M,
            record.width[present] + SHADOW_M,
        )
        return Rings.concat(lift(corners, 0.0))

    def _select_solids(self, camera: ChaseCamera, followed: tuple[float, float], tick: int) -> list[Solid]:
        """Return everything that stands within sight."""
        sight = shapely.LineString(((camera.x, camera.y), followed))
        is_hidden = shapely.intersects(self._shapes, sight)
        shown = (pieces for pieces, hidden in zip(self._buildings, is_hidden, strict=True) if not hidden)
        standing = [
            *chain.from_iterable(shown),
            *self._signs,
            *(build_signal(h, [self.signals.find_colour(one, tick) for one in h.lights]) for h in self._heads),
        ]
        near = _find_near(camera, np.array([solid.middle for solid in standing]).reshape(-1, 2))
        record, present = self.episode.record, self.episode.list_present(tick)
        moving = _find_near(camera, np.stack((record.x[tick, present], record.y[tick, present]), axis=-1))
        return [*(standing[i] for i in near), *(self._build_road_user(present[i], tick) for i in moving)]

    def _build_road_user(self, column: int, tick: int) -> Solid:
        record = self.episode.record
        size = float(record.length[column]), float(record.width[column]), float(self.episode.heights[column])
        kind = Kind(int(record.kind[column]))
        return build_road_user(kind, self.episode.find_pose(column, tick), size, self.episode.colours[column])


def _find_near(camera: ChaseCamera, places: Float) -> list[int]:
    """Return which places (K, 2) [m] are in front of the camera or just beside it, and within sight."""
    depth = camera.to_camera(lift(places, 0.0))[:, 2]
    return np.flatnonzero((depth > -BESIDE_M) & (depth < SEEN_M)).tolist()
