"""What `omniscient` must keep clear of where limits of roads count: traffic, other CAVs and red lights."""

import math
from collections.abc import Collection
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from mdrive_sumo.contract import Briefing, Objects, Observation, Privileged
from mdrive_sumo.core.geometry import Bool, Float, Int
from mdrive_sumo.core.state import Kind
from mdrive_sumo.planning.evasive_profile import build_evasion_problem, find_evasive_profile, find_latest_contact
from mdrive_sumo.planning.fleet_paths import FleetPaths, predict_stations_at
from mdrive_sumo.planning.moving_traffic import TRAFFIC
from mdrive_sumo.planning.parameters import MARGINS, SafetyMargin
from mdrive_sumo.planning.reference_path import SPACING_M, PathState, ReferencePath
from mdrive_sumo.planning.road_direction import RoadDirection
from mdrive_sumo.planning.speed_profile import SpeedProfile
from mdrive_sumo.planning.stop_lines import StopLines
from mdrive_sumo.planning.traffic_prediction import AccelerationEstimator, TrafficView


@dataclass(frozen=True, slots=True)
class RoadSituation:
    """The own car, and what it knows in one tick."""

    known: Privileged
    """What the privileged sensor tells of all road users."""
    s: float
    """[m] Station on the own path."""
    speed: float
    """[m/s]"""
    red_s: float
    """[m] Station that must not be passed because of a light; infinity for none."""
    respected: Collection[str]
    """CAVs whose plans come first."""


@dataclass
class RoadConflicts:
    """Finds what blocks the own path. Remembers speeds of others, so it must see every observation."""

    briefing: Briefing
    road: RoadDirection
    top_speed: float
    """[m/s] The highest limit of all CAVs: others are taken to accelerate up to it."""
    trends: AccelerationEstimator = field(default_factory=AccelerationEstimator)

    def find_blocked(
        self, now: RoadSituation, fleet: FleetPaths, cells: Int, times: Float, margin: SafetyMargin
    ) -> Bool:
        """Return a mask (T, J): which cells (J,) of the own path are blocked at `times` (T,) [s] from now.

        A time gap is kept behind CAVs in the own lane too: they may brake. Those behind in it are never respected.
        """
        view = self._build_view(now, fleet.path_by_ego[self.briefing.ego_id])
        blocked = view.find_blocked_cells(cells, now.known.objects, times, margin)
        blocked[:, cells * SPACING_M > now.red_s] = True
        return blocked | self._find_blocked_by_cavs(now, view, fleet, cells, times, margin)

    def find_met(
        self, now: RoadSituation, fleet: FleetPaths, stations: Float, times: Float, margin: SafetyMargin
    ) -> Bool:
        """Return a mask (T,): whether the own car meets something if it is at station t [m] at time t [s]."""
        view = self._build_view(now, fleet.path_by_ego[self.briefing.ego_id])
        cells = np.clip(np.round(stations / SPACING_M).astype(np.int64), 0, len(view.path.xy) - 1)
        met = view.find_met(cells, now.known.objects, times, margin) | (stations > now.red_s)
        return met | np.diagonal(self._find_blocked_by_cavs(now, view, fleet, cells, times, margin))

    def find_way_out(
        self, now: RoadSituation, fleet: FleetPaths, speeds: Float, present: SpeedProfile | None, age_s: float
    ) -> SpeedProfile:
        """Return a profile for a car that has no other, see `evasive_profile`.

        speeds: (M,) [m/s] highest at the points of the own path; age_s: [s] of the present profile.
        """
        start, path = PathState(now.s, now.speed), fleet.path_by_ego[self.briefing.ego_id]
        problem = build_evasion_problem(path, speeds, start, self.top_speed)
        profile = find_evasive_profile(problem, partial(self.find_blocked, now, fleet, problem.cells, problem.times))
        if profile is not None:
            return profile
        find_met = partial(self.find_met, now, fleet, margin=MARGINS.contact)
        return find_latest_contact(speeds, start, find_met, None if present is None else (present, age_s))

    def _build_view(self, now: RoadSituation, path: ReferencePath) -> TrafficView:
        vehicle = self.briefing.vehicle
        size, cavs = (vehicle.length, vehicle.width), self._list_other_cavs(now.known)
        return TrafficView(path, self.road, now.s, size, now.speed, self.top_speed, self.trends, cavs)

    def _list_other_cavs(self, known: Privileged) -> Objects:
        """Return all CAVs but the own one."""
        vehicle = self.briefing.vehicle
        names = [name for name in known.ego_ids if name != self.briefing.ego_id]
        own_id = self.briefing.ego_id
        states = [state for name, state in zip(known.ego_ids, known.states, strict=True) if name != own_id]
        rows = [(state.x, state.y, state.yaw, state.speed, vehicle.length, vehicle.width) for state in states]
        columns = np.array(rows, dtype=np.float64).reshape(-1, 6).T
        return Objects(tuple(names), np.full(len(names), Kind.VEHICLE, dtype=np.uint8), *columns)

    def _find_blocked_by_cavs(
        self, now: RoadSituation, view: TrafficView, fleet: FleetPaths, cells: Int, times: Float, margin: SafetyMargin
    ) -> Bool:
        """Return the mask of `find_blocked` for the other CAVs."""
        own, known, plans_gap = self.briefing.ego_id, now.known, margin.longitudinal >= MARGINS.plan.longitudinal
        blocked = np.zeros((len(times), len(cells)), dtype=np.bool_)
        for other, state, plan in zip(known.ego_ids, known.states, known.plans, strict=True):
            if other == own or other not in now.respected or (lead := view.find_lead(state)) < 0:
                continue
            half_s = float(times[1] - times[0]) / 2 if len(times) > 1 else 0.0
            after_s = TRAFFIC.cav_gaps_s if plans_gap and lead > 0 else (0.0,) if lead else (-half_s, 0.0, half_s)
            since = [np.maximum(times - gap_s, 0.0) for gap_s in after_s]  # crossing CAVs: between the samples too
            path = fleet.path_by_ego[other]
            for stations in predict_stations_at(path, state, plan, since, self.briefing.tick_s):
                blocked |= fleet.find_blocked_cells(own, cells, other, stations, margin)
        return blocked


def find_red_light(lights: StopLines, s: float, seen: Observation) -> float:
    """Return the station [m] that the box centre must not pass now because of a light; infinity if there is none."""
    return min((stop.s for stop in lights.find_stops(s, seen.own.speed, seen.signals)), default=math.inf)
