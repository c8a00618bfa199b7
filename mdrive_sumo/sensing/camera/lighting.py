"""Light of a rendered scene: colours of sky, sun and fog by time of day and weather. Chosen by eye; no photometry."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from mdrive_sumo.scenario.weather import WeatherName

Rgb = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Lighting:
    """Colours are RGB in [0, 1]."""

    zenith: Rgb
    horizon: Rgb
    """Colour of the sky at the horizon, and of the fog."""
    sun: Rgb
    ambient: Rgb
    fog_per_m: float
    """Extinction [1/m]."""
    lamps: bool = False
    """Whether lamps of vehicles shine, and the own head lamps light the road."""
    wet: float = 0.0
    """How much darker wet ground is, a share."""
    elevation: float = 0.62
    """Vertical part of the unit vector to the sun."""


LIGHTS: Mapping[str, Lighting] = MappingProxyType(
    {
        "day": Lighting((0.33, 0.53, 0.83), (0.76, 0.84, 0.92), (0.62, 0.60, 0.54), (0.48, 0.50, 0.54), 0.0007),
        "cloudy": Lighting((0.58, 0.63, 0.68), (0.76, 0.79, 0.81), (0.22, 0.22, 0.22), (0.66, 0.67, 0.69), 0.0015),
        "dusk": Lighting(
            (0.22, 0.27, 0.45), (0.86, 0.58, 0.40), (0.55, 0.36, 0.20), (0.33, 0.31, 0.36), 0.0015, True, 0.0, 0.18
        ),
        "night": Lighting((0.01, 0.015, 0.03), (0.03, 0.035, 0.05), (0.0, 0.0, 0.0), (0.10, 0.10, 0.13), 0.002, True),
        "rain": Lighting(
            (0.48, 0.52, 0.56), (0.60, 0.63, 0.66), (0.08, 0.08, 0.08), (0.58, 0.59, 0.61), 0.008, True, 0.3
        ),
        "fog": Lighting((0.72, 0.74, 0.76), (0.78, 0.80, 0.81), (0.06, 0.06, 0.06), (0.68, 0.69, 0.70), 0.03, True),
    }
)
LIGHT_OF_WEATHER: Mapping[WeatherName, str] = MappingProxyType(
    {"default": "day", "cloudy": "cloudy", "rain": "rain", "night": "night"}
)
