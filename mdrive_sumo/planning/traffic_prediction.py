"""Privileged prediction of other road users on roads whose limits count: traffic keeps its lane and its speed.

At these speeds a straight line leaves the road within the prediction, and a car that follows closely could not brake
in time for one ahead. Between two samples a fast vehicle drives further than its own length, so samples are swept.
"""

from dataclasses import dataclass, field

import numpy as np

from mdrive_sumo.contract import Objects, OwnState
from mdrive_sumo.core.geometry import Bool, Float, Int, boxes_corners, boxes_overlap
from mdrive_sumo.core.state import Kind
from mdrive_sumo.planning.moving_traffic import TRAFFIC, MovingTraffic
from mdrive_sumo.planning.parameters import JOINT_PLANNING, MARGINS, SafetyMargin
from mdrive_sumo.planning.path_overlap import compute_footprints, compute_overlaps, find_overlapping_pairs
from mdrive_sumo.planning.reference_path import SPACING_M, ReferencePath
from mdrive_sumo.planning.road_direction import SHARP_TURN_RAD, RoadDirection

WINDOW_S = 0.3
"""[s] Speeds so far apart are compared: SUMO's drivers dawdle by some 0.1 m/s from one step to the next."""


@dataclass(frozen=True, slots=True)
class _Sample:
    time_s: float
    speed_by_id: dict[str, float]


class AccelerationEstimator:
    """Estimates the accelerations of observed road users. Observations contain none."""

    def __init__(self, window_s: float = WINDOW_S) -> None:
        self._window_s = window_s
        self._samples: list[_Sample] = []

    def update(self, objects: Objects, time_s: float) -> None:
        """Store the speeds at a time [s] that is later than the last one."""
        speeds = dict(zip(objects.ids, objects.speed.tolist(), strict=True))
        self._samples.append(_Sample(time_s, speeds))
        while len(self._samples) > 2 and time_s - self._samples[1].time_s >= self._window_s - 1e-6:
            self._samples.pop(0)

    def estimate(self, objects: Objects) -> Float:
        """Return the accelerations (N,) [m/s2] over the last `window_s`; 0 for those that were not observed before."""
        if not self._samples:
            return np.zeros(len(objects.ids))
        first, last = self._samples[0], self._samples[-1]
        elapsed_s = max(last.time_s - first.time_s, 1e-6)
        before = np.array([first.speed_by_id.get(name, np.nan) for name in objects.ids], dtype=np.float64)
        after = np.array([last.speed_by_id.get(name, np.nan) for name in objects.ids], dtype=np.float64)
        return np.nan_to_num((after - before) / elapsed_s)


