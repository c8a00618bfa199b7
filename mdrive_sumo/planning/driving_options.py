"""The options that all planning baselines share."""

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from mdrive_sumo.contract import Briefing, SensorSpec
from mdrive_sumo.contract.agent_options import Choice, Config, Option, read_choice, read_options
from mdrive_sumo.contract.briefing import PROTOCOL_SPEED
from mdrive_sumo.contract.detector_profiles import IDEAL, LIDAR_SINGLE, STANDARD
from mdrive_sumo.core.geometry import Bool
from mdrive_sumo.planning.planning_scale import find_cruise_speed

ROAD_RANGE_M = 200.0
"""Range [m] of the detector on roads whose limits count: a car at 33 m/s stands after 181 m of braking with 3 m/s2."""
MAX_SPEED = 40.0
"""[m/s]"""
JUNCTION_AHEAD_M = 10.0
"""[m] `junction_share` counts from so far before a junction: two car lengths, from where a driver looks into it."""
DRIVING_OPTIONS = MappingProxyType(
    {
        "speed": Option(PROTOCOL_SPEED, 2.0, MAX_SPEED),
        "speed_share": Option(1.0, 0.05, 2.0),
        "junction_share": Option(1.0, 0.1, 1.0),
        "range": Option(80.0, 5.0, ROAD_RANGE_M),
    }
)
NO_OPTIONS: Mapping[str, Option] = MappingProxyType({})
DETECTOR = Choice(STANDARD, (STANDARD, LIDAR_SINGLE, IDEAL))
"""By default all agents have the detector of the episode's sensing profile."""


def _find_unlit_junctions(briefing: Briefing) -> Bool:
    """Return which points (N,) of the route are in a junction without lights or at most `JUNCTION_AHEAD_M` before."""
    points = np.zeros(len(briefing.route_s), dtype=np.bool_)
    for junction in briefing.junctions:
        if junction.kind != "traffic-light":
            begin = junction.entry_s - JUNCTION_AHEAD_M
            points |= (briefing.route_s >= begin) & (briefing.route_s <= junction.exit_s)
    return points


class DrivingOptions:
    """Checked options of a baseline.

    speed: cruising speed [m/s], without it the speed that the scenario asks for; speed_share: share of that speed and
    of the limits; junction_share: share of the limits that is left at junctions without lights; range: range of the
    detector [m], without it 80 m, or `ROAD_RANGE_M` where the limits of the road count; detector: its error profile,
    see docs/detections.md.
    """

    def __init__(self, agent: str, config: Config, extra: Mapping[str, Option] = NO_OPTIONS) -> None:
        """Read the options of that agent; extra: its own numeric options, whose values `values` contains.

        Raises InputError for an unknown name or a value out of range.
        """
        self.values = read_options(agent, config, {**DRIVING_OPTIONS, **extra}, {"detector": DETECTOR})
        self._speed = self.values["speed"] if "speed" in config else None
        self._range_m, self._road_range_m = self.values["range"], self.values["range"]
        if "range" not in config:
            self._road_range_m = ROAD_RANGE_M
        self._detector = read_choice(agent, config, "detector", DETECTOR)

    def build_sensor_spec(self, free_space: bool = False) -> SensorSpec:
        """Return the sensor of visible boxes; free_space: also how far the view is free."""
        options = {"profile": self._detector, "free_space": free_space, "road_range_m": self._road_range_m}
        return SensorSpec("objects", range_m=self._range_m, options=options)

    def adapt_briefing(self, briefing: Briefing) -> Briefing:
        """Return the briefing with the share of the speed limits that this agent drives, less at junctions."""
        share, junction_share = self.values["speed_share"], self.values["junction_share"]
        if share == 1.0 and junction_share == 1.0:
            return briefing
        limit = share * briefing.route_speed_limit
        if junction_share < 1.0:
            limit = np.where(_find_unlit_junctions(briefing), junction_share * limit, limit)
        return replace(briefing, route_speed_limit=limit)

    def find_cruise_speed(self, briefing: Briefing) -> float:
        """Return the cruising speed [m/s] with an adapted briefing."""
        return find_cruise_speed(briefing, self._speed, self.values["speed_share"] * PROTOCOL_SPEED)

    def find_range(self, briefing: Briefing) -> float:
        """Return the range of the detector [m] in this episode."""
        return self._range_m if briefing.desired_speed is not None else self._road_range_m

    def find_detector(self, briefing: Briefing) -> str:
        """Return the name of the detector's error profile in this episode."""
        return briefing.standard_detector if self._detector == STANDARD else self._detector
