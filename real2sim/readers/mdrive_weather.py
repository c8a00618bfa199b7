"""Map CARLA's weather parameters to the nearest preset."""

from collections.abc import Mapping

from mdrive_sumo.scenario.weather import WeatherName

CLOUDY = 65.0
"""Cloudiness [%] half-way between MDrive's default (30) and its presets cloudy and overcast (100)."""
RAIN = 22.5
"""Precipitation [%] half-way between MDrive's preset cloudy (15) and CARLA's 0.9.12 soft rain (30)."""


def find_nearest_weather(numbers: Mapping[str, float]) -> tuple[WeatherName, str]:
    """Return the preset and a note on the original parameters, "" if none is needed. Night precedes rain."""
    sun, clouds = numbers.get("sun_altitude_angle", 70.0), numbers.get("cloudiness", 30.0)
    rain, fog = numbers.get("precipitation", 0.0), numbers.get("fog_density", 0.0)
    name: WeatherName = "default"
    if sun < 0:
        name = "night"
    elif rain >= RAIN:
        name = "rain"
    elif clouds >= CLOUDY:
        name = "cloudy"
    if name == "default" and fog == 0 and rain == 0:
        return name, ""
    return name, (
        f"weather {name}: the nearest to sun altitude {sun:g} deg, cloudiness {clouds:g} %, precipitation {rain:g} %,"
        f" fog {fog:g} %"
    )
