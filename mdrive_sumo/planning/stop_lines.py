"""Stop lines on a route: stop signs and traffic lights."""

from collections.abc import Callable, Mapping, Sequence
from typing import TypeAlias

from mdrive_sumo.contract import Briefing, TrafficLight
from mdrive_sumo.planning.parameters import STOP_LINE, StopLineParameters
from mdrive_sumo.planning.reference_path import ReferencePath, convert_route_station

CanStop: TypeAlias = Callable[[float], bool]
"""Whether a car can still stop comfortably at that arc length [m]."""


class StopLines:
    """The stop signs that are not obeyed yet, and the traffic lights; all arc lengths [m] along one path."""

    def __init__(
        self, signs: Sequence[float], lights: Sequence[TrafficLight], parameters: StopLineParameters = STOP_LINE
    ) -> None:
        self._signs, self._lights, self._parameters = list(signs), lights, parameters

    def find_stop_stations(
        self, here: float, speed: float, signals: Mapping[str, str], can_stop: CanStop
    ) -> list[float]:
        """Return the stations [m] that the box centre must not pass now.

        here: station of the car [m]; speed [m/s]; signals: state letter by traffic light id.
        """
        self._signs = [line for line in self._signs if not self._is_obeyed(line, here, speed)]
        gap_m = self._parameters.light_gap_m
        signs = [line - self._parameters.sign_gap_m for line in self._signs]
        lights = [(light.s, signals.get(light.id, "g")) for light in self._lights]
        return signs + [line - gap_m for line, letter in lights if self._is_closed(line, letter, here, can_stop)]

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


def build_stop_lines(path: ReferencePath, briefing: Briefing, include_signs: bool = True) -> StopLines:
    """Return the stop lines of a briefing, converted from the route to the path; with or without stop signs."""
    signs = [convert_route_station(path, briefing, sign.s) for sign in briefing.stop_signs if include_signs]
    lights = [TrafficLight(one.id, convert_route_station(path, briefing, one.s)) for one in briefing.traffic_lights]
    return StopLines(signs, lights)
