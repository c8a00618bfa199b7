"""`omniscient`: the upper bound."""

from dataclasses import replace
from functools import partial

import numpy as np

from mdrive_sumo.contract import MAX_PLAN_POINTS, Briefing, Observation, Plan, Privileged, Reply, SensorSpec
from mdrive_sumo.contract.agent_options import Config, Option, read_options
from mdrive_sumo.core.geometry import Bool, Float, Int
from mdrive_sumo.planning.fleet_paths import FleetPaths, find_cells_blocked_by_objects, predict_stations
from mdrive_sumo.planning.joint_detours import has_undecided_vehicle, plan_joint_detours
from mdrive_sumo.planning.path_overlap import CHECK_MARGIN, SafetyMargin, find_cells
from mdrive_sumo.planning.pedestrian_caution import limit_speeds_near_pedestrians, predict_walking_on
from mdrive_sumo.planning.planning_order import find_planning_order
from mdrive_sumo.planning.reference_path import ReferencePath, compute_curve_speeds, convert_route_station
from mdrive_sumo.planning.speed_profile import (
    SpeedProfile,
    build_braking_profile,
    build_free_road_problem,
    find_fastest_profile,
)

OPTIONS = {"speed": Option(9.0, 2.0, 10.0)}
LATERAL = 3.0
BRAKING = 2.0
SPARE_S = 1.0
"""Profiles end so long before the time limit."""
INTERVAL_S = 0.25
SHOWN_M = 6.0
"""How far beyond the goal a published plan goes."""
REVIEW_TICKS = 10
"""Every CAV looks at its plan that often, each in a tick of its own, so that no two change their minds at once."""
REVIEW_S = 8.0
ASTRAY_M = 0.8
"""A car that is so far from where its plan has it makes a new one."""
STOP_BEFORE_M = (2.5, 1.0)
"""Where to stop at a stop sign: box centre at most and at least that far before the line."""
STOP_LAYERS = 3
"""How long to stand there, in steps of a profile."""
DECIDED_TICKS = 10
"""A vehicle in the way that has not left by then is parked."""


