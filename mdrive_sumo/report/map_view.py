"""What a picture or a scene shows of the world: a rectangle around points, or the area near them."""

from dataclasses import dataclass

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.scenario.scenario import Scenario


@dataclass(frozen=True, slots=True)
class MapView:
    """The rectangle that a picture shows [m]."""

    left: float
    low: float
    right: float
    high: float

    @property
    def size(self) -> tuple[float, float]:
        """Width and height [m]."""
        return self.right - self.left, self.high - self.low

    @property
    def box(self) -> shapely.Polygon:
        """The rectangle as a polygon."""
        return shapely.box(self.left, self.low, self.right, self.high)

    def contains(self, shape: BaseGeometry) -> bool:
        """Return whether a part of the shape is visible."""
        return shape.intersects(self.box)

    def is_near(self, xy: Float, margin_m: float = 0.0) -> bool:
        """Return whether the bounding box of a line (N, 2) reaches the view."""
        (x0, y0), (x1, y1) = xy.min(0) - margin_m, xy.max(0) + margin_m
        return bool(x1 >= self.left and x0 <= self.right and y1 >= self.low and y0 <= self.high)


def fit_view(xy: Float, margin_m: float = 16.0, min_side_m: float = 60.0, min_aspect: float = 0.45) -> MapView:
    """Return a view around points (N, 2) [m] with a margin; points that are not finite are left out.

    min_aspect: neither side is shorter than this share of the other.
    """
    finite = xy[np.isfinite(xy).all(1)]
    finite = finite if len(finite) else np.zeros((1, 2))
    centre = (finite.min(0) + finite.max(0)) / 2
    half = np.maximum((finite.max(0) - finite.min(0)) / 2 + margin_m, min_side_m / 2)
    half = np.maximum(half, half.max() * min_aspect)
    (left, low), (right, high) = centre - half, centre + half
    return MapView(float(left), float(low), float(right), float(high))


def list_route_points(record: EpisodeRecord, scenario: Scenario) -> Float:
    """Return the points (K, 2) [m] of all that CAVs drove and of all routes."""
    driven = record.valid[:, : record.egos]
    xy = np.stack((record.x[:, : record.egos][driven], record.y[:, : record.egos][driven]), axis=-1)
    return np.concatenate([xy, *(ego.xy for ego in scenario.egos)])


def find_area(points: Float, margin_m: float, cell_m: float) -> BaseGeometry:
    """Return the area within a margin [m] of points (N, 2) [m], which are grouped by cells of a grid first."""
    cells = np.unique(np.rint(points / cell_m), axis=0) * cell_m
    return shapely.MultiPoint(cells).buffer(margin_m + cell_m, quad_segs=4)
