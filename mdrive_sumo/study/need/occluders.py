"""What stands between two road users: buildings, and vehicles and high props while they stand still.

An eye that may be anywhere within a distance e of a point sees past an occluder at most what an eye at that point sees
past the occluder eroded by e: move the line of sight by e, and it still misses what was eroded. So what is hidden
behind eroded occluders is hidden from everywhere within e.
"""

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
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
from mdrive_sumo.sensing.sensing_frame import LOW_M, SensingFrame, SensorPose
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


MAX_SETS = 4
"""Different sets of standing vehicles that are told apart: each costs a table."""


class SightBox(NamedTuple):
    """An oriented box [m, rad]."""

    x: float
    y: float
    yaw: float
    length: float
    width: float


def enclose_boxes(x: Float, y: Float, yaw: Float, length: float, width: float) -> SightBox:
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
    return SightBox(cos * middle - sin * centre, sin * middle + cos * centre, direction, front - back, left - right)


def find_opaque(record: EpisodeRecord, over_roofs: bool) -> Bool:
    """Return (N,) which road users and props hide what lies behind them, in the plane or for a LiDAR on a roof."""
    e = record
    if over_roofs:
        return (e.kind == Kind.VEHICLE) & (assume_heights(e.kind, e.length) > EYE_M)
    is_long = np.maximum(e.length, e.width) > LOW_M
    return (e.kind == Kind.VEHICLE) | ((e.kind == Kind.STATIC) & is_long)


@dataclass(frozen=True)
class StandingVehicles:
    """All that stands still in a recording, by bin of time."""

    record: EpisodeRecord
    over_roofs: bool
    """Whether only vehicles higher than a LiDAR on the roof count, not all that hide something in the plane."""
    absent: frozenset[int] = frozenset()
    """Columns of what hides nothing, because it may not be there."""

    @cached_property
    def bins(self) -> int:
        """Number of whole bins of the recording, at least one."""
        return max(self.record.ticks // BIN_TICKS, 1)

    @cached_property
    def columns(self) -> Int:
        """(C,) columns of road users and props that can hide something."""
        opaque = find_opaque(self.record, self.over_roofs)
        opaque[list(self.absent)] = False
        return np.flatnonzero(opaque)

    @cached_property
    def standing(self) -> Bool:
        """(bins, C) whether each stands during the whole bin."""
        ticks = min(self.bins * BIN_TICKS, self.record.ticks)
        shape = self.bins, ticks // self.bins, len(self.columns)
        still = self.record.valid[:ticks, self.columns].reshape(shape).all(axis=1)
        for values in (self.record.x, self.record.y, self.record.yaw):
            still &= np.ptp(values[:ticks, self.columns].reshape(shape), axis=1) < STANDING_M
        return still

    @cached_property
    def poses(self) -> Float:
        """(3, bins, C) x, y and yaw at the begin of every bin, rounded so that what stands has one pose."""
        ticks = np.arange(self.bins) * BIN_TICKS
        values = (self.record.x, self.record.y, self.record.yaw)
        return np.stack([np.round(v[ticks][:, self.columns], d) for v, d in zip(values, (2, 2, 3), strict=True)])


@lru_cache(maxsize=64)
def make_box_table(boxes: tuple[SightBox, ...]) -> Float:
    """Return (5, K) boxes as columns of x, y, yaw, length and width. Cached: the same targets are looked at often."""
    return np.array(boxes, dtype=np.float64).reshape(-1, 5).T


@dataclass(frozen=True)
class StandingOccluders:
    """The occluders between a pair of road users."""

    vehicles: StandingVehicles
    roads: RoadMap
    pair: tuple[int, int]
    """Columns of the two, which do not hide each other."""
    region: shapely.Geometry
    """Contains every line of sight between the two."""

    def list_by_bin(self) -> list[tuple[SightBox, ...]]:
        """Return the boxes that stand during each bin, and as the last entry those of all times after the recording.

        Neighbouring bins are joined until there are at most `MAX_SETS` different sets: what stands in all of them.
        After the recording stands what stood during all of it.
        """
        between = self._find_between()
        standing, joined, bins = between, 1, self.vehicles.bins
        while joined < bins and len(np.unique(standing, axis=0)) > MAX_SETS:
            joined *= 2
            groups = np.arange(bins) // joined
            standing = np.array([between[groups == group].all(axis=0) for group in groups.tolist()])
        rows = [*standing, between.all(axis=0)]
        return [self._build_boxes(min(number, bins - 1), np.asarray(row)) for number, row in enumerate(rows)]

    def _build_boxes(self, number: int, chosen: Bool) -> tuple[SightBox, ...]:
        e, rows = self.vehicles.record, np.flatnonzero(chosen)
        columns = self.vehicles.columns[rows]
        table = np.stack((*self.vehicles.poses[:, number, rows], e.length[columns], e.width[columns]), axis=-1)
        return tuple(SightBox(*row) for row in table.tolist())

    def _find_between(self) -> Bool:
        """Return (bins, C) whether each stands in the region during the whole bin."""
        e, vehicles = self.vehicles.record, self.vehicles
        is_between = vehicles.standing & ~np.isin(vehicles.columns, self.pair)
        bins, rows = np.nonzero(is_between)
        points = shapely.points(vehicles.poses[0, bins, rows], vehicles.poses[1, bins, rows])
        reach = portable.hypot(e.length, e.width)[vehicles.columns] / 2
        is_between[bins, rows] = np.asarray(shapely.distance(points, self.region)) <= reach[rows]
        return is_between

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
        self, eye: tuple[float, float], erosion: float, occluders: tuple[SightBox, ...], targets: tuple[SightBox, ...]
    ) -> Bool:
        """Return (K,) whether anything of each target can be seen from anywhere within `erosion` [m] of a point."""
        erosion = float(np.ceil(erosion / EROSION_STEP_M)) * EROSION_STEP_M
        left = [
            box._replace(length=box.length - 2.0 * erosion, width=box.width - 2.0 * erosion)
            for box in occluders
            if min(box.length, box.width) > 2.0 * erosion
        ]
        columns = np.concatenate((make_box_table(targets), make_box_table(tuple(left))), axis=1)
        kinds = np.array([Kind.PEDESTRIAN] * len(targets) + [Kind.VEHICLE] * len(left), dtype=np.uint8)
        x, y, yaw, length, width = columns
        boxes = Objects(("",) * len(kinds), kinds, x, y, yaw, np.zeros(len(kinds)), length, width)
        view = SightView(
            SensorPose(*eye, 0.0, None), SensingFrame(0, boxes, {}), self.erode_buildings(erosion), RANGE_M
        )
        return view.visible_fractions()[: len(targets)] > 0.0


def _list_polygons(shape: shapely.Geometry) -> list[shapely.Polygon]:
    return [part for part in shapely.get_parts(shape) if isinstance(part, shapely.Polygon) and not part.is_empty]
