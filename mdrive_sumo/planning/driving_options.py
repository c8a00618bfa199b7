"""The options that all planning baselines share."""

from collections.abc import Mapping
from types import MappingProxyType

from mdrive_sumo.contract import Objects, Observation, SensorSpec
from mdrive_sumo.contract.agent_options import Choice, Config, Option, read_choice, read_options
from mdrive_sumo.contract.detector_profiles import IDEAL, LIDAR_SINGLE, PROFILES
from mdrive_sumo.core.state import DT

DRIVING_OPTIONS = MappingProxyType({"speed": Option(8.0, 2.0, 10.0), "range": Option(80.0, 5.0, 200.0)})
NO_OPTIONS: Mapping[str, Option] = MappingProxyType({})
DETECTOR = Choice(LIDAR_SINGLE, (LIDAR_SINGLE, IDEAL))


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

    @property
    def latency_ticks(self) -> int:
        """Age of the detections, from the detector's profile."""
        return PROFILES[self._detector].latency_ticks

    def compensate_latency(self, seen: Observation) -> Objects:
        """Return the own detections, advanced to the present tick at constant speed."""
        assert seen.objects is not None, "the objects sensor is declared"
        return seen.objects.advance(self.latency_ticks * DT) if self.latency_ticks else seen.objects
