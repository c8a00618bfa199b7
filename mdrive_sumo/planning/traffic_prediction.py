"""Privileged prediction of other road users on roads whose limits count: traffic keeps its lane and its speed.

At these speeds a straight line leaves the road within the prediction, and a car that follows closely could not brake
in time for one ahead.
"""

from dataclasses import dataclass

import numpy as np

from mdrive_sumo.contract import Objects, OwnState
from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Bool, Float, Int, boxes_corners
from mdrive_sumo.core.state import Kind
from mdrive_sumo.planning.parameters import JOINT_PLANNING, MARGINS, SafetyMargin
from mdrive_sumo.planning.path_overlap import compute_footprints, compute_overlaps
from mdrive_sumo.planning.reference_path import ReferencePath
from mdrive_sumo.planning.road_direction import SHARP_TURN_RAD, RoadDirection, RoadPosition, find_lane_keeping


@dataclass(frozen=True, slots=True)
class TrafficParameters:
    """Parameters of the prediction. Design choices (decision 053)."""

    horizon_s: float = 10.0
    """Vehicles in lanes of the own direction are predicted for this long."""
    oncoming_horizon_s: float = 4.0
    """Oncoming vehicles are predicted for this long: many turn or brake before they arrive (measured on a left turn
    through dense traffic: 10 s costs 27 s of waiting, 4 s none, without contact)."""
    max_turn_rad: float = 0.12
    """A vehicle that turns away from the direction of the road by less keeps its lane: states are exact here, and a
    lane change ends."""
    headway_s: float = 0.9
    """Time gap kept behind a vehicle in the own lane: the plan is reviewed twice a second."""
    cav_gaps_s: tuple[float, ...] = (0.0, 0.35, 0.7)
    """Time gaps at which a place behind a CAV in the own lane is blocked: its plan is known, but it may change."""
    own_lane_m: float = 1.6
    """A vehicle with a smaller lateral offset is in the own lane."""
    stride: int = 2
    """Every second sample in time is computed."""


TRAFFIC = TrafficParameters()


@dataclass(frozen=True)
class TrafficView:
    """The own path and its road, the own station [m] and the own size (length, width) [m]."""

    path: ReferencePath
    road: RoadDirection
    s: float
    size: tuple[float, float]

    def find_blocked_cells(self, cells: Int, objects: Objects, times: Float, margin: SafetyMargin) -> Bool:
        """Return a mask (T, J): which cells (J,) others block at `times` (T,) [s].

        Vehicles that follow the road keep lane and speed, others and pedestrians go straight on for the times of
        `JointPlanningParameters`; standing ones stay. Behind a vehicle in the own lane a time gap is blocked too,
        unless `margin` is smaller than that of planning. Followers in the own lane block nothing: they keep a distance.
        """
        blocked = np.zeros((len(times), len(cells)), dtype=np.bool_)
        standing = np.abs(objects.speed) < JOINT_PLANNING.standing_speed
        near = SafetyMargin(
            min(margin.longitudinal, MARGINS.standing.longitudinal), min(margin.lateral, MARGINS.standing.lateral)
        )
        still = objects.take(standing)
        boxes = boxes_corners(still.x, still.y, still.yaw, still.length, still.width)
        blocked[:] = compute_overlaps(self._inflate_footprints(cells, near), boxes).any(axis=1)
        traffic = self._build_traffic(objects.take(~standing), margin.longitudinal >= MARGINS.plan.longitudinal)
        mine = self._inflate_footprints(cells, margin)
        for row in range(0, len(times), TRAFFIC.stride):
            boxes = traffic.predict_boxes(float(times[row]))
            if len(boxes):
                blocked[row : row + TRAFFIC.stride] |= compute_overlaps(mine, boxes).any(axis=1)
        return blocked

    def find_lead(self, state: OwnState) -> int:
        """Return 1 for a CAV ahead in the own lane, -1 for one behind in it, 0 for all others."""
        one = np.array((0.0,))
        at = Objects(("",), np.zeros(1, np.uint8), one + state.x, one + state.y, one + state.yaw, one, one, one)
        position = self.road.locate(self.path, at)
        in_lane = abs(float(position.lateral[0])) < TRAFFIC.own_lane_m
        if not in_lane or abs(float(position.turned[0])) > SHARP_TURN_RAD:
            return 0
        return 1 if float(position.station[0]) > self.s else -1

    def _inflate_footprints(self, cells: Int, margin: SafetyMargin) -> Float:
        """Return the corners (J, 4, 2) [m] of the own car with the whole margin around it."""
        length, width = self.size
        return compute_footprints(self.path, length + 2 * margin.longitudinal, width + 2 * margin.lateral, cells)

    def _build_traffic(self, objects: Objects, keeps_gap: bool) -> "_MovingTraffic":
        """Return the moving road users that matter."""
        position = self.road.locate(self.path, objects)
        keeps_lane = find_lane_keeping(objects, position, TRAFFIC.max_turn_rad)
        forward = np.where(np.abs(position.turned) < np.pi / 2, 1.0, -1.0)
        in_lane = keeps_lane & (forward > 0) & (np.abs(position.lateral) < TRAFFIC.own_lane_m)
        gap = np.where(in_lane & keeps_gap, TRAFFIC.headway_s * objects.speed, 0.0)
        kept = ~(in_lane & (position.station < self.s))
        taken = RoadPosition(*(column[kept] for column in position))
        return _MovingTraffic(self.road, objects.take(kept), taken, keeps_lane[kept], forward[kept], gap[kept])


