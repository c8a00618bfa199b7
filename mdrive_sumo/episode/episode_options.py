"""EpisodeOptions: the conditions of an episode that the user chooses."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import StrEnum, auto
from typing import Any, TypedDict, Unpack, cast

from mdrive_sumo.actors import ActorMode
from mdrive_sumo.core.clock import IDEAL, Clock, parse_clock
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.json_object import parse_json_object
from mdrive_sumo.core.setting import Scalar, Setting, check_names, list_settings, setting
from mdrive_sumo.core.suggestion import describe_unknown
from mdrive_sumo.scenario.weather import FrictionMode
from mdrive_sumo.sensing.sensing_profile import SensingProfile
from mdrive_sumo.v2x.attacks.attack_settings import NO_ATTACK, AttackKind, AttackSettings, parse_attack
from mdrive_sumo.v2x.comm_settings import PRESETS, CommSettings, format_comm_json, parse_comm
from mdrive_sumo.v2x.services.sending_rate import SendingRate


class StationIds(StrEnum):
    """Which ids agents, their messages and the privileged sensor contain."""

    RANDOM = auto()
    SCENARIO = auto()


class EpisodeArguments(TypedDict, total=False):
    """Keyword arguments of the Python front door; each means what the option of `mdrive-sumo eval` means."""

    comm: str | CommSettings
    agent_clock: str | Clock
    actors: str
    friction: str
    ids: str
    sensing: str
    attack: str
    v2x_rate: str


@dataclass(frozen=True, slots=True)
class EpisodeOptions:
    """Conditions of an episode that the user chooses besides scenario, agents and seed.

    They identify a run: journal, recordings and results hold them. A scalar setting is a field here, its place of use
    and, for type checkers, a line in `EpisodeArguments`; all else follows from the field (decision 072).
    """

    comm: CommSettings = setting(PRESETS["ideal"], typed="ideal", help="The V2X channel.", metavar="|".join(PRESETS))
    """Properties of the V2X channel."""
    clock: Clock = setting(
        IDEAL, key="agent_clock", typed="ideal", help="Cost of think time.", metavar="ideal|fixed:MS|measured"
    )
    """What an agent's think time costs."""
    actor_mode: ActorMode = setting(
        ActorMode.DEFAULT,
        key="actors",
        help="Scripted road users: reacting, on a global clock; or as in MDrive's own code.",
    )
    """Behaviour of the scripted actors."""
    friction: FrictionMode = setting(
        FrictionMode.DRY, help="Roads: dry in every weather; or wet in rain, for CAVs and SUMO's traffic."
    )
    """Road friction. Agents are not informed: the briefing states the limits of a dry road."""
    station_ids: StationIds = setting(
        StationIds.RANDOM,
        key="ids",
        absent="",
        help="Ids of CAVs and RSUs in agents and messages: random per episode, or the scenario's.",
    )
    """Ids that agents learn. Results and recordings always have the scenario's."""
    sensing: SensingProfile = setting(
        SensingProfile.REALISTIC,
        absent="",
        help="Own states and detections of CAVs and road-side units: with realistic errors; or exact.",
    )
    """Quality of own states and of the standard detector, the same for all stations."""
    attack: str = setting(
        NO_ATTACK,
        metavar="KIND[:OPTION=VALUE,...]",
        hides_default=True,
        help=f"Stations that lie: {', '.join(AttackKind)}; by=ID+ID, or share=PERCENT of among=cavs|rsus|all, names or"
        " draws them (one CAV by default). docs/attacks.md has the options of each kind.",
    )
    """The attack as text, see `v2x.attacks.attack_settings`; "none": every station sends what its agent sends."""
    v2x_rate: SendingRate = setting(
        SendingRate.FIXED,
        hides_default=True,
        help="When built-in agents and road-side units send: at 10 Hz (MCMs at 5 Hz); or by the rules of ETSI's"
        " services, with DENMs (the default with a radio, --comm its-g5 or lte-v2x).",
    )
    """When stations send CAMs, CPMs, MCMs and DENMs."""

    def __post_init__(self) -> None:
        attack = self.parsed_attack
        object.__setattr__(self, "attack", NO_ATTACK if attack is None else attack.text)

    @property
    def parsed_attack(self) -> AttackSettings | None:
        """The attack; None without one. Raises InputError for a text that names none."""
        return parse_attack(self.attack)

    @classmethod
    def parse(cls, **arguments: Unpack[EpisodeArguments]) -> "EpisodeOptions":
        """Return the options that texts or typed values stand for. Raises InputError, also for an unknown argument.

        With a radio, stations send by ETSI's rules unless `v2x_rate` is given.
        """
        values: dict[str, Any] = {**arguments}
        check_names(values, (one.key for one in list_settings(cls)))
        comm, clock = values.pop("comm", "ideal"), values.pop("agent_clock", IDEAL)
        if isinstance(comm, str):
            if comm not in PRESETS:
                raise InputError(f"comm: {describe_unknown(comm, PRESETS)}")
            comm = PRESETS[comm]
        if not isinstance(cast(object, comm), CommSettings):
            raise InputError(f"comm: expected one of {', '.join(PRESETS)} or CommSettings, found {comm!r:.40}")
        clock = parse_clock(clock) if isinstance(clock, str) else clock
        if not isinstance(cast(object, clock), Clock):
            raise InputError(f"agent_clock: expected ideal, fixed:MS, measured or a Clock, found {clock!r:.40}")
        scalars: dict[str, Any] = {one.field: one.parse(values[one.key]) for one in CONDITIONS if one.key in values}
        scalars.setdefault("v2x_rate", _choose_rate(comm))
        return cls(comm, clock, **scalars)

    def with_channel(self, comm: CommSettings) -> "EpisodeOptions":
        """Return the options over another channel, at the rate that goes with that one."""
        return replace(self, comm=comm, v2x_rate=_choose_rate(comm))

    def to_dict(self) -> dict[str, Scalar]:
        """Return the options as journal and recordings hold them; the inverse of `from_dict`."""
        values = ((condition, getattr(self, condition.field)) for condition in CONDITIONS)
        scalars = {one.key: one.write(value) for one, value in values if not one.is_hidden(value)}
        return {"comm": format_comm_json(self.comm), "agent_clock": self.clock.text, **scalars}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> "EpisodeOptions":
        """Return the options of a journal's fingerprint; a missing condition has its default.

        Raises KeyError, TypeError, ValueError or InputError for unusable values.
        """
        scalars: dict[str, Any] = {
            condition.field: condition.read(values[condition.key])
            for condition in CONDITIONS
            if condition.key in values
        }
        return cls(parse_comm(parse_json_object(values["comm"], "comm")), parse_clock(values["agent_clock"]), **scalars)


def _choose_rate(comm: CommSettings) -> SendingRate:
    """Return the rate that goes with a channel: what radios carry is sent by the rules that their load is made for."""
    return SendingRate.FIXED if comm.radio is None else SendingRate.ETSI


CONDITIONS: tuple[Setting, ...] = tuple(one for one in list_settings(EpisodeOptions) if one.is_scalar)
"""The settings that are choices, numbers, texts or flags: all but the channel and the clock."""
