"""Weather and light: factors on sensor ranges and, optionally, on road friction.

The factors are rough estimates with a reason each, not a physical model; docs/detections.md names their sources.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from types import MappingProxyType
from typing import Literal, TypeAlias

WeatherName: TypeAlias = Literal["default", "cloudy", "rain", "night"]


@dataclass(frozen=True, slots=True)
class Weather:
    """Factors in (0, 1] on sensor ranges and friction."""

    name: WeatherName
    objects_range: float
    """Factor on the range of object detection."""
    lidar_range: float
    grip: float = 1.0
    """Factor on the friction between tyres and road; it counts only with `FrictionMode.WEATHER`."""


WEATHERS: Mapping[WeatherName, Weather] = MappingProxyType(
    {
        "default": Weather("default", 1.0, 1.0),
        "cloudy": Weather("cloudy", 1.0, 1.0),  # clouds dim the light, and shorten no range
        "rain": Weather("rain", 0.8, 0.8, 0.7),  # heavy rain: light is lost there and back; wet asphalt
        "night": Weather("night", 0.7, 1.0),  # cameras see what lamps light; a LiDAR brings its own light
    }
)


class FrictionMode(StrEnum):
    """Source of the road friction."""

    DRY = "dry"
    """Dry in every weather."""
    WEATHER = "weather"
    """According to the scenario's weather."""

    def grip_in(self, weather: WeatherName) -> float:
        """Return the share of the friction of a dry road, in (0, 1]."""
        return WEATHERS[weather].grip if self is FrictionMode.WEATHER else 1.0
