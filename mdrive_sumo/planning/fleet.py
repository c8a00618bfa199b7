"""What an omniscient driver knows of everybody else: where they will be, and which of its own cells that blocks."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from mdrive_sumo.contract import Objects, OwnState, Plan
from mdrive_sumo.core.geometry import Bool, Float, Int, boxes_corners
from mdrive_sumo.core.state import Kind
from mdrive_sumo.planning.path import SPACING_M, Path
from mdrive_sumo.planning.path_overlap import PLAN_MARGIN, Margin, cells_of, footprints, overlaps, path_overlaps

GONE_M = 2.0
"""A CAV leaves the world when it passes its goal; by this far beyond it, it is surely gone."""
FORESIGHT_S, ON_FOOT_S = 4.0, 12.0
"""How long background traffic is expected to go straight on; how long people on foot are."""
STANDING_SPEED = 0.1
STANDING_MARGIN = Margin(0.5, 0.2)
"""What stands needs less of a margin: it will be where it is."""
WIDENING = 0.1
"""[m/s] How fast the box of a background vehicle grows while it is predicted."""


@dataclass
class Fleet:
    """The CAVs of a scenario: the path of each, and where any two are in each other's way."""

    paths: Mapping[str, Path]
    size: tuple[float, float]
    _overlaps: dict[tuple[str, str, Margin], Bool] = field(default_factory=dict[tuple[str, str, Margin], Bool])

    def overlap(self, mine: str, other: str, margin: Margin = PLAN_MARGIN) -> Bool:
        """See `path_overlaps`; computed when first asked."""
        if mine > other:
            return self.overlap(other, mine, margin).T
        key = (mine, other, margin)
        if key not in self._overlaps:
            self._overlaps[key] = path_overlaps(self.paths[mine], self.paths[other], self.size, margin)
        return self._overlaps[key]

    def blocked(self, mine: str, cells: Int, other: str, stations: Float, margin: Margin = PLAN_MARGIN) -> Bool:
        """Which of my cells (J,) the other blocks at arc lengths `stations` (T,) [m]: (T, J); beyond its goal none."""
        path = self.paths[other]
        table = self.overlap(mine, other, margin)[cells][:, cells_of(path, stations)]
        return table.T & (stations < path.goal_s + GONE_M)[:, None]

    def standing_in_way(self, ego: str) -> frozenset[str]:
        """CAVs whose start lies in the way of ego: it cannot arrive before they have left."""
        length, width = self.size
        mine = footprints(self.paths[ego], length, width + 2 * PLAN_MARGIN.across)
        others = [other for other in self.paths if other != ego]
        starts = np.array([footprints(self.paths[other], length, width)[0] for other in others]).reshape(-1, 4, 2)
        return frozenset(np.array(others)[overlaps(mine, starts).any(0)].tolist())


def expected_stations(path: Path, state: OwnState, plan: Plan | None, times: Float, age_s: float) -> Float:
    """Arc length (T,) [m] on its path at `times` from now of a CAV with that state, by its plan made `age_s` ago.

    Beyond the end of its plan, and without one, it goes on at its last speed.
    """
    if plan is None:
        here = path.project(state.x, state.y, 0.0, within_m=path.length)
        return here + max(state.speed, 0.0) * times
    gaps = ((plan.points[:, None] - path.xy[None]) ** 2).sum(-1)
    stations = np.maximum.accumulate(gaps.argmin(1) * SPACING_M)
    due = (np.arange(len(stations)) + 1) * plan.interval_s - age_s
    speed = (stations[-1] - stations[-2]) / plan.interval_s if len(stations) > 1 else 0.0
    return np.interp(times, due, stations) + speed * np.maximum(times - due[-1], 0.0)


def objects_block(
    path: Path, cells: Int, objects: Objects, times: Float, size: tuple[float, float], margin: Margin
) -> Bool:
    """Which of the cells (J,) of a car of that size [m] are blocked at `times` (T,) by actors that are no CAVs: (T, J).

    They go straight on at their speed for `FORESIGHT_S` (`ON_FOOT_S`) and are forgotten then; who stands, stays.
    """
    blocked = np.zeros((len(times), len(cells)), dtype=np.bool_)
    if not objects.ids:
        return blocked
    standing = np.abs(objects.speed) < STANDING_SPEED
    least = Margin(*np.minimum(margin, STANDING_MARGIN).tolist())
    blocked[:] = overlaps(_inflated(path, cells, size, least), _boxes(objects, standing, 0.0)).any(axis=1)
    mine = _inflated(path, cells, size, margin)
    lasts_s = np.where(objects.kind == Kind.PEDESTRIAN, ON_FOOT_S, FORESIGHT_S)
    for row, t in enumerate(times.tolist()):
        if (going := ~standing & (t <= lasts_s)).any():
            blocked[row] |= overlaps(mine, _boxes(objects, going, t)).any(axis=1)
    return blocked


def _inflated(path: Path, cells: Int, size: tuple[float, float], margin: Margin) -> Float:
    return footprints(path, size[0] + 2 * margin.along, size[1] + 2 * margin.across, cells)


def _boxes(objects: Objects, chosen: Bool, t: float) -> Float:
    """Corners (N, 4, 2) of the chosen objects' boxes after t seconds."""
    ahead, yaw = objects.speed[chosen] * t, objects.yaw[chosen]
    grown = 2 * WIDENING * t
    return boxes_corners(
        objects.x[chosen] + ahead * np.cos(yaw),
        objects.y[chosen] + ahead * np.sin(yaw),
        yaw,
        objects.length[chosen] + grown,
        objects.width[chosen] + grown,
    )
