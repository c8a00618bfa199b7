"""The lines on a route at which a driver stops: stop signs and traffic lights."""

from collections.abc import Callable, Mapping, Sequence
from typing import TypeAlias

from mdrive_sumo.contract import Briefing, TrafficLight
from mdrive_sumo.planning.path import Path, path_station

SIGN_MARGIN_M = 1.5
"""Stops with the box centre that far before the line of a stop sign: inside its box."""
LIGHT_MARGIN_M = 3.0
"""Stops with the box centre that far before the line of a red light: front behind the line."""
STOOD_M = 1.5
STOOD_SPEED = 0.05

CanStop: TypeAlias = Callable[[float], bool]
"""Whether a car may still stop comfortably at that arc length [m]."""


class Lines:
    """Stop signs that are still to be minded, and lights by their colour; all arc lengths [m] along one way."""

    def __init__(self, signs: Sequence[float], lights: Sequence[TrafficLight]) -> None:
        self._signs, self._lights = list(signs), lights

    def stations(self, here: float, speed: float, signals: Mapping[str, str], can_stop: CanStop) -> list[float]:
        """Where the box centre must not pass now, for a car that is here [m] at that speed [m/s]."""
        self._signs = [line for line in self._signs if not _dealt_with(line, here, speed)]
        signs = [line - SIGN_MARGIN_M for line in self._signs]
        lights = [(light.s, signals.get(light.id, "g")) for light in self._lights]
        return signs + [line - LIGHT_MARGIN_M for line, letter in lights if _stops(line, letter, here, can_stop)]


def _dealt_with(line: float, here: float, speed: float) -> bool:
    """Whether I stand before the line of a stop sign or have passed it."""
    return here > line or (abs(speed) < STOOD_SPEED and here > line - SIGN_MARGIN_M - STOOD_M)


def _stops(line: float, letter: str, here: float, can_stop: CanStop) -> bool:
    """Red, or yellow with room to stop; beyond the line nothing counts."""
    if here > line or letter not in "rRuyY":
        return False
    return letter in "rRu" or can_stop(line - LIGHT_MARGIN_M)


def lines_on(path: Path, briefing: Briefing, signs: bool = True) -> Lines:
    """The lines of a briefing, which tells them along the route, along the path; with or without stop signs."""
    stops = [path_station(path, briefing, sign.s) for sign in briefing.stop_signs if signs]
    lights = [TrafficLight(light.id, path_station(path, briefing, light.s)) for light in briefing.traffic_lights]
    return Lines(stops, lights)
