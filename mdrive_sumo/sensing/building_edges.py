"""BuildingEdges: the walls of a map, and which of them are near an eye."""

import numpy as np
import numpy.typing as npt

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.roads import RoadMap

Rows = npt.NDArray[np.intp]


class BuildingEdges:
    """The building edges of a map, indexed by building."""

    def __init__(self, roads: RoadMap) -> None:
        """`roads` may have no buildings; their outlines may run either way round."""
        rings = [_counter_clockwise(np.array(building.polygon, dtype=np.float64)) for building in roads.buildings]
        starts = np.concatenate([np.zeros((0, 2)), *rings])
        ends = np.concatenate([np.zeros((0, 2)), *(np.roll(ring, -1, axis=0) for ring in rings)])
        self.walls: Float = np.stack((starts[:, 0], ends[:, 0], starts[:, 1], ends[:, 1]))
        """(4, W) x of their starts and ends, y of their starts and ends [m]."""
        self._middles = np.array([(ring.min(0) + ring.max(0)) / 2 for ring in rings]).reshape(-1, 2)
        self._radii = np.array(
            [portable.hypot(*(ring - middle).T).max() for ring, middle in zip(rings, self._middles, strict=True)]
        )
        self._building = np.repeat(np.arange(len(rings)), [len(ring) for ring in rings])

    def find_near(self, x: Float, y: Float, reach_m: Float) -> tuple[Rows, Rows]:
        """Return eye and wall of all pairs of an eye at x, y (V,) and a wall of a building within its reach_m (V,)."""
        if not len(self._radii):
            return np.zeros(0, np.intp), np.zeros(0, np.intp)
        gap = portable.hypot(self._middles[:, 0] - x[:, None], self._middles[:, 1] - y[:, None]) - self._radii
        near = gap <= reach_m[:, None]
        eye, wall = near[:, self._building].nonzero()
        return eye, wall


def _counter_clockwise(ring: Float) -> Float:
    after = np.roll(ring, -1, axis=0)
    area = (ring[:, 0] * after[:, 1] - after[:, 0] * ring[:, 1]).sum()
    return ring if area > 0 else ring[::-1]