@dataclass(frozen=True)
class _MovingTraffic:
    """Moving road users near a road; all arrays are (N,)."""

    road: RoadDirection
    objects: Objects
    position: RoadPosition
    keeps_lane: Bool
    forward: Float
    """1: in the direction of the road, -1: against it."""
    gap: Float
    """[m] Distance to keep behind."""

    @property
    def _horizon_s(self) -> Float:
        """(N,) time [s] for which each is predicted."""
        walking_s, straight_s = JOINT_PLANNING.pedestrian_prediction_s, JOINT_PLANNING.vehicle_prediction_s
        horizon_s = np.where(self.objects.kind == Kind.PEDESTRIAN, walking_s, straight_s)
        in_lanes_s = np.where(self.forward > 0, TRAFFIC.horizon_s, TRAFFIC.oncoming_horizon_s)
        return np.where(self.keeps_lane, in_lanes_s, horizon_s)

    def predict_boxes(self, t: float) -> Float:
        """Return the corners (K, 4, 2) [m] of the road users whose prediction reaches t [s]."""
        rows = np.flatnonzero(self._horizon_s >= t)
        objects, growth, gap = self.objects.take(rows), 2 * JOINT_PLANNING.growth * t, self.gap[rows]
        travelled = objects.speed * t
        cos, sin = portable.cos_sin(objects.yaw)
        x, y, yaw = objects.x + travelled * cos, objects.y + travelled * sin, objects.yaw
        keeps, here = self.keeps_lane[rows], self.position.station[rows]
        there = here + self.forward[rows] * travelled
        way = self.road.get_points(there) - self.road.get_points(here)
        before, after = self.road.get_yaw(here), self.road.get_yaw(there)
        (cos, sin), (next_cos, next_sin) = portable.cos_sin(before), portable.cos_sin(after)
        follows_turn = np.abs(after - before) < SHARP_TURN_RAD
        keeps &= follows_turn
        lateral = self.position.lateral[rows]
        x = np.where(keeps, objects.x + way[:, 0] - lateral * (next_sin - sin), x)
        y = np.where(keeps, objects.y + way[:, 1] + lateral * (next_cos - cos), y)
        yaw = np.where(keeps, yaw + after - before, yaw)
        cos, sin = portable.cos_sin(yaw)
        x, y = x - gap / 2 * cos, y - gap / 2 * sin
        boxes = boxes_corners(x, y, yaw, objects.length + gap + growth, objects.width + growth)
        return boxes[follows_turn | (t <= JOINT_PLANNING.vehicle_prediction_s) | (objects.kind == Kind.PEDESTRIAN)]
