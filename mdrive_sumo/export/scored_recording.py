"""ScoredRecording: one recorded episode with all that an export needs to describe it."""

from dataclasses import dataclass

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Bool, Float
from mdrive_sumo.core.state import Kind
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scoring import ScenarioResult
from mdrive_sumo.sensing.lidar_world import assume_heights

CATEGORY_BY_LENGTH_M: tuple[tuple[float, str], ...] = ((5.4, "car"), (6.5, "van"), (float("inf"), "truck"))
"""Category of a vehicle up to this length [m] where the scenario names none."""
CATEGORY_BY_KIND = {Kind.PEDESTRIAN: "pedestrian", Kind.CYCLIST: "bicycle", Kind.STATIC: "static"}
CATEGORY_BY_MODEL = {
    **{name: name for name in ("car", "van", "truck", "bus", "motorcycle")},
    **{f"parked-{name}": name for name in ("car", "van", "truck")},
}
"""Category by the model that the scenario names: a category of a log, or a prop (`scenario.props`)."""


@dataclass(frozen=True, slots=True)
class ScoredRecording:
    """What was recorded, the scenario as the seed drew it, its network, and the scores."""

    record: EpisodeRecord
    scenario: Scenario
    roads: RoadMap
    result: ScenarioResult
    name: str
    """Name of its files: the id of the scenario, with the seed where a run has several."""

    @property
    def heights(self) -> Float:
        """Heights (N,) [m] of the boxes, assumed as for the LiDAR sensor: a recording is flat."""
        return assume_heights(self.record.kind, self.record.length)

    @property
    def categories(self) -> tuple[str, ...]:
        """Category of every column: car, van, truck, bus, motorcycle, bicycle, pedestrian or static."""
        models = {actor.id: actor.model for actor in self.scenario.actors}
        columns = zip(self.record.ids, self.record.kind, self.record.length, strict=True)
        return tuple(_find_category(models.get(id_, ""), Kind(int(kind)), float(m)) for id_, kind, m in columns)

    def shift_ahead(self, metres: Float) -> tuple[Float, Float]:
        """Return x and y (T, N) [m] of the points that lie so many metres (N,) ahead of the box centres."""
        cos, sin = portable.cos_sin(self.record.yaw)
        return self.record.x + metres * cos, self.record.y + metres * sin


def _find_category(model: str, kind: Kind, length: float) -> str:
    if kind is not Kind.VEHICLE:
        return CATEGORY_BY_KIND[kind]
    by_length = next(category for most, category in CATEGORY_BY_LENGTH_M if length <= most)
    return CATEGORY_BY_MODEL.get(model, by_length)


def list_presences(valid: Bool) -> list[range]:
    """Return the ranges of ticks, of a column (T,), in which the road user is in the world without a break."""
    edges = np.flatnonzero(np.diff(valid.astype(np.int8), prepend=0, append=0)).tolist()
    return [range(first, end) for first, end in zip(edges[::2], edges[1::2], strict=True)]
