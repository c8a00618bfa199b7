"""AnchorPlanner: paces along the route, scored by forecast occupancy, progress and comfort; the best one is driven.

The scores are rules. Nothing in here is learned, and the arithmetic is the same on every host; what a network answers
is not.
"""

import math
from dataclasses import dataclass

import numpy as np

from mdrive_sumo.agents.learned.ego_frame import convert_to_frame
from mdrive_sumo.agents.learned.fusion_spec import FORECAST_S, GRID_REACH_M
from mdrive_sumo.agents.learned.occupancy_grid import OccupancyForecast
from mdrive_sumo.contract import Briefing, Cause, Note, Objects, Observation, OwnState, Plan, Reason, ReasonLog
from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Bool, Float
from mdrive_sumo.core.state import DT
from mdrive_sumo.planning.obstacle_avoidance import ObstacleAvoidance
from mdrive_sumo.planning.reference_path import (
    SPACING_M,
    ReferencePath,
    build_path,
    compute_curve_speeds,
    compute_legal_speeds,
    interpolate_points,
    limit_to_braking,
)
from mdrive_sumo.planning.stop_lines import StopPoint, build_stop_lines


@dataclass(frozen=True, slots=True)
class AnchorParameters:
    """Parameters of `AnchorPlanner`. Design choices, tried with occupancy drawn from the truth (docs/codriving.md)."""

    first_accelerations: tuple[float, ...] = (2.5, 1.2, 0.0, -1.5, -3.0, -5.0, -8.0)
    """[m/s2] Of the first `switch_s` of a pace."""
    second_accelerations: tuple[float, ...] = (1.5, 0.0, -3.0)
    """[m/s2] From then on."""
    switch_s: float = 1.0
    hardest_braking: float = 8.0
    """[m/s2] With which a pace keeps to a limit that it is above: what the cars of the benchmark can do."""
    step_s: float = 0.1
    """Of the integration of a pace."""
    check_s: float = 0.25
    """Between times at which occupancy is looked up."""
    ahead_m: float = 0.6
    """[m] Room before the car, in addition to its box: three quarters of a cell."""
    aside_m: float = 0.3
    """[m] Room at both sides: two cars pass each other in lanes of 3 m with 0.9 m between them."""
    risk: float = 10.0
    """Cost of a sure collision now at 3 m/s or more; 1 is the cost of standing for `horizon_s` instead of driving."""
    far_discount: float = 0.25
    """Share of the risk that lies at the end of the forecast: there is time to decide again."""
    standing_share: float = 0.2
    """Share of the risk while the car stands: others drive around what stands."""
    least_probability: float = 0.05
    """Cells that are less likely occupied cost nothing: in a frame with 10 % of cells occupied a network that knows
    nothing answers 0.1."""
    comfort: float = 0.1
    """Cost of braking with `hardest_braking`; it falls with the square of the acceleration."""
    lateral_acceleration: float = 2.0
    """[m/s2] In bends, as `planning.parameters.DETOUR`."""
    braking: float = 2.5
    """[m/s2] Before bends, lower limits, stop lines and the end of sight."""


ANCHORS = AnchorParameters()
HORIZON_S = FORECAST_S[-1]
"""Paces are scored up to the last time of the forecast."""
PLAN_INTERVAL_S, PLAN_POINTS = 0.2, 20
"""Of a plan: 4 s, as CoDriving's planner (protocol 10.2)."""
NOTICEABLE_SPEED = 0.5
"""[m/s] A pace that is slower than a free one by less is no answer to traffic."""
SIGHT_M = GRID_REACH_M - 5.0
"""[m] Nothing beyond it is forecast: a car's length before the edge of the grid."""


@dataclass(frozen=True, slots=True)
class Paces:
    """Ways to drive along a path: K paces in steps of `AnchorParameters.step_s`, from now on."""

    stations: Float
    """(K, steps + 1) [m]"""
    speeds: Float
    """(K, steps + 1) [m/s]"""
    first: Float
    """(K,) [m/s2] acceleration with which each begins."""


def build_paces(station: float, speed: float, limits: Float, parameters: AnchorParameters = ANCHORS) -> Paces:
    """Return the paces of a car at a station [m] and speed [m/s]; limits: (M,) [m/s] every SPACING_M of the path.

    A pace keeps to the limits, and brakes as hard as it can where it is above one.
    """
    first, then = (
        each.ravel()
        for each in np.meshgrid(parameters.first_accelerations, parameters.second_accelerations, indexing="ij")
    )
    step_s, steps = parameters.step_s, round(PLAN_INTERVAL_S * PLAN_POINTS / parameters.step_s)
    stations, speeds = (np.empty((len(first), steps + 1)) for _ in range(2))
    stations[:, 0], speeds[:, 0] = station, max(speed, 0.0)
    for i in range(steps):
        here, now = stations[:, i], speeds[:, i]
        wanted = np.maximum(now + step_s * np.where(i * step_s < parameters.switch_s, first, then), 0.0)
        limit = limits[np.minimum((here / SPACING_M).astype(np.int64), len(limits) - 1)]
        least = np.maximum(now - step_s * parameters.hardest_braking, 0.0)
        speeds[:, i + 1] = np.minimum(wanted, np.maximum(limit, least))
        stations[:, i + 1] = here + step_s / 2 * (now + speeds[:, i + 1])
    return Paces(stations, speeds, first)


