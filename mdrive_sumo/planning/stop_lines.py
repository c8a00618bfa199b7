"""Where a car must wait, and the stop lines on a route: stop signs and traffic lights."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TypeAlias

from mdrive_sumo.contract import Briefing, Cause, Reason, TrafficLight
from mdrive_sumo.planning.parameters import STOP_LINE, StopLineParameters
from mdrive_sumo.planning.reference_path import ReferencePath, convert_route_station

CanStop: TypeAlias = Callable[[float], bool]
"""Whether a car can still stop comfortably at that arc length [m]."""


@dataclass(frozen=True, slots=True)
class StopPoint:
    """A station [m] on the path that the box centre must not pass until a time [s from now], and why."""

    s: float
    reason: Reason
    until_s: float = math.inf
    """Infinity: until it is no longer listed."""


class StopLines:
    """The stop signs that are not obeyed yet, and the traffic lights; all arc lengths [m] along one path."""

    def __init__(
        self, signs: Sequence[float], lights: Sequence[TrafficLight], parameters: StopLineParameters = STOP_LINE
    ) -> None:
        self._signs, self._lights, self._parameters = list(signs), lights, parameters

    def find_stops(
        self, here: float, speed: float, signals: Mapping[str, str], can_stop: CanStop | None = None
    ) -> list[StopPoint]:
        """Return the stop points at stop signs and closed lights.

        here: station of the car [m]; speed [m/s]; signals: state letter by traffic light id; can_stop: whether a
        car stops at a yellow light, by default if braking with `yellow_braking` is enough.
        """
        self._signs = [line for line in self._signs if not self._is_obeyed(line, here, speed)]
        stops = [_build_stop(line - self._parameters.sign_gap_m, here, Cause.STOP_SIGN) for line in self._signs]
        can_stop = can_stop or partial(self._can_stop_gently, here, speed)
        for light in self._lights:
            if self._is_closed(light.s, signals.get(light.id, "g"), here, can_stop):
                stops.append(_build_stop(light.s - self._parameters.light_gap_m, here, Cause.LIGHT, (light.id,)))
        return stops

    def _can_stop_gently(self, here: float, speed: float, line: float) -> bool:
        """Return whether the car can stop with `yellow_braking`; closer than 0.5 m the distance does not matter."""
        return line > here and (speed * speed) / (2 * max(line - here, 0.5)) < self._parameters.yellow_braking

    def _is_obeyed(self, line: float, here: float, speed: float) -> bool:
        """Return whether the car stands before the line of a stop sign or has passed it."""
        parameters = self._parameters
        close = here > line - parameters.sign_gap_m - parameters.stopped_within_m
        return here > line or (abs(speed) < parameters.stopped_speed and close)

    def _is_closed(self, line: float, letter: str, here: float, can_stop: CanStop) -> bool:
        """Return whether a light ahead is red, or yellow with room to stop."""
        if here > line or letter not in "rRuyY":
            return False
        return letter in "rRu" or can_stop(line - self._parameters.light_gap_m)


def _build_stop(station: float, here: float, cause: Cause, others: tuple[str, ...] = ()) -> StopPoint:
    """Return the stop point at a station [m] for a car at station `here` [m]."""
    return StopPoint(station, Reason(cause, others, distance_m=max(station - here, 0.0)))


def build_stop_lines(path: ReferencePath, briefing: Briefing, include_signs: bool = True) -> StopLines:
    """Return the stop lines of a briefing, converted from the route to the path; with or without stop signs."""
    signs = [convert_route_station(path, briefing, sign.s) for sign in briefing.stop_signs if include_signs]
    lights = [
        TrafficLight(light.id, convert_route_station(path, briefing, light.s)) for light in briefing.traffic_lights
    ]
    return StopLines(signs, lights)
