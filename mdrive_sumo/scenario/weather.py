"""Weather and light: how they shorten what sensors see. They change nothing else (no friction).

The factors are rough figures with a reason each, not a physical model; docs/sensors.md tells where they come from.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal, TypeAlias

WeatherName: TypeAlias = Literal["default", "cloudy", "rain", "night"]


@dataclass(frozen=True, slots=True)
class Weather:
    """Factors in (0, 1] by which ranges shrink."""

    name: WeatherName
    objects_range: float
    """Of object detection."""
    lidar_range: float


WEATHERS: Mapping[WeatherName, Weather] = MappingProxyType(
    {
        "default": Weather("default", 1.0, 1.0),
        "cloudy": Weather("cloudy", 1.0, 1.0),  # clouds dim the light, and shorten no range
        "rain": Weather("rain", 0.8, 0.8),  # heavy rain: light is lost there and back
        "night": Weather("night", 0.7, 1.0),  # cameras see what lamps light; a LiDAR brings its own light
    }
)
