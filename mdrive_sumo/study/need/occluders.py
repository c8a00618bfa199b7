"""What stands between two road users: buildings, and vehicles higher than a LiDAR on a roof while they stand still.

An eye that may be anywhere within a distance e of a point sees past an occluder at most what an eye at that point sees
past the occluder eroded by e: move the line of sight by e, and it still misses what was eroded. So what is hidden
behind eroded occluders is hidden from everywhere within e.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import shapely

from mdrive_sumo.contract import Objects
from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Bool, Float, Int
from mdrive_sumo.core.state import Kind
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.sensing.lidar_sensor import ABOVE_ROOF_M
from mdrive_sumo.sensing.lidar_world import CAR_M, assume_heights
from mdrive_sumo.sensing.sensing_frame import SensingFrame, SensorPose
from mdrive_sumo.sensing.visibility import BuildingEdges, SightView

RANGE_M = 1000.0
"""The greatest range that a sensor may declare."""
EYE_M = CAR_M + ABOVE_ROOF_M
"""Height of the LiDAR of the standard rig [m]: it looks over what is lower."""
BIN_TICKS = 10
"""A vehicle hides something in a bin of time if it stands still during the whole of it."""
STANDING_M = 0.005
"""A vehicle whose pose changes by less stands still (recordings are rounded to 1 mm)."""
EROSION_STEP_M = 0.1
"""Erosions are rounded up to multiples of this, so that buildings are eroded few times."""


class Box(NamedTuple):
    """An oriented box [m, rad]."""

    x: float
    y: float
    yaw: float
    length: float
    width: float


def enclose_boxes(x: Float, y: Float, yaw: Float, length: float, width: float) -> Box:
    """Return a box with the middle pose's yaw around boxes of one size at M poses (M,)."""
    direction = float(yaw[len(yaw) // 2])
    cos, sin = portable.cos_sin(direction)
    turn_cos, turn_sin = portable.cos_sin(yaw - direction)
    ahead, aside = cos * x + sin * y, cos * y - sin * x
    half_length = (np.abs(turn_cos) * length + np.abs(turn_sin) * width) / 2
    half_width = (np.abs(turn_sin) * length + np.abs(turn_cos) * width) / 2
    front, back = float((ahead + half_length).max()), float((ahead - half_length).min())
    left, right = float((aside + half_width).max()), float((aside - half_width).min())
    middle, centre = (front + back) / 2, (left + right) / 2
    return Box(cos * middle - sin * centre, sin * middle + cos * centre, direction, front - back, left - right)


@dataclass(frozen=True)
class StandingOccluders:
    """The occluders between a pair of road users."""

    record: EpisodeRecord
    roads: RoadMap
    pair: tuple[int, int]
    """Columns of the two, which do not hide each other."""
    region: shapely.Geometry
    """Contains every line of sight between the two."""

    @cached_property
    def bins(self) -> int:
        """Number of whole bins of the recording, at least one."""
        return max(self.record.ticks // BIN_TICKS, 1)

    def list_at(self, number: int) -> tuple[Box, ...]:
        """Return the vehicles that stand during a bin; after the recording those that stood during all of it."""
        standing, x, y, yaw = self._standing
        at = min(number, self.bins - 1)
        chosen = standing[at] if number < self.bins else standing.all(axis=0)
        return tuple(
            Box(float(x[at, i]), float(y[at, i]), float(yaw[at, i]), float(length), float(width))
            for i, length, width in (
                (i, self.record.length[self._columns[i]], self.record.width[self._columns[i]])
                for i in np.flatnonzero(chosen).tolist()
            )
        )

    @cached_property
    def _columns(self) -> Int:
        """Columns of vehicles that are high enough to hide something."""
        e = self.record
        high = (e.kind == Kind.VEHICLE) & (assume_heights(e.kind, e.length) > EYE_M)
        high[list(self.pair)] = False
        return np.flatnonzero(high)

    @cached_property
    def _standing(self) -> tuple[Bool, Float, Float, Float]:
        """(bins, C) whether each of `_columns` stands in the region during the whole bin, and its pose, rounded."""
        e, columns = self.record, self._columns
        ticks = min(self.bins * BIN_TICKS, e.ticks)
        shape = (self.bins, ticks // self.bins, len(columns))
        valid = e.valid[:ticks, columns].reshape(shape).all(axis=1)
        poses = np.stack([values[:ticks, columns].reshape(shape) for values in (e.x, e.y, e.yaw)])
        still = (np.ptp(poses, axis=2) < STANDING_M).all(axis=0)
        x, y, yaw = np.round(poses[0, :, 0], 2), np.round(poses[1, :, 0], 2), np.round(poses[2, :, 0], 3)
        gaps = np.asarray(shapely.distance(shapely.points(x, y), self.region))
        near = gaps <= portable.hypot(e.length[columns], e.width[columns]) / 2
        return valid & still & near, x, y, yaw

    @cached_property
    def _eroded(self) -> dict[float, BuildingEdges]:
        return {}

    def erode_buildings(self, erosion: float) -> BuildingEdges:
        """Return the edges of the buildings in the region without a margin of `erosion` [m]."""
        if erosion not in self._eroded:
            parts = [
                building.model_copy(update={"polygon": tuple(part.exterior.coords[:-1])})
                for building, shape in zip(self.roads.buildings, self.roads.building_shapes, strict=True)
                if shapely.intersects(shape, self.region)
                for part in _list_polygons(shapely.buffer(shape, -erosion, join_style="mitre"))
            ]
            self._eroded[erosion] = BuildingEdges(replace(self.roads, buildings=tuple(parts)))
        return self._eroded[erosion]

    def find_visible(
        self, eye: tuple[float, float], erosion: float, occluders: tuple[Box, ...], targets: tuple[Box, ...]
    ) -> Bool:
        """Return (K,) whether anything of each target can be seen from anywhere within `erosion` [m] of a point."""
        erosion = float(np.ceil(erosion / EROSION_STEP_M)) * EROSION_STEP_M
        left = [
            box._replace(length=box.length - 2.0 * erosion, width=box.width - 2.0 * erosion)
            for box in occluders
            if min(box.length, box.width) > 2.0 * erosion
        ]
        columns = np.array([*targets, *left], dtype=np.float64).reshape(-1, 5).T
        kinds = np.array([Kind.PEDESTRIAN] * len(targets) + [Kind.VEHICLE] * len(left), dtype=np.uint8)
        x, y, yaw, length, width = columns
        boxes = Objects(("",) * len(kinds), kinds, x, y, yaw, np.zeros(len(kinds)), length, width)
        view = SightView(
            SensorPose(*eye, 0.0, None), SensingFrame(0, boxes, {}), self.erode_buildings(erosion), RANGE_M
        )
        return view.visible_fractions()[: len(targets)] > 0.0


def _list_polygons(shape: shapely.Geometry) -> list[shapely.Polygon]:
    return [part for part in shapely.get_parts(shape) if isinstance(part, shapely.Polygon) and not part.is_empty]