class OmniscientAgent:
    """Knows every state and every plan, and times its way through the gaps: the upper bound.

    Prioritised planning: all CAVs find the same ways around what stands in the way and the same order at the first tick
    (or, where it may be about to leave, `DECIDED_TICKS` later); number r plans r ticks later around the plans that it
    sees then, keeps its plan, and makes a new one only when that has become unsafe or the car has strayed from it.
    """

    label = "privileged"

    def __init__(self, config: Config) -> None:
        self._cruise = read_options("omniscient", config, OPTIONS)["speed"]

    def sensors(self) -> tuple[SensorSpec, ...]:
        """Everything."""
        return (SensorSpec("privileged"),)

    def start(self, briefing: Briefing) -> None:
        """Everything else needs the first observation."""
        self._me = briefing
        self._profile: SpeedProfile | None = None
        self._made_tick = 0
        self._s = 0.0

    def act(self, seen: Observation) -> Reply:
        """The plan, made or reviewed when it is my turn."""
        assert seen.privileged is not None, "the privileged sensor is declared"
        known = self._known(seen.tick, seen.privileged)
        if seen.tick < self._began_tick:
            return Reply(plan=self._published(seen))
        if seen.tick == self._began_tick:
            self._survey(known)
        self._s = self._path.project(seen.own.x, seen.own.y, self._s)
        self._signs = [line for line in self._signs if not self._dealt_with(line, seen.own.speed)]
        since = seen.tick - self._began_tick - self._rank
        turn = since >= 0 and since % REVIEW_TICKS == 0
        if turn and not self._still_good(seen, known):
            self._profile, self._made_tick = self._planned(seen, known), seen.tick
        return Reply(plan=self._published(seen))

    def _known(self, tick: int, known: Privileged) -> Privileged:
        """What is known, with people who will walk on; at the first tick, when to begin."""
        objects = known.objects
        if tick == 0:
            self._first_seen = dict(
                zip(objects.ids, zip(objects.x.tolist(), objects.y.tolist(), strict=True), strict=True)
            )
            self._began_tick = DECIDED_TICKS if has_undecided_vehicle(known, self._me) else 0
        return replace(known, objects=predict_walking_on(objects, self._first_seen))

    def _survey(self, known: Privileged) -> None:
        """Finds the paths of all CAVs and the order of planning."""
        me = self._me
        self._fleet = FleetPaths(plan_joint_detours(known, me), (me.vehicle.length, me.vehicle.width))
        self._path: ReferencePath = self._fleet.path_by_ego[me.ego_id]
        self._speeds = np.minimum(_speeds(self._path, self._cruise), self._legal_speeds())
        until_s = me.time_limit_s - SPARE_S
        tasks = {
            ego: build_free_road_problem(path, _speeds(path, self._cruise), (0.0, 0.0), 0.0, until_s)
            for ego, path in self._fleet.path_by_ego.items()
        }
        self._order = find_planning_order(self._fleet, tasks)
        self._rank = self._order.index(me.ego_id)
        self._signs = [convert_route_station(self._path, me, sign.s) for sign in me.stop_signs]

    def _legal_speeds(self) -> Float:
        """Speed limit (M,) [m/s] at the points of the path."""
        stations = np.linspace(0.0, self._path.length, len(self._path.xy))
        return np.interp(stations, self._me.route_s, self._me.route_speed_limit)

    def _dealt_with(self, line: float, speed: float) -> bool:
        """Whether a stop sign needs no more thought: I stand close before its line or have passed it."""
        stood = abs(speed) < 0.05 and self._s > line - STOP_BEFORE_M[0] - 1.0
        return stood or self._s > line - STOP_BEFORE_M[1] / 2

    def _still_good(self, seen: Observation, known: Privileged) -> bool:
        """Whether the profile arrives, the car is where it should be, and nobody will be in the way for `REVIEW_S`."""
        profile = self._profile
        if profile is None or not profile.reaches_goal:
            return False
        age = (seen.tick - self._made_tick) * self._me.tick_s
        if abs(float(profile.get_stations(np.full(1, age))[0]) - self._s) > ASTRAY_M:
            return False
        times = np.arange(1, int(REVIEW_S / INTERVAL_S) + 1, dtype=np.float64) * INTERVAL_S
        cells = find_cells(self._path, profile.get_stations(age + times))
        met = np.diagonal(self._blocked(known, cells, times, CHECK_MARGIN))
        return not (met & ~np.logical_and.accumulate(met)).any()  # a margin violated from the start was meant

    def _blocked(self, known: Privileged, cells: Int, times: Float, margin: SafetyMargin) -> Bool:
        """Which of my cells (J,) anybody whose plan I respect blocks at times (T,) [s] from now: (T, J).

        Those who come later in the order mind me: a leader must not brake for a follower. A new plan in the middle of
        the drive minds them too, for it surprises them.
        """
        me = self._me
        earlier = self._order[: self._rank]
        everyone = self._profile is not None and margin != CHECK_MARGIN
        size = me.vehicle.length, me.vehicle.width
        blocked = find_cells_blocked_by_objects(self._path, cells, known.objects, times, size, margin)
        for other, state, plan in zip(known.ego_ids, known.states, known.plans, strict=True):
            if other in earlier or (other != me.ego_id and everyone):
                stations = predict_stations(self._fleet.path_by_ego[other], state, plan, times, me.tick_s)
                blocked |= self._fleet.find_blocked_cells(me.ego_id, cells, other, stations, margin)
        return blocked

    def _planned(self, seen: Observation, known: Privileged) -> SpeedProfile:
        """A new profile from here, with the stops that are due."""
        now_s = seen.tick * self._me.tick_s
        until_s = max(self._me.time_limit_s - SPARE_S, now_s + 10.0)
        speeds = limit_speeds_near_pedestrians(self._path, self._speeds, known.objects, self._me.vehicle)
        task = build_free_road_problem(self._path, speeds, (self._s, seen.own.speed), now_s, until_s)
        task = task.add_traffic(partial(self._blocked, known, task.cells, task.times))
        done: SpeedProfile | None = None
        for line in self._signs:
            part = find_fastest_profile(task.require_stop(line - STOP_BEFORE_M[0], line - STOP_BEFORE_M[1]))
            if part is None or not part.reaches_goal:
                break
            part = part.extend_standstill(STOP_LAYERS)
            task, done = task.build_remainder(part), part if done is None else done.append(part)
        last = find_fastest_profile(task) or build_braking_profile(task)
        return last if done is None else done.append(last)

    def _published(self, seen: Observation) -> Plan:
        """What the others may rely on: the profile from now on until beyond the goal, or standing here."""
        if self._profile is None:
            return Plan(np.array([(seen.own.x, seen.own.y)]), INTERVAL_S)
        age = (seen.tick - self._made_tick) * self._me.tick_s
        stations = self._profile.get_stations(age + np.arange(1, MAX_PLAN_POINTS + 1, dtype=np.float64) * INTERVAL_S)
        count = int(np.searchsorted(stations, self._path.goal_s + SHOWN_M)) + 1
        return Plan(self._path.get_points(stations[:count]), INTERVAL_S)


def _speeds(path: ReferencePath, cruise: float) -> Float:
    return compute_curve_speeds(path, cruise, LATERAL, BRAKING)