@dataclass(frozen=True)
class TrafficView:
    """The own path and its road, where the own car is on it, and what is known of others."""

    path: ReferencePath
    road: RoadDirection
    s: float
    """[m] Own station."""
    size: tuple[float, float]
    """[m] Own length and width."""
    speed: float = 0.0
    """[m/s] Own speed."""
    top_speed: float = 0.0
    """[m/s] Vehicles accelerate up to it."""
    trends: AccelerationEstimator = field(default_factory=AccelerationEstimator)
    cavs: Objects = field(default_factory=Objects.empty)
    """All other CAVs: background vehicles brake behind them."""

    def find_blocked_cells(self, cells: Int, objects: Objects, times: Float, margin: SafetyMargin) -> Bool:
        """Return a mask (T, J): which cells (J,) others block at equidistant `times` (T,) [s].

        Vehicles that follow the road keep their lane and, as all others, their speed or its trend, and brake behind
        vehicles ahead of them; see `MovingTraffic` for how long. Standing ones stay. Behind a vehicle in the own lane
        a time gap is blocked too, unless `margin` is smaller than that of planning. Followers in the own lane block
        nothing: they keep a distance.
        """
        standing = _find_standing(objects)
        still = compute_overlaps(
            self._inflate_footprints(cells, _limit_to_standing(margin)), _corners(objects, standing)
        )
        blocked = np.zeros((len(times), len(cells)), dtype=np.bool_)
        blocked[:] = still.any(axis=1)
        keeps_gap = margin.longitudinal >= MARGINS.plan.longitudinal
        boxes, reached = self._predict(objects, standing, times, keeps_gap)
        step, row = np.nonzero(reached)
        mine = self._inflate_footprints(cells, margin)
        cell, box = find_overlapping_pairs(mine, boxes[step, row])
        blocked[step[box], cell] = True
        return blocked

    def find_met(self, cells: Int, objects: Objects, times: Float, margin: SafetyMargin) -> Bool:
        """Return a mask (T,): whether the own car meets another road user if it is in cell t at time t.

        It counts what lies between two samples: both boxes are as long as what they drive in a step.
        """
        standing = _find_standing(objects)
        driven = np.empty(len(cells))
        driven[:] = np.gradient(cells * SPACING_M) if len(cells) > 1 else 0.0
        near = _limit_to_standing(margin)
        still = boxes_overlap(self._inflate_footprints(cells, near, driven)[:, None], _corners(objects, standing))
        boxes, reached = self._predict(objects, standing, times, keeps_gap=False, is_review=True)
        moving = boxes_overlap(self._inflate_footprints(cells, margin, driven)[:, None], boxes) & reached
        return np.asarray(still.any(axis=1) | moving.any(axis=1))

    def find_lead(self, state: OwnState) -> int:
        """Return 1 for a CAV ahead in the own lane, -1 for one behind in it, 0 for all others."""
        zero = np.zeros(1)
        x, y, yaw = zero + state.x, zero + state.y, zero + state.yaw
        cav = Objects(("",), np.zeros(1, np.uint8), x, y, yaw, zero, zero, zero)
        position = self.road.locate(self.path, cav)
        in_lane = abs(float(position.lateral[0])) < TRAFFIC.own_lane_m
        if not in_lane or abs(float(position.turned[0])) > SHARP_TURN_RAD:
            return 0
        return 1 if float(position.station[0]) > self.s else -1

    def _inflate_footprints(self, cells: Int, margin: SafetyMargin, longer: Float | float = 0.0) -> Float:
        """Return the corners (J, 4, 2) [m] of the own car with the whole margin around it; longer: [m]."""
        length, width = self.size
        return compute_footprints(
            self.path, length + 2 * margin.longitudinal + longer, width + 2 * margin.lateral, cells
        )

    def _predict(
        self, objects: Objects, standing: Bool, times: Float, keeps_gap: bool, is_review: bool = False
    ) -> tuple[Float, Bool]:
        """Return `MovingTraffic.predict_boxes` of all moving road users but the followers in the own lane."""
        others = objects.take(standing & (objects.kind == Kind.VEHICLE)).concat(self.cavs)
        moving = objects.take(~standing)
        traffic = MovingTraffic(
            road=self.road,
            objects=moving,
            position=self.road.locate(self.path, moving),
            acceleration=self.trends.estimate(moving),
            others=others,
            others_position=self.road.locate(self.path, others),
            own_speed=self.speed,
            top_speed=self.top_speed,
            headway_s=TRAFFIC.headway_s if keeps_gap else 0.0,
            is_review=is_review,
        )
        step_s = float(times[1] - times[0]) if len(times) > 1 else 0.0
        within = times <= float(traffic.horizons_s.max(initial=0.0))
        boxes, reached = traffic.predict_boxes(times[within], step_s)
        follows = traffic.in_own_lane & (traffic.position.station < self.s)
        count = len(times) - len(boxes)
        boxes = np.concatenate((boxes, np.zeros((count, *boxes.shape[1:]))))
        return boxes, np.concatenate((reached & ~follows, np.zeros((count, len(follows)), dtype=np.bool_)))


def _find_standing(objects: Objects) -> Bool:
    """Return a mask (N,) of the road users that stand."""
    return np.abs(objects.speed) < JOINT_PLANNING.standing_speed


def _limit_to_standing(margin: SafetyMargin) -> SafetyMargin:
    """Return the margin to standing road users."""
    most = MARGINS.standing
    return SafetyMargin(min(margin.longitudinal, most.longitudinal), min(margin.lateral, most.lateral))


def _corners(objects: Objects, rows: Bool) -> Float:
    """Return the corners (K, 4, 2) [m] of the chosen objects."""
    taken = objects.take(rows)
    return boxes_corners(taken.x, taken.y, taken.yaw, taken.length, taken.width)
