"""Exact line of sight in the plane: visible share of each box past vehicles, static props and buildings.

A ray from the eye meets a box or building first on an edge that faces the eye, so only those edges matter. The angles
of their ends cut the circle into intervals, in each of which the same edges lie side by side; 1/distance of an edge is
A cos + B sin of the direction, so that two edges of an interval change places at most once, at a known angle.
Nothing is sampled. Pedestrians, cyclists and low props (cones, crates) hide nothing. A box or building that contains
the eye (after a collision, or by its mounting) hides nothing, and a box around the eye is fully visible.
"""

from dataclasses import dataclass, field
from functools import cache, cached_property

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import TAU, Bool, Float
from mdrive_sumo.sensing.building_edges import BuildingEdges
from mdrive_sumo.sensing.sensing_frame import SensingFrame, SensorPose
from mdrive_sumo.sensing.sight_batch import SightBatch

__all__ = ["BuildingEdges", "SightView", "announce_eye"]


def announce_eye(scene: SensingFrame, eye: SensorPose, range_m: float) -> int:
    """Return the number of an eye that may look at the scene, for `SightView.number`."""
    scene.announced_eyes.append((eye, range_m))
    return len(scene.announced_eyes) - 1


@dataclass(frozen=True)
class SightView:
    """Visibility from one sensor pose within range_m."""

    eye: SensorPose
    scene: SensingFrame
    buildings: BuildingEdges
    range_m: float
    number: int | None = None
    """Number of the eye among those announced: it is computed together with them. There is one map."""
    _free_m_by_sectors: dict[int, Float] = field(default_factory=dict[int, Float], compare=False, repr=False)
    """A pure cache: detections and false positives need the same free sight."""

    @cached_property
    def _batch_and_row(self) -> tuple[SightBatch, int]:
        if self.number is None:
            return SightBatch(self.scene, self.buildings, ((self.eye, self.range_m),)), 0
        begin, batches = 0, self.scene.list_derived(SightBatch)
        for batch in batches:
            if self.number < begin + len(batch.distances):
                return batch, self.number - begin
            begin += len(batch.distances)
        batches.append(SightBatch(self.scene, self.buildings, self.scene.announced_eyes[begin:]))
        return batches[-1], self.number - begin

    @property
    def distances(self) -> Float:
        """(N,) distance from the eye to the nearest point of each box [m]; infinite for the carrier's own."""
        batch, row = self._batch_and_row
        return batch.distances[row]

    def visible_fractions(self) -> Float:
        """Return the visible share (N,) in [0, 1] of each box's angular width; 0 for the carrier and out of range."""
        batch, row = self._batch_and_row
        return batch.visible_fractions[row]

    def free_sight(self, sectors: int) -> Float:
        """Return the distance (sectors,) [m] to the first building, vehicle or high static box, at most range_m.

        Each value belongs to the ray at the beginning of its equal sector, counter-clockwise from the eye's yaw.
        """
        if sectors not in self._free_m_by_sectors:
            self._free_m_by_sectors[sectors] = self._measure_free_sight(sectors)
        return self._free_m_by_sectors[sectors].copy()

    def _measure_free_sight(self, sectors: int) -> Float:
        batch, row = self._batch_and_row
        edges, step = batch.select_edges(row), TAU / sectors
        turned = ((edges.right - self.eye.yaw) % TAU) / step
        first = np.ceil(turned)
        after = np.floor(turned + edges.extent / step) + 1
        counts = np.where(edges.hides, np.maximum(after - first, 0), 0).astype(np.intp)
        edge = np.repeat(np.arange(len(counts)), counts)
        begins = np.cumsum(counts) - counts
        sector = (np.arange(len(edge)) + (first.astype(np.intp) - begins)[edge]) % sectors
        cos, sin = _turn_rays(sectors, self.eye.yaw)
        near = np.full(sectors, 1.0 / self.range_m)
        inverse_m = edges.cos[edge] * cos[sector] + edges.sin[edge] * sin[sector]
        np.maximum.at(near, sector, inverse_m)
        return 1.0 / near

    def visible_rows(self, min_share: float) -> Bool:
        """Return an (N,) mask of the boxes of which more than nothing and at least `min_share` is visible."""
        fractions = self.visible_fractions()
        return (fractions > 0.0) & (fractions >= min_share)


def _turn_rays(count: int, yaw: float) -> tuple[Float, Float]:
    """Return cosines and sines (count,) of rays that are evenly spaced from yaw [rad] on, counter-clockwise."""
    cos, sin = portable.cos_sin(yaw)
    ray_cos, ray_sin = _build_rays(count)
    return ray_cos * cos - ray_sin * sin, ray_sin * cos + ray_cos * sin


@cache
def _build_rays(count: int) -> tuple[Float, Float]:
    return portable.cos_sin(np.arange(count) * (TAU / count))
