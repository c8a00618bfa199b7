"""Lane changes of vehicles with a schedule, at the positions of the log.

SUMO's own continuous lane changes corrupt its memory for such vehicles (libsumo 1.28: "Request backPos of vehicle ...
for invalid lane", then std::bad_alloc). Instead, the vehicle is on one lane or the other in SUMO: it is moved when its
centre crosses the marking, and the lateral offset is added to the poses that are read. A car of 1.8 m on lanes of 3.2 m
overlaps the strip that vehicles on the other lane sweep for only 0.1 s longer than SUMO has it there.
"""

# pyright: basic
# Because libsumo has no type information.
from collections.abc import Callable

import libsumo
import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Bool, boxes_corners, boxes_overlap
from mdrive_sumo.core.state import DT, Actors
from mdrive_sumo.roads import Lane

DURATION_S = 3.0
"""Time [s] from lane centre to lane centre; the marking is crossed half-way."""
GAP_M = 1.0
"""Free length [m] ahead and behind on the adjacent lane."""
PREDICTION_S = 1.0
"""The gap must exist now and after this time [s], at constant velocities."""
RoadUsersProvider = Callable[[], Actors]
"""Returns all road users of the last tick, including CAVs."""


class ScheduledLaneChange:
    """One lane change in progress."""

    def __init__(self, name: str, target: Lane, width: float) -> None:
        """`width`: lateral distance [m] to the centre of the target lane, left positive."""
        self._name, self._target, self._width = name, target, width
        self._progress = 0.0

    @property
    def is_done(self) -> bool:
        """Whether the lane change is completed or aborted."""
        return self._progress >= 1.0 or self._progress < 0.0

    @property
    def offset(self) -> tuple[float, float]:
        """Offset [m] to the left of the lane that SUMO has the vehicle on, and its rate [m/s]."""
        progress = min(max(self._progress, 0.0), 1.0)
        smoothed = progress * progress * (3.0 - 2.0 * progress)
        rate = 6.0 * progress * (1.0 - progress) / DURATION_S
        return self._width * (smoothed if progress < 0.5 else smoothed - 1.0), self._width * rate

    def advance(self, road_users: RoadUsersProvider) -> None:
        """Advance by one tick; move back while the adjacent lane is occupied or the edge ends before the marking."""
        if self._progress >= 0.5:
            self._progress += DT / DURATION_S
            return
        here = libsumo.vehicle.getRoadID(self._name) == self._target.edge
        if not here or not self._is_gap_free(road_users()):
            self._progress -= DT / DURATION_S
            return
        self._progress += DT / DURATION_S
        if self._progress >= 0.5:
            libsumo.vehicle.moveTo(self._name, self._target.id, libsumo.vehicle.getLanePosition(self._name))

    def _is_gap_free(self, road_users: Actors) -> bool:
        i = road_users.ids.index(self._name)
        ahead = np.array((0.0, PREDICTION_S))[:, None] * road_users.speed
        cos, sin = portable.cos_sin(road_users.yaw)
        x, y = road_users.x + cos * ahead, road_users.y + sin * ahead
        boxes = boxes_corners(x, y, road_users.yaw, road_users.length, road_users.width)
        remaining = self._width - self.offset[0]
        own_boxes = boxes_corners(
            x[:, i] - sin[i] * remaining, y[:, i] + cos[i] * remaining, road_users.yaw[i],
            road_users.length[i] + 2 * GAP_M,
            road_users.width[i],
        )  # fmt: skip
        hit: Bool = boxes_overlap(own_boxes[:, None], boxes)
        hit[:, i] = False
        return not hit.any()


def apply_offsets(actors: Actors, offsets: dict[str, tuple[float, float]]) -> None:
    """Add lateral offsets and their rates [m, m/s] to the poses of newly read actors, in place."""
    for name, (offset, rate) in offsets.items():
        if name not in actors.ids:
            continue
        i = actors.ids.index(name)
        cos, sin = portable.cos_sin(actors.yaw[i])
        actors.x[i] -= sin * offset
        actors.y[i] += cos * offset
        actors.yaw[i] += portable.atan2(rate, max(actors.speed[i], 1.0))
