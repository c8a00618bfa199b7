"""Navigation of a learned system: where its route goes from where the car is."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mdrive_sumo.agents.learned.ego_frame import convert_to_ego
from mdrive_sumo.agents.learned.system_spec import (
    COMMANDS,
    LIMIT_ROWS,
    NAVIGATION_SIZE,
    ROUTE_POINTS,
    ROUTE_STEP_M,
    TARGET_POINTS_M,
)
from mdrive_sumo.contract import Briefing, OwnState
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.planning.route_commands import RouteCommand, find_route_commands

Float32 = npt.NDArray[np.float32]

COMMAND_AHEAD_M = 20.0
"""A turn or a lane change is announced so long before it begins: 2.5 s at 8 m/s. Design choice."""
SIGHT_M = 50.0
"""Distances to the goal and to stop lines are told up to here."""
BACK_M, AHEAD_M = 5.0, 15.0
"""Window along the route in which the car is sought: faster cars drive at most 7 m from decision to decision, and a
route may cross itself."""
SPEED_SCALE, TARGET_SCALE_M = 10.0, 20.0
"""Of the navigation vector, so that its numbers are about 1."""


@dataclass(frozen=True, slots=True)
class Navigation:
    """What the route asks for at one place. Frame: ego, x ahead, y left of the box centre."""

    command: int
    """Index in `COMMANDS`: the first turn or lane change that begins within `COMMAND_AHEAD_M`, or the present one."""
    target_points: Float
    """(2, 2) [m] points of the route `TARGET_POINTS_M` ahead; the goal if it is nearer."""
    route: Float32
    """(ROUTE_POINTS, 4): x, y, half lane width [m], speed limit [m/s], every `ROUTE_STEP_M` from the car's station on;
    the last point is repeated beyond the goal. The limit is at most the speed that the scenario asks for."""
    goal_m: float
    """[m] Along the route."""
    stop_m: float
    """[m] To the line of the next stop sign; `SIGHT_M` if there is none so near."""
    station_m: float
    """[m] Arc length of the car on the route."""

    def build_vector(self, speed: float) -> Float32:
        """Return the vector (NAVIGATION_SIZE,): speed / 10, command (one-hot), target points / 20 (x, y, x, y), and
        distances to the goal and to the stop line in units of 50 m, at most 1."""
        vector = np.zeros(NAVIGATION_SIZE, dtype=np.float32)
        vector[0] = speed / SPEED_SCALE
        vector[1 + self.command] = 1.0
        points = 1 + len(COMMANDS)
        vector[points : points + self.target_points.size] = self.target_points.ravel() / TARGET_SCALE_M
        vector[-2:] = min(self.goal_m, SIGHT_M) / SIGHT_M, min(self.stop_m, SIGHT_M) / SIGHT_M
        return vector


def take_limits(route: Float32) -> Float32:
    """Return the allowed speeds (..., len(LIMIT_ROWS)) [m/s] of routes (..., ROUTE_POINTS, 4)."""
    return route[..., LIMIT_ROWS, 3]


class RouteNavigator:
    """Follows a car along its route. The station never decreases."""

    def __init__(self, briefing: Briefing) -> None:
        self._xy, self._s = briefing.route_xy, briefing.route_s
        limits, desired = briefing.route_speed_limit, briefing.desired_speed
        speeds = limits if desired is None else np.minimum(limits, desired)
        self._columns = (self._xy[:, 0], self._xy[:, 1], briefing.route_lane_width / 2, speeds)
        self._commands = find_route_commands(briefing.route_xy, briefing.route_yaw)
        self._stops = np.array(sorted(sign.s for sign in briefing.stop_signs), dtype=np.float64)
        self._station_m = float(self._s[0])

    def locate(self, own: OwnState) -> Navigation:
        """Return the navigation at the car's place, and remember its station."""
        self._station_m = station = max(self._station_m, self._project(own))
        targets = convert_to_ego(self._sample(station + np.array(TARGET_POINTS_M), 2), own)
        stops = self._stops[self._stops > station]
        stop_m = float(stops[0]) - station if len(stops) else SIGHT_M
        return Navigation(
            command=self._find_command(station),
            target_points=targets,
            route=self._build_route(own, station),
            goal_m=float(self._s[-1]) - station,
            stop_m=min(stop_m, SIGHT_M),
            station_m=station,
        )

    def _project(self, own: OwnState) -> float:
        """Return the station [m] of the nearest point of the route within the window around the last one."""
        low = int(np.searchsorted(self._s, self._station_m - BACK_M, side="right")) - 1
        high = int(np.searchsorted(self._s, self._station_m + AHEAD_M)) + 1
        low, high = max(low, 0), min(high, len(self._s))
        start, step = self._xy[low : high - 1], np.diff(self._xy[low:high], axis=0)
        if not len(step):
            return float(self._s[low])
        relative = np.array((own.x, own.y)) - start
        share = (relative * step).sum(1) / np.maximum((step * step).sum(1), 1e-12)
        share = np.clip(share, 0.0, 1.0)
        gap = relative - share[:, None] * step
        row = int(np.argmin((gap * gap).sum(1)))
        return float(self._s[low + row] + share[row] * (self._s[low + row + 1] - self._s[low + row]))

    def _find_command(self, station: float) -> int:
        """Return the first command other than FOLLOW between here and `COMMAND_AHEAD_M` ahead."""
        first = max(int(np.searchsorted(self._s, station, side="right")) - 1, 0)
        ahead = self._commands[first : int(np.searchsorted(self._s, station + COMMAND_AHEAD_M, side="right"))]
        rows = np.flatnonzero(ahead != RouteCommand.FOLLOW)
        return int(ahead[rows[0]]) if len(rows) else int(RouteCommand.FOLLOW)

    def _build_route(self, own: OwnState, station: float) -> Float32:
        rows = self._sample(station + ROUTE_STEP_M * np.arange(ROUTE_POINTS, dtype=np.float64), 4)
        rows[:, :2] = convert_to_ego(rows[:, :2], own)
        return rows.astype(np.float32)

    def _sample(self, stations: Float, columns: int) -> Float:
        """Return the first columns (K, columns) of x, y, half lane width, speed at stations (K,) [m]."""
        return np.column_stack([np.interp(stations, self._s, column) for column in self._columns[:columns]])
