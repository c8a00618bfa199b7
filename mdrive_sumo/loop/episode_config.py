"""The configuration of one episode, and the vehicle that every CAV drives."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from mdrive_sumo.actors import ActorMode
from mdrive_sumo.core.clock import IDEAL, Clock
from mdrive_sumo.episode import Ending, ThinkTime
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.weather import FrictionMode
from mdrive_sumo.v2x.comm_settings import PRESETS, CommSettings
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
    comm: CommSettings = PRESETS["ideal"]
    """Properties of the V2X channel."""
    clock: Clock = IDEAL
    think_times: tuple[ThinkTime, ...] = ()
    """Think times of the agents of a recorded run, to re-execute it under a measured clock."""
    actor_mode: ActorMode = ActorMode.DEFAULT
    """Behaviour of the scripted actors."""
    friction: FrictionMode = FrictionMode.DRY
    """Road friction for the CAVs. Agents are not informed: the briefing states the limits of a dry road."""
    pass_through: bool = False
    """Whether boxes may overlap; contacts are recorded in either case."""
