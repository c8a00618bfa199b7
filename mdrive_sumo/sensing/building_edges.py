"""BuildingEdges: the walls of a map, and which of them are near an eye."""

from collections.abc import Iterator

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float, Int
from mdrive_sumo.roads import RoadMap


class BuildingEdges:
    """The building edges of a map, by building."""

    def __init__(self, roads: RoadMap) -> None:
        """`roads` may have no buildings; their outlines may run either way round."""
        rings = [_counter_clockwise(np.array(building.polygon, dtype=np.float64)) for building in roads.buildings]
        walls = [np.column_stack((ring, np.roll(ring, -1, axis=0))) for ring in rings]
        self.walls: Float = np.concatenate([np.zeros((0, 4)), *walls])
        """(W, 4) x and y of their starts and ends [m], those of a building together."""
        self.ends: Int = np.cumsum([0, *map(len, rings)])[1:]
        """(B,) index in `walls` after the last wall of each building."""
        middles = np.array([(ring.min(0) + ring.max(0)) / 2 for ring in rings]).reshape(-1, 2)
        radii = [portable.hypot(*(ring - middle).T).max() for ring, middle in zip(rings, middles, strict=True)]
        self.circles: Float = np.column_stack((middles, np.array(radii)))
        """(B, 3) centre and radius of a circle around each building [m]."""

    def find_near(self, x: float, y: float, reach_m: float) -> Iterator[tuple[float, float, float, float]]:
        """Yield the walls of all buildings within reach_m of an eye at (x, y)."""
        begin = 0
        for (middle_x, middle_y, radius), end in zip(self.circles.tolist(), self.ends.tolist(), strict=True):
            if portable.hypot(middle_x - x, middle_y - y) - radius <= reach_m:
                yield from map(tuple, self.walls[begin:end].tolist())
            begin = end


def _counter_clockwise(ring: Float) -> Float:
    after = np.roll(ring, -1, axis=0)
    area = (ring[:, 0] * after[:, 1] - after[:, 0] * ring[:, 1]).sum()
    return ring if area > 0 else ring[::-1]
