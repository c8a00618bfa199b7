"""The paths of all CAVs, and the cells of one path that others block: privileged knowledge of `omniscient`."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from mdrive_sumo.contract import Objects, OwnState, Plan
from mdrive_sumo.core import portable
from mdrive_sumo.core.compiled import twin
from mdrive_sumo.core.geometry import Bool, Float, Int, boxes_corners
from mdrive_sumo.core.state import Kind
from mdrive_sumo.planning.parameters import JOINT_PLANNING, MARGINS, JointPlanningParameters, SafetyMargin
from mdrive_sumo.planning.path_overlap import (
    compute_footprints,
    compute_overlaps,
    compute_path_overlaps,
)
from mdrive_sumo.planning.reference_path import SPACING_M, ReferencePath

COARSE = 8
"""Points of a path, 2 m, between two with which positions are compared first."""


@dataclass
class FleetPaths:
    """The reference path of every CAV by its id, and the cells in which any two overlap. All CAVs have one size [m]."""

    path_by_ego: Mapping[str, ReferencePath]
    size: tuple[float, float]
    parameters: JointPlanningParameters = JOINT_PLANNING
    stride: int = 1
    """Overlaps are known at every `stride`-th point of the paths: long routes have many."""
    margin: SafetyMargin = MARGINS.plan
    """Of planning."""
    _overlaps: dict[tuple[str, str, SafetyMargin], Bool] = field(
        default_factory=dict[tuple[str, str, SafetyMargin], Bool]
    )

    def get_overlap(self, ego: str, other: str, margin: SafetyMargin | None = None) -> Bool:
        """Return the mask of `compute_path_overlaps` for every `stride`-th point; computed at the first call."""
        table = self._get_table(ego, other, self.margin if margin is None else margin)
        return table.T if ego > other else table

    def _get_table(self, ego: str, other: str, margin: SafetyMargin) -> Bool:
        """Return the overlaps of two CAVs, rows for the one whose id is smaller."""
        key = (min(ego, other), max(ego, other), margin)
        if key not in self._overlaps:
            paths = self.path_by_ego[key[0]], self.path_by_ego[key[1]]
            self._overlaps[key] = compute_path_overlaps(*paths, self.size, margin, self.stride)
        return self._overlaps[key]

    def find_blocked_cells(
        self, ego: str, cells: Int, other: str, stations: Float, margin: SafetyMargin | None = None
    ) -> Bool:
        """Return a mask (T, J): which cells (J,) of ego the other CAV blocks at arc lengths `stations` (T,) [m].

        Beyond its goal the other CAV blocks nothing.
        """
        path = self.path_by_ego[other]
        table = self._get_table(ego, other, self.margin if margin is None else margin)
        end_s = path.goal_s + self.parameters.left_world_m
        return look_up_overlaps(table, ego > other, cells, stations, self.stride, len(path.xy), end_s)

    def find_blocking_starts(self, ego: str) -> frozenset[str]:
        """Return the CAVs whose start obstructs the path of ego: it cannot arrive before they have left."""
        length, width = self.size
        mine = compute_footprints(self.path_by_ego[ego], length, width + 2 * self.margin.lateral)
        others = [other for other in self.path_by_ego if other != ego]
        starts = [compute_footprints(self.path_by_ego[other], length, width)[0] for other in others]
        blocking = compute_overlaps(mine, np.array(starts).reshape(-1, 4, 2)).any(0)
        return frozenset(np.array(others)[blocking].tolist())


def predict_stations(path: ReferencePath, state: OwnState, plan: Plan | None, times: Float, age_s: float) -> Float:
    """Return the arc lengths (T,) [m] of a CAV on its path at `times` [s] from now, by its plan made `age_s` ago.

    Beyond the end of its plan, and without one, it continues at its last speed.
    """
    if plan is None:
        station = path.project(state.x, state.y, 0.0, within_m=path.length)
        return station + max(state.speed, 0.0) * times
    return _extend_stations(locate_points(path.xy, plan.points, 1), plan, times, age_s)


def predict_stations_at(
    path: ReferencePath, state: OwnState, plan: Plan | None, times: Sequence[Float], age_s: float
) -> list[Float]:
    """Return `predict_stations` for several arrays of times, for long paths.

    Points of the plan are located on every `COARSE`-th point of the path first, and only as far as the times reach.
    """
    if plan is None:
        return [predict_stations(path, state, plan, each, age_s) for each in times]
    until_s = max(float(each.max(initial=0.0)) for each in times) + age_s
    points = plan.points[: int(until_s / plan.interval_s) + 2]
    stations = locate_points(path.xy, points, COARSE)
    return [_extend_stations(stations, plan, each, age_s) for each in times]


def _extend_stations(stations: Float, plan: Plan, times: Float, age_s: float) -> Float:
    """Return the arc lengths (T,) [m] at `times` [s] from now; stations: (P,) [m] of a plan made `age_s` ago."""
    due = (np.arange(len(stations)) + 1) * plan.interval_s - age_s
    speed = (stations[-1] - stations[-2]) / plan.interval_s if len(stations) > 1 else 0.0
    return np.interp(times, due, stations) + speed * np.maximum(times - due[-1], 0.0)


@twin
def locate_points(xy: Float, points: Float, coarse: int, /) -> Float:
    """Return the stations (P,) [m] of points (P, 2) on a path xy (M, 2), none before that of the point before.

    coarse: points are located on every `coarse`-th point of the path first.
    """
    nearest = portable.square(points[:, None] - xy[::coarse]).sum(-1).argmin(axis=1) * coarse
    if coarse > 1:
        window = np.clip(nearest[:, None] + np.arange(-coarse, coarse + 1), 0, len(xy) - 1)
        gaps = portable.square(points[:, None] - xy[window]).sum(-1)
        nearest = window[np.arange(len(points)), gaps.argmin(axis=1)]
    return np.maximum.accumulate(nearest * SPACING_M)


@twin
def look_up_overlaps(
    table: Bool, is_transposed: bool, cells: Int, stations: Float, stride: int, other_points: int, end_s: float, /
) -> Bool:
    """Return a mask (T, J): whether a box in cell j overlaps that of another car at station t [m], at most `end_s`.

    table: (A, B) overlaps at every `stride`-th point of both paths, the own one second if it is transposed;
    other_points: of the other path.
    """
    table = table.T if is_transposed else table
    columns = np.clip(np.rint(stations / SPACING_M).astype(np.int64), 0, other_points - 1)
    rows = np.minimum((cells + stride // 2) // stride, len(table) - 1)
    columns = np.minimum((columns + stride // 2) // stride, table.shape[1] - 1)
    return table[rows][:, columns].T & (stations < end_s)[:, None]


@twin
def find_cells_blocked_by_objects(
    path: ReferencePath, cells: Int, objects: Objects, times: Float, size: tuple[float, float], margin: SafetyMargin, /
) -> Bool:
    """Return a mask (T, J): which cells (J,) of a car of that size [m] other road users block at `times` (T,) [s].

    Moving ones are predicted straight on at their speed for `vehicle_prediction_s` (`pedestrian_prediction_s`) and are
    ignored after that; standing ones stay.
    """
    parameters = JOINT_PLANNING
    blocked = np.zeros((len(times), len(cells)), dtype=np.bool_)
    if not objects.ids:
        return blocked
    standing = np.abs(objects.speed) < parameters.standing_speed
    standing_margin = SafetyMargin(
        min(margin.longitudinal, MARGINS.standing.longitudinal), min(margin.lateral, MARGINS.standing.lateral)
    )
    standing_boxes = _predict_boxes(objects, standing, 0.0, parameters)
    blocked[:] = compute_overlaps(_inflate_footprints(path, cells, size, standing_margin), standing_boxes).any(axis=1)
    mine = _inflate_footprints(path, cells, size, margin)
    pedestrians = objects.kind == Kind.PEDESTRIAN
    horizon_s = np.where(pedestrians, parameters.pedestrian_prediction_s, parameters.vehicle_prediction_s)
    for row, t in enumerate(times.tolist()):
        if (moving := ~standing & (t <= horizon_s)).any():
            blocked[row] |= compute_overlaps(mine, _predict_boxes(objects, moving, t, parameters)).any(axis=1)
    return blocked


def _inflate_footprints(path: ReferencePath, cells: Int, size: tuple[float, float], margin: SafetyMargin) -> Float:
    """Return the corners (J, 4, 2) [m] of a car of that size with the whole margin around it."""
    return compute_footprints(path, size[0] + 2 * margin.longitudinal, size[1] + 2 * margin.lateral, cells)


def _predict_boxes(objects: Objects, rows: Bool, t: float, parameters: JointPlanningParameters) -> Float:
    """Return the corners (N, 4, 2) [m] of the chosen objects' boxes after t seconds, enlarged by their uncertainty."""
    ahead, yaw = objects.speed[rows] * t, objects.yaw[rows]
    cos, sin = portable.cos_sin(yaw)
    growth = 2 * parameters.growth * t
    return boxes_corners(
        objects.x[rows] + ahead * cos,
        objects.y[rows] + ahead * sin,
        yaw,
        objects.length[rows] + growth,
        objects.width[rows] + growth,
    )
