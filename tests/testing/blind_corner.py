"""A crossing made by hand, where it is known who sees whom: a CAV drives east, another road user north past a wall."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mdrive_sumo.core.state import Kind
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.episode.quantization import to_quanta
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.roads.network_file import Building
from mdrive_sumo.scenario.scenario import RoadsideUnit, Scenario
from testing.worlds import straight_ego, straight_road, straight_scenario

CROSSING_X = 60.0
CAR = (4.9, 2.0)
LIMIT = 13.89
SPACING_M = 40.0


@dataclass(frozen=True)
class BlindCorner:
    """CAV "a" goes 90 m east along y = 0, "b" north along x = 60."""

    gap: float = 0.5
    """From the side of "b" to the wall [m]."""
    side: float = 2.0
    """From the centre line of "a" to the wall [m]."""
    speed: float = 14.0
    """Of "b" [m/s]."""
    time_limit_s: float = 12.0
    kind: Kind = Kind.VEHICLE
    is_cav: bool = True
    """Whether "b" is a CAV, and so tells of itself."""
    has_wall: bool = True
    rsus: tuple[RoadsideUnit, ...] = ()
    corners: int = 1
    """How many such crossings follow each other at `SPACING_M`, each with a wall and a road user of its own."""
    more: Sequence[tuple[float, float, float, float, float]] = ()
    """Further boxes that stand: x, y, yaw, length, width."""
    more_kind: Kind = Kind.VEHICLE

    @property
    def crossings(self) -> list[float]:
        """Stations [m] on the route of "a" at which the others cross."""
        return [CROSSING_X + SPACING_M * k for k in range(self.corners)]

    @property
    def roads(self) -> RoadMap:
        """The lane of "a" and the wall before each crossing, on its right."""
        buildings = [self._build_wall(f"wall{k}", x) for k, x in enumerate(self.crossings)] if self.has_wall else []
        return replace(straight_road(60.0 + self.length), buildings=tuple(buildings))

    def _build_wall(self, name: str, crossing_x: float) -> Building:
        right = crossing_x - CAR[1] / 2 - self.gap
        left = right - (70.0 if self.corners == 1 else SPACING_M - 10.0)
        far = -self.side - 80
        return Building(id=name, polygon=((left, far), (right, far), (right, -self.side), (left, -self.side)))

    @property
    def length(self) -> float:
        """Length of the route of "a" [m]."""
        return 90.0 + SPACING_M * (self.corners - 1)

    @property
    def scenario(self) -> Scenario:
        """The scenario with the CAV "a" alone as the one that is asked about."""
        ego = straight_ego("a", 0.0, round(self.length)).model_copy(update={"time_limit_s": self.time_limit_s})
        return straight_scenario(ego).model_copy(update={"rsus": self.rsus})

    @property
    def record(self) -> EpisodeRecord:
        """8 s in which "a" drives 10 m/s, and every other road user is at its crossing after 5 s."""
        ticks, others = np.arange(160), self.corners
        count = 1 + others + len(self.more)
        states = np.zeros((len(ticks), count, 4))
        states[:, 0, 0], states[:, 0, 3] = ticks * 0.5, 10.0
        for i, crossing_x in enumerate(self.crossings, 1):
            states[:, i, 0], states[:, i, 2], states[:, i, 3] = crossing_x, np.pi / 2, self.speed
            states[:, i, 1] = (ticks - 100) / 20 * self.speed
        for i, (x, y, yaw, _, _) in enumerate(self.more, 1 + others):
            states[:, i] = x, y, yaw, 0.0
        small = (0.6, 0.6) if self.kind is Kind.PEDESTRIAN else CAR
        sizes = np.array([CAR, *[small] * others, *(box[3:] for box in self.more)])
        names = ("b", *(f"b{k}" for k in range(1, others)))
        egos = 1 + self.is_cav * others
        return EpisodeRecord(
            scenario="corner",
            about={},
            ids=("a", *names, *(f"stands{i}" for i in range(len(self.more)))),
            egos=egos,
            kind=np.array([Kind.VEHICLE] + [self.kind] * others + [self.more_kind] * len(self.more), dtype=np.uint8),
            length=sizes[:, 0],
            width=sizes[:, 1],
            valid=np.ones((len(ticks), count), dtype=np.bool_),
            quanta=to_quanta(states),
            controls=np.zeros((len(ticks), egos, 3), dtype=np.int16),
            plans=(),
            contacts=(),
            signals=(),
            endings=(),
            digests=np.zeros((len(ticks), 8), dtype=np.uint8),
        )


def see_past_corner(corner: BlindCorner, eye_x: float) -> float:
    """Return the least y [m] of the west side of "b"'s lane strip that an eye at (eye_x, 0) sees past the wall."""
    dx = CROSSING_X - CAR[1] / 2 - corner.gap - eye_x
    return -np.inf if dx <= 0 else -corner.side * (CROSSING_X + CAR[1] / 2 - eye_x) / dx
