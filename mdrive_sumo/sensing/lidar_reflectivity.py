"""What surfaces reflect of a LiDAR's light at 905 nm: a draw for every instance from the range of its class.

The ranges of classes overlap, so that an intensity does not name the class. The numbers are round and cover what is
published for materials near 905 nm; shares within a range are a surrogate: uniform. docs/lidar-returns.md has sources.
"""

from dataclasses import dataclass

import numpy as np

from mdrive_sumo.contract import Objects
from mdrive_sumo.core.seeding import draw_uniforms
from mdrive_sumo.core.state import Kind
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.sensing.lidar_rays import Float32
from mdrive_sumo.sensing.lidar_world import BUILDING_M, assume_heights
from mdrive_sumo.sensing.street_furniture import FurnitureKind, StreetFurniture


@dataclass(frozen=True, slots=True)
class ReflectiveSurface:
    """Two parts of a body, one above the other, and the ranges from which their reflectivities are drawn."""

    lower: tuple[float, float]
    upper: tuple[float, float]
    share: float = 1.0
    """Of the height, up to which the lower part reaches."""
    plate: float = 0.0
    """Reflectivity of plates at the front and the rear; 0: there are none."""


CLOTHES, RETROREFLECTOR = (0.05, 0.8), 4.0
"""A dark dye with carbon absorbs, others let near infrared through. A retroreflector saturates the sensor."""
SURFACE_OF_KIND = {
    # Paint: carbon black to white. Windows: little of glass itself, pillars and, through the glass twice, seats.
    Kind.VEHICLE: ReflectiveSurface((0.04, 0.85), (0.05, 0.6), 0.62, RETROREFLECTOR),
    Kind.PEDESTRIAN: ReflectiveSurface(CLOTHES, CLOTHES, 0.5),
    Kind.CYCLIST: ReflectiveSurface((0.04, 0.7), CLOTHES, 0.5),  # tyres, frame and legs; clothes
    Kind.STATIC: ReflectiveSurface((0.04, 0.85), (0.04, 0.85), 0.5),  # rubber, concrete, wood, white plastic
}
BUILDING = ReflectiveSurface((0.1, 0.85), (0.1, 0.85), 0.3)
"""Ground floor and the floors above: dark brick to white masonry (0.85)."""
PLANT = ReflectiveSurface((0.25, 0.7), (0.25, 0.7), 0.2)
"""Bark, conifers (0.3), broad leaves (0.6)."""
PLANTS = frozenset(("tree", "hedge", "wood", "planting"))
"""Words in ids of buildings that are plants: networks have all that blocks sight as buildings."""
SURFACE_OF_FURNITURE = {
    FurnitureKind.POLE: ReflectiveSurface((0.2, 0.6), (0.2, 0.6)),  # zinc and paint
    FurnitureKind.SIGN: ReflectiveSurface((RETROREFLECTOR, RETROREFLECTOR), (RETROREFLECTOR, RETROREFLECTOR)),
    FurnitureKind.SIGNAL: ReflectiveSurface((0.05, 0.3), (0.05, 0.3)),  # dark plastic
    FurnitureKind.LAMP: ReflectiveSurface((0.2, 0.6), (0.2, 0.6)),
    FurnitureKind.TRUNK: PLANT,
    FurnitureKind.CROWN: PLANT,
}
ASPHALT = ReflectiveSurface((0.1, 0.25), (0.1, 0.25))
"""About 0.17 with pebbles."""
WET_SHARE = 0.7
"""Of what dry ground reflects: sand has 0.57 dry and 0.41 wet."""


@dataclass(frozen=True, slots=True)
class Reflectivities:
    """Of all that can be hit, (owners,)."""

    lower: Float32
    """Below the split, and of roofs."""
    upper: Float32
    split: Float32
    """[m] Height of the split above the ground."""
    plate: Float32
    """Of the plates at front and rear; 0: there are none."""


Row = tuple[float, float, float, float]


class ReflectivityDraws:
    """Draws what everything of an episode reflects: by owner the ground, the boxes, the buildings, the furniture."""

    def __init__(self, roads: RoadMap, furniture: StreetFurniture, salt: int, is_wet: bool) -> None:
        """salt: of this episode, so that no reflectivity tells which instance something is."""
        self._salt = salt
        share = WET_SHARE if is_wet else 1.0
        self._ground = [tuple(share * value for value in self._draw("ground", ASPHALT, 0.0))]
        self._still = [
            self._draw(f"building:{one.id}", PLANT if _is_plant(one.id) else BUILDING, BUILDING_M)
            for one in roads.buildings
        ]
        pairs = zip(furniture.kinds, furniture.names, strict=True)
        self._still += [self._draw(name, SURFACE_OF_FURNITURE[kind], 0.0) for kind, name in pairs]
        self._rows: dict[str, Row] = {}
        self._last: tuple[tuple[str, ...], Reflectivities] | None = None

    def list_by_owner(self, boxes: Objects) -> Reflectivities:
        """Return the reflectivities with these boxes in their order; a box keeps its own by its id."""
        if self._last is None or self._last[0] != boxes.ids:
            self._last = boxes.ids, self._list_anew(boxes)
        return self._last[1]

    def _list_anew(self, boxes: Objects) -> Reflectivities:
        heights = assume_heights(boxes.kind, boxes.length)
        for i, name in enumerate(boxes.ids):
            if name not in self._rows:
                surface = SURFACE_OF_KIND[Kind(int(boxes.kind[i]))]
                self._rows[name] = self._draw(f"box:{name}", surface, float(heights[i]))
        rows = [*self._ground, *(self._rows[name] for name in boxes.ids), *self._still]
        return Reflectivities(*np.array(rows, dtype=np.float32).T.copy())

    def _draw(self, name: str, surface: ReflectiveSurface, height_m: float) -> Row:
        first, second, *_ = draw_uniforms(self._salt, "reflectivity", name)
        (low, high), (upper_low, upper_high) = surface.lower, surface.upper
        lower, upper = low + (high - low) * first, upper_low + (upper_high - upper_low) * second
        return lower, upper, surface.share * height_m, surface.plate


def _is_plant(building: str) -> bool:
    return not PLANTS.isdisjoint(building.split("_"))
