"""Rasterisation of polygons, exact at pixel centres.

Every edge leaves a signed mark at the first pixel to its right in every row that it crosses; the running sum along a
row is then the winding number. So polygons of one layer may overlap if they are all oriented the same way.
"""

import numpy as np
import numpy.typing as npt
import shapely

from mdrive_sumo.core.compiled import twin
from mdrive_sumo.core.geometry import Float, Int


def polygon_edges(shape: shapely.Geometry) -> Float:
    """Edges (E, 2, 2) [m], from and to, of polygons: outlines counter-clockwise, holes clockwise."""
    polygons = [part for part in shapely.get_parts(shape) if isinstance(part, shapely.Polygon)]
    rings = [
        shapely.get_coordinates(ring)
        for polygon in shapely.orient_polygons(np.array(polygons, dtype=object), exterior_cw=False)
        for ring in (polygon.exterior, *polygon.interiors)
    ]
    return np.concatenate([np.zeros((0, 2, 2)), *(np.stack((ring[:-1], ring[1:]), axis=1) for ring in rings)])


def box_edges(corners: Float) -> Float:
    """Edges (4 N, 2, 2) of N boxes with corners (N, 4, 2)."""
    return np.stack((corners, np.roll(corners, -1, axis=1)), axis=2).reshape(-1, 2, 2)


@twin
def fill_polygons(edges: Float, layer: Int, shape: tuple[int, int], /) -> npt.NDArray[np.uint8]:
    """Layers (max(layer) + 1, H, W) of 0 and 255 for a shape (layers, size): a pixel is 255 if its centre is inside.

    edges: (E, 2, 2) [pixels], (column, row) counted from the corner of the image; each layer's form closed rings.
    layer: (E,) to which layer each edge belongs.
    """
    layers, size = shape
    lowest = np.clip(np.ceil(edges[:, :, 1] - 0.5), 0, size).astype(np.int64)  # first row whose centre is not above
    top, bottom = lowest.min(axis=1), lowest.max(axis=1)
    count = bottom - top
    edge = np.repeat(np.arange(len(edges)), count)
    row = np.arange(len(edge)) - np.repeat(np.cumsum(count) - count - top, count)
    (x0, y0), (x1, y1) = edges[:, 0].T, edges[:, 1].T
    slope = np.divide(x1 - x0, y1 - y0, out=np.zeros(len(edges)), where=count > 0)
    crossing = x0[edge] + (row + 0.5 - y0[edge]) * slope[edge]
    column = np.clip(np.ceil(crossing - 0.5), 0, size).astype(np.int64)
    marks = np.zeros(layers * size * (size + 1), dtype=np.int8)
    np.add.at(marks, (layer[edge] * size + row) * (size + 1) + column, np.where(y1 > y0, 1, -1).astype(np.int8)[edge])
    winding = np.cumsum(marks, dtype=np.int8).reshape(layers, size, size + 1)  # every row sums to zero
    return (winding[:, :, :-1] != 0).view(np.uint8) * np.uint8(255)