class AnchorPlanner:
    """Drives one car: decides with every new forecast, and follows its pace in between.

    Detours around what stands are those of the rule-based planners (`planning.obstacle_avoidance`), from the objects
    that the car tracks; whether their way is free is decided by the forecast.
    """

    def __init__(self, briefing: Briefing, cap: float = math.inf, controller: str = "v2x-5") -> None:
        """cap: [m/s] no pace is faster. controller: follows the plans (`vehicle.control.CONTROLLERS`)."""
        self._briefing, self._cap, self._controller = briefing, cap, controller
        self._avoidance = ObstacleAvoidance(briefing)
        self._forecast: OccupancyForecast | None = None
        self._path: ReferencePath | None = None
        self._reasons = ReasonLog()
        self.s = 0.0
        """Station [m] of the car on the path."""
        self._decided_tick: int | None = None

    @property
    def path(self) -> ReferencePath:
        """The present path; after the first call of `plan`."""
        assert self._path is not None, "plan has been called"
        return self._path

    def replace_path(self, path: ReferencePath) -> None:
        """Drive along another path."""
        self._path = path
        self._lines = build_stop_lines(path, self._briefing)
        self._limits = self._build_limits(path)

    def take_forecast(self, forecast: OccupancyForecast) -> None:
        """Decide by a new forecast in the next call of `plan`."""
        self._forecast, self._decided_tick = forecast, None

    def list_way_ahead(self, own: OwnState, time_s: float, least_m: float, step_m: float) -> Float:
        """Return points (K, 2) [m] of the path every `step_m`, over the way that the car drives in a time [s].

        least_m: [m] it is no shorter.
        """
        path = self._prepare(own)
        reach_m = max(self._speed_at(self.s) * time_s, least_m)
        return path.get_points(self.s + np.arange(0.0, reach_m + step_m, step_m))

    def _speed_at(self, station: float) -> float:
        return float(self._limits[min(int(station / SPACING_M), len(self._limits) - 1)])

    def _prepare(self, own: OwnState) -> ReferencePath:
        """Return the path, and find the car on it; the first path begins as the car stands."""
        if self._path is None:
            self.replace_path(build_path(self._briefing.route_xy, self._briefing.vehicle.rear_to_centre, own.yaw))
        self.s = self.path.project(own.x, own.y, self.s)
        return self.path

    def plan(self, seen: Observation, objects: Objects) -> tuple[Plan, tuple[Note, ...]]:
        """Return the plan of this tick, and notes of why.

        objects: those that are tracked, at the tick of the observation in the world frame.
        """
        self._prepare(seen.own)
        notes: tuple[Note, ...] = ()
        if self._decided_tick is None:
            notes = self._reasons.record(self._decide(seen, objects))
            self._decided_tick = seen.tick
        elapsed_s = (seen.tick - self._decided_tick) * DT
        after_s = elapsed_s + PLAN_INTERVAL_S * np.arange(1, PLAN_POINTS + 1)
        # The car is where it is, not where the pace wanted it: only the way from now on is the pace's.
        ways = np.interp(after_s, self._times, self._pace) - np.interp(elapsed_s, self._times, self._pace)
        return Plan(self.path.get_points(self.s + ways), PLAN_INTERVAL_S, self._controller), notes

    def _decide(self, seen: Observation, objects: Objects) -> Reason:
        """Choose a pace; return what limits it."""
        speed = max(seen.own.speed, 0.0)
        lines = self._lines.find_stops(self.s, speed, seen.signals)
        _, waits = self._avoidance.update(seen, objects, self, [stop.s for stop in lines])
        stops = [*self._lines.find_stops(self.s, speed, seen.signals), *waits]
        paces = build_paces(self.s, speed, self._limit_to_stops(stops))
        free = build_paces(self.s, speed, self._limits)
        self._times = ANCHORS.step_s * np.arange(paces.stations.shape[1])
        risk = self._find_risk(seen.tick, paces)
        horizon = round(HORIZON_S / ANCHORS.step_s)
        ways = paces.stations[:, horizon] - self.s
        most = float((free.stations[:, horizon] - self.s).max())
        braking = paces.first / ANCHORS.hardest_braking
        costs = ANCHORS.risk * risk - ways / max(most, 1.0) + ANCHORS.comfort * (braking * braking)
        best = int(np.argmin(costs))
        self._pace = paces.stations[best]
        slowest = float(paces.speeds[best, : horizon + 1].min())
        return self._explain(stops, slowest, float(ways[best]), float(ways.max()), most)

    def _find_risk(self, tick: int, paces: Paces) -> Float:
        """Return the risk (K,) of paces in [0, 1]: the largest of all times."""
        if self._forecast is None:
            return np.zeros(len(paces.first))
        check_s = ANCHORS.check_s * np.arange(1, round(HORIZON_S / ANCHORS.check_s) + 1, dtype=np.float64)
        rows = np.rint(check_s / ANCHORS.step_s).astype(np.int64)
        points = self._build_footprints(paces.stations[:, rows])
        found = self._forecast.look_up(points, check_s, tick)
        found = np.where(self._is_own_place(points), 0.0, found).max(axis=-1)
        certain = np.maximum(found - ANCHORS.least_probability, 0.0) / (1.0 - ANCHORS.least_probability)
        near = 1.0 - (1.0 - ANCHORS.far_discount) * check_s / HORIZON_S
        moving = np.minimum(paces.speeds[:, rows] / 3.0, 1.0)
        return (certain * near * (ANCHORS.standing_share + (1.0 - ANCHORS.standing_share) * moving)).max(axis=1)

    def _build_footprints(self, stations: Float) -> Float:
        """Return points (K, T, P, 2) [m] of the car's box with room around it, at stations (K, T) [m]."""
        vehicle = self._briefing.vehicle
        centres = interpolate_points(self.path.xy, stations.ravel()).reshape(*stations.shape, 1, 2)
        cell = np.minimum((stations / SPACING_M).astype(np.int64), len(self.path.xy) - 1)
        cos, sin = portable.cos_sin(self.path.body_yaw[cell])
        along = np.linspace(-vehicle.length / 2, vehicle.length / 2 + ANCHORS.ahead_m, 8)
        aside = (vehicle.width / 2 + ANCHORS.aside_m) * np.array((-1.0, 0.0, 1.0))
        ahead, left = (each.ravel() for each in np.meshgrid(along, aside, indexing="ij"))
        cos, sin = cos[..., None], sin[..., None]
        return centres + np.stack((cos * ahead - sin * left, sin * ahead + cos * left), axis=-1)

    def _is_own_place(self, points: Float) -> Bool:
        """Return which points (..., 2) lie in the car's box at the scan: others see it there, and it does not collide
        with itself."""
        assert self._forecast is not None
        ego = convert_to_frame(points, self._forecast.pose)
        vehicle = self._briefing.vehicle
        inside = np.abs(ego[..., 0]) <= vehicle.length / 2 + 0.4  # half a cell
        return inside & (np.abs(ego[..., 1]) <= vehicle.width / 2 + 0.4)

    def _build_limits(self, path: ReferencePath) -> Float:
        """Return the speed (M,) [m/s] that bends, the road, the scenario and the cap allow along a path."""
        desired = self._briefing.desired_speed
        sight = math.sqrt(2 * ANCHORS.braking * SIGHT_M)
        cruise = min(self._cap, math.inf if desired is None else desired, self._briefing.vehicle.max_speed, sight)
        legal = compute_legal_speeds(path, self._briefing)
        return compute_curve_speeds(path, cruise, ANCHORS.lateral_acceleration, ANCHORS.braking, legal)

    def _limit_to_stops(self, stops: list[StopPoint]) -> Float:
        if not stops:
            return self._limits
        limits = self._limits.copy()
        first = max(math.ceil(max(min(stop.s for stop in stops), 0.0) / SPACING_M), 0)
        limits[first:] = 0.0
        return limit_to_braking(limits, ANCHORS.braking)

    def _explain(self, stops: list[StopPoint], slowest: float, way_m: float, open_m: float, most_m: float) -> Reason:
        """Return the reason of a pace: a stop, the forecast, or nothing.

        slowest: [m/s] of the pace. way_m, open_m, most_m: how far [m] it drives in HORIZON_S, how far it would with
        stops alone, and on a free road.
        """
        speed = way_m / HORIZON_S
        if way_m < open_m - NOTICEABLE_SPEED * HORIZON_S:
            return Reason(Cause.NETWORK_STANDS if slowest < NOTICEABLE_SPEED else Cause.NETWORK_BRAKES, speed=speed)
        if stops and open_m < most_m - NOTICEABLE_SPEED * HORIZON_S:
            return min(stops, key=lambda stop: stop.s).reason
        return Reason(Cause.FREE, speed=speed)
