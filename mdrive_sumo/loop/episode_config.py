"""The configuration of one episode, and the vehicle that every CAV drives."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from mdrive_sumo.core.seeding import derive_seed
from mdrive_sumo.episode import Ending, ThinkTimeEntry
from mdrive_sumo.episode.episode_options import EpisodeOptions
from mdrive_sumo.loop.pseudonyms import derive_pseudonyms
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.weather import WEATHERS
from mdrive_sumo.sensing.observation_builder import SensorContext
from mdrive_sumo.v2x.attacks.attackers import choose_attackers
from mdrive_sumo.vehicle import dynamics

VEHICLE = dynamics.MKZ_2017
"""Every CAV is the paper's car (protocol K6)."""


@dataclass(frozen=True)
class EpisodeConfig:
    """Everything that stays constant during an episode."""

    scenario: Scenario
    roads: RoadMap
    seed: int
    about: Mapping[str, Any] = field(default_factory=dict[str, Any])
    """Scalars that identify the run; they are written into the recording."""
    replayed_failures: tuple[Ending, ...] = ()
    """Agent failures of a recorded run. They are repeated in the same tick, because a time-out is not reproducible."""
    options: EpisodeOptions = EpisodeOptions()
    think_times: tuple[ThinkTimeEntry, ...] = ()
    """Think times of the agents of a recorded run, to re-execute it under a measured clock."""
    pass_through: bool = False
    """Whether boxes may overlap; contacts are recorded in either case."""

    @cached_property
    def pseudonyms(self) -> Mapping[str, str]:
        """The id that agents get for every CAV and road-side unit of the scenario."""
        stations = [station.id for station in (*self.scenario.egos, *self.scenario.rsus)]
        return derive_pseudonyms(stations, self.options.station_ids, self.seed, self.scenario.id)

    @property
    def cav_pseudonyms(self) -> dict[str, str]:
        """The id that agents get for every CAV, in the order of the scenario file."""
        return {ego.id: self.pseudonyms[ego.id] for ego in self.scenario.egos}

    @cached_property
    def attackers(self) -> frozenset[str]:
        """The ids of the CAVs and road-side units that lie; none without an attack."""
        attack, scenario = self.options.parsed_attack, self.scenario
        if attack is None:
            return frozenset()
        cavs, rsus = [ego.id for ego in scenario.egos], [rsu.id for rsu in scenario.rsus]
        return choose_attackers(attack, cavs, rsus, scenario.id, self.seed)

    @property
    def sensor_context(self) -> SensorContext:
        """What all sensors of the episode share."""
        seed = derive_seed(self.seed, self.scenario.id, "sensing")
        return SensorContext(self.roads, WEATHERS[self.scenario.weather], seed, self.options.sensing)

    @property
    def road_grip(self) -> float:
        """Share of the friction of a dry road, in (0, 1]."""
        return self.options.friction.grip_in(self.scenario.weather)
