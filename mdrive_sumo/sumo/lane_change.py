"""Lane changes of vehicles with a schedule, at the places of the log.

SUMO's own continuous lane changes corrupt its memory when such vehicles use them (libsumo 1.28: "Request backPos of
vehicle ... for invalid lane", then std::bad_alloc), so we make them: in SUMO the vehicle is on one lane or the other,
put over when its centre crosses the marking, and its way across is added to the poses that we read. Of a car of 1.8 m
on lanes of 3.2 m, what vehicles on the other lane sweep is touched only 0.1 s longer than SUMO has it there.
"""

# pyright: basic
import math
from collections.abc import Callable

import libsumo
import numpy as np

from mdrive_sumo.core.geometry import Bool, boxes_corners, boxes_overlap
from mdrive_sumo.core.state import DT, Actors
from mdrive_sumo.roads import Lane

DURATION_S = 3.0
"""From lane centre to lane centre; the marking is crossed half-way."""
GAP_M = 1.0
"""Free before and behind it on the lane beside [m]."""
FORESIGHT_S = 1.0
"""The gap must be there now and after this time, everybody going on as now."""
Others = Callable[[], Actors]
"""All road users of the tick before, CAVs too."""


class LaneChange:
    """One change in progress."""

    def __init__(self, name: str, target: Lane, width: float) -> None:
        """`width`: how far it is to the centre of the target lane [m], left positive."""
        self._name, self._target, self._width = name, target, width
        self._share = 0.0

    @property
    def done(self) -> bool:
        """Whether it is over, carried out or given up."""
        return self._share >= 1.0 or self._share < 0.0

    @property
    def offset(self) -> tuple[float, float]:
        """Where the vehicle is [m] left of the lane that SUMO has it on, and how fast it goes to the left [m/s]."""
        share = min(max(self._share, 0.0), 1.0)
        eased = share * share * (3.0 - 2.0 * share)
        rate = 6.0 * share * (1.0 - share) / DURATION_S
        return self._width * (eased if share < 0.5 else eased - 1.0), self._width * rate

    def advance(self, others: Others) -> None:
        """One tick on; back again while the lane beside is taken or the edge ends before the marking is crossed."""
        if self._share >= 0.5:
            self._share += DT / DURATION_S
            return
        here = libsumo.vehicle.getRoadID(self._name) == self._target.edge
        if not here or not self._free(others()):
            self._share -= DT / DURATION_S
            return
        self._share += DT / DURATION_S
        if self._share >= 0.5:
            libsumo.vehicle.moveTo(self._name, self._target.id, libsumo.vehicle.getLanePosition(self._name))

    def _free(self, others: Actors) -> bool:
        i = others.ids.index(self._name)
        ahead = np.array((0.0, FORESIGHT_S))[:, None] * others.speed
        cos, sin = np.cos(others.yaw), np.sin(others.yaw)
        x, y = others.x + cos * ahead, others.y + sin * ahead
        boxes = boxes_corners(x, y, others.yaw, others.length, others.width)
        beside = self._width - self.offset[0]
        mine = boxes_corners(
            x[:, i] - sin[i] * beside, y[:, i] + cos[i] * beside, others.yaw[i], others.length[i] + 2 * GAP_M,
            others.width[i],
        )  # fmt: skip
        hit: Bool = boxes_overlap(mine[:, None], boxes)
        hit[:, i] = False
        return not hit.any()


def shifted(actors: Actors, offsets: dict[str, tuple[float, float]]) -> None:
    """Adds to the poses of freshly read actors, in place, how far lane changes have taken them aside (m, m/s)."""
    for name, (aside, rate) in offsets.items():
        if name not in actors.ids:
            continue
        i = actors.ids.index(name)
        actors.x[i] -= math.sin(actors.yaw[i]) * aside
        actors.y[i] += math.cos(actors.yaw[i]) * aside
        actors.yaw[i] += math.atan2(rate, max(actors.speed[i], 1.0))
