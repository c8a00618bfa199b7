"""The options that all planning baselines share."""

from collections.abc import Mapping
from types import MappingProxyType

from mdrive_sumo.contract import Briefing, SensorSpec
from mdrive_sumo.contract.agent_options import Choice, Config, Option, read_choice, read_options
from mdrive_sumo.contract.detector_profiles import IDEAL, LIDAR_SINGLE, STANDARD

DRIVING_OPTIONS = MappingProxyType({"speed": Option(8.0, 2.0, 10.0), "range": Option(80.0, 5.0, 200.0)})
NO_OPTIONS: Mapping[str, Option] = MappingProxyType({})
DETECTOR = Choice(STANDARD, (STANDARD, LIDAR_SINGLE, IDEAL))
"""By default all agents have the detector of the episode's sensing profile."""


class DrivingOptions:
    """Checked options of a baseline.

    speed: cruising speed [m/s]; range: range of the detector [m]; detector: its error profile, see docs/sensors.md.
    """

    def __init__(self, agent: str, config: Config, extra: Mapping[str, Option] = NO_OPTIONS) -> None:
        """Read the options of that agent; extra: its own numeric options, whose values `values` contains.

        Raises InputError for an unknown name or a value out of range.
        """
        self.values = read_options(agent, config, {**DRIVING_OPTIONS, **extra}, {"detector": DETECTOR})
        self.cruise_speed, self.range_m = self.values["speed"], self.values["range"]
        self._detector = read_choice(agent, config, "detector", DETECTOR)

    def build_sensor_spec(self, free_space: bool = False) -> SensorSpec:
        """Return the sensor of visible boxes; free_space: also how far the view is free."""
        options = {"profile": self._detector, "free_space": free_space}
        return SensorSpec("objects", range_m=self.range_m, options=options)

    def find_detector(self, briefing: Briefing) -> str:
        """Return the name of the detector's error profile in this episode."""
        return briefing.standard_detector if self._detector == STANDARD else self._detector
