"""The configuration of one episode, and the vehicle that every CAV drives."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from enum import StrEnum
from functools import cached_property
from typing import Any, TypedDict, Unpack, cast

from mdrive_sumo.actors import ActorMode
from mdrive_sumo.core.clock import IDEAL, Clock, parse_clock
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.suggestion import describe_unknown
from mdrive_sumo.episode import Ending, ThinkTime
from mdrive_sumo.loop.pseudonyms import StationIds, derive_pseudonyms
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.weather import FrictionMode
from mdrive_sumo.sensing.sensing_profile import SensingProfile
from mdrive_sumo.v2x.comm_settings import PRESETS, CommSettings, format_comm_json, parse_comm
from mdrive_sumo.vehicle import dynamics

VEHICLE = dynamics.MKZ_2017
"""Every CAV is the paper's car (protocol K6)."""


class EpisodeArguments(TypedDict, total=False):
    """Keyword arguments of the Python front door; each means what the option of `mdrive-sumo eval` means."""

    comm: str | CommSettings
    agent_clock: str | Clock
    actors: str
    friction: str
    ids: str
    sensing: str


@dataclass(frozen=True, slots=True)
class EpisodeOptions:
    """Conditions of an episode that the user chooses besides scenario, agents and seed.

    They identify a run: journal, recordings and results hold them. An option whose type is a StrEnum needs a field with
    metadata here and its line in `EpisodeArguments`, a field of `scoring.RunInfo` (the published format of
    results.json) and its place of use. The option of the command line, the name of the default run folder, the line in
    the report and the serialised forms follow from the field.
    """

    comm: CommSettings = PRESETS["ideal"]
    """Properties of the V2X channel."""
    clock: Clock = IDEAL
    """What an agent's think time costs."""
    actor_mode: ActorMode = field(
        default=ActorMode.DEFAULT,
        metadata={
            "key": "actors",
            "help": "Scripted road users: reacting, on a global clock; or as in MDrive's own code.",
        },
    )
    """Behaviour of the scripted actors."""
    friction: FrictionMode = field(
        default=FrictionMode.DRY,
        metadata={
            "key": "friction",
            "help": "Roads: dry in every weather; or wet in rain, for CAVs and SUMO's traffic.",
        },
    )
    """Road friction. Agents are not informed: the briefing states the limits of a dry road."""
    station_ids: StationIds = field(
        default=StationIds.RANDOM,
        metadata={
            "key": "ids",
            "help": "Ids of CAVs and RSUs in agents and messages: random per episode, or the scenario's.",
        },
    )
    """Ids that agents learn. Results and recordings always have the scenario's."""
    sensing: SensingProfile = field(
        default=SensingProfile.REALISTIC,
        metadata={
            "key": "sensing",
            "help": "Own states and detections of CAVs and road-side units: with realistic errors; or exact.",
        },
    )
    """Quality of own states and of the standard detector, the same for all stations."""

    @classmethod
    def parse(cls, **arguments: Unpack[EpisodeArguments]) -> "EpisodeOptions":
        """Return the options that texts or typed values stand for. Raises InputError, also for an unknown argument."""
        values: dict[str, Any] = {**arguments}
        comm, clock = values.pop("comm", "ideal"), values.pop("agent_clock", IDEAL)
        if isinstance(comm, str):
            if comm not in PRESETS:
                raise InputError(f"comm: {describe_unknown(comm, PRESETS)}")
            comm = PRESETS[comm]
        if not isinstance(cast(object, comm), CommSettings):
            raise InputError(f"comm: expected one of {', '.join(PRESETS)} or CommSettings, found {comm!r:.40}")
        choices = cls.list_choices()
        chosen: dict[str, Any] = {}
        for key, value in values.items():
            if key not in choices:
                raise InputError(f"{key}: unknown option, {describe_unknown(key, EpisodeArguments.__annotations__)}")
            name, kind, _ = choices[key]
            if value not in list(kind):
                raise InputError(f"{key}: {describe_unknown(str(value), kind)}")
            chosen[name] = kind(value)
        return cls(comm, parse_clock(clock) if isinstance(clock, str) else clock, **chosen)

    @classmethod
    def list_choices(cls) -> dict[str, tuple[str, type[StrEnum], str]]:
        """Return the options with a fixed set of values: key -> (field, type, help text)."""
        chosen = [option for option in fields(cls) if isinstance(option.default, StrEnum)]
        return {
            option.metadata["key"]: (option.name, cast("type[StrEnum]", type(option.default)), option.metadata["help"])
            for option in chosen
        }

    def to_dict(self) -> dict[str, str]:
        """Return the options as journal and recordings hold them; the inverse of `from_dict`."""
        choices = {key: str(getattr(self, name)) for key, (name, _, _) in self.list_choices().items()}
        return {"comm": format_comm_json(self.comm), "agent_clock": self.clock.text, **choices}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> "EpisodeOptions":
        """Return the options of a journal's fingerprint; a missing choice has its default.

        Raises KeyError, ValueError or InputError for unusable values.
        """
        stored = {"ids": StationIds.SCENARIO, **values}  # in older journals, which have no entry, agents knew the ids
        choices: dict[str, Any] = {
            name: kind(stored[key]) for key, (name, kind, _) in cls.list_choices().items() if key in stored
        }
        return cls(parse_comm(json.loads(values["comm"])), parse_clock(values["agent_clock"]), **choices)


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
    think_times: tuple[ThinkTime, ...] = ()
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

    @property
    def road_grip(self) -> float:
        """Share of the friction of a dry road, in (0, 1]."""
        return self.options.friction.grip_in(self.scenario.weather)
