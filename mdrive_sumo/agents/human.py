"""`human` and `human-replay`: what the car of a person has on board, and which agents may drive it in between.

The controls come from elsewhere: see `mdrive_sumo.loop.human_driver`.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from mdrive_sumo.agents.registry import AGENTS, ASKING_AGENTS, HUMAN_AGENTS
from mdrive_sumo.contract import STANDSTILL, Agent, Briefing, Message, Observation, Reply, SensorSpec
from mdrive_sumo.contract.agent_options import Choice, Config, Option, read_choice, read_options
from mdrive_sumo.contract.human_options import DEVICES, HUMAN, HUMAN_REPLAY, SUBSTITUTES_OPTION, TAKE_OPTION
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.suggestion import suggest_name
from mdrive_sumo.planning.driving_options import DrivingOptions
from mdrive_sumo.v2x.awareness_service import AwarenessService

V2X = Choice("sharing", ("sharing", "off"))
"""What the car sends by itself: CAMs, CPMs and DENMs as `sharing` does, or nothing."""
DEVICE = Choice(DEVICES[0], DEVICES)
LATENCY_MS = Option(0, 0, 60_000)
"""[ms] Median time from an input to the tick that uses it, as measured."""
FREE_SPACE = "free_space"
"""The option of the objects sensor that adds something and changes nothing else."""


class HumanAgent:
    """A person at the wheel (`mdrive-sumo drive`); the car itself sends what `sharing` sends.

    Options: `substitutes` (built-in agents that may drive in between, with commas between them), `v2x`, and, as
    provenance, `device` and `latency_ms`.
    """

    name = HUMAN
    more_choices: Mapping[str, Choice] = {}
    """Options that a class adds."""

    def __init__(self, config: Config) -> None:
        choices = {"v2x": V2X, "device": DEVICE, SUBSTITUTES_OPTION: Choice("sharing", ()), **self.more_choices}
        read_options(self.name, config, {"latency_ms": LATENCY_MS}, choices)
        self.has_v2x = read_choice(self.name, config, "v2x", V2X) != "off"
        read_choice(self.name, config, "device", DEVICE)
        self.label = "sharing" if self.has_v2x else "single"
        self._options = DrivingOptions(self.name, {})
        self.substitutes = read_substitutes(self.name, config.get(SUBSTITUTES_OPTION, "sharing"))
        """The agents that may drive, by name."""
        self._sensors = join_sensors((self._options.build_sensor_spec(free_space=True),), self.substitutes)

    def sensors(self) -> tuple[SensorSpec, ...]:
        """Return the sensors on board, and those of every agent that may drive."""
        return self._sensors

    def start(self, briefing: Briefing) -> None:
        """Prepare the sending."""
        detector = self._options.find_detector(briefing)
        self._awareness = AwarenessService(briefing, self._options.find_range(briefing), detector)

    def act(self, seen: Observation) -> Reply:
        """Return what the car does without a driver: it stands, and sends."""
        return Reply(STANDSTILL, messages=self.compose_messages(seen))

    def compose_messages(self, seen: Observation) -> tuple[Message, ...]:
        """Return what the car sends by itself in this tick."""
        return self._awareness.compose_messages(seen) if self.has_v2x else ()

    def postpone_messages(self, tick: int) -> None:
        """Do not send before the next interval, because an agent that drives has sent in `tick`."""
        self._awareness.postpone(tick)

    def make_substitute(self, name: str, config: Config) -> Agent:
        """Return an agent that drives the car from now on. Raises InputError unless it may, with these options."""
        if name not in self.substitutes:
            known = ", ".join((HUMAN, *self.substitutes))
            raise InputError(
                f"agent {self.name}: expected a driver among {known} (option {SUBSTITUTES_OPTION}), found {name!r:.60}"
            )
        check_substitute_options(name, config)
        agent = AGENTS[name](config)
        for spec in agent.sensors():
            if spec not in self._sensors and _add_free_space(spec) not in self._sensors:
                raise InputError(
                    f"agent {self.name}: {name}: expected options that need no other sensors than it has without"
                    f" options, found {dict(config)!r:.120}"
                )
        return agent


class HumanReplayAgent(HumanAgent):
    """The recorded drive of a person as an agent: its controls and texts, tick by tick, of option `take`."""

    name = HUMAN_REPLAY
    more_choices: Mapping[str, Choice] = {TAKE_OPTION: Choice("", ())}


def read_substitutes(agent: str, text: object) -> tuple[str, ...]:
    """Return the names of an option `substitutes`. Raises InputError for one that may not drive."""
    names = tuple(filter(None, (part.strip() for part in text.split(",")))) if isinstance(text, str) else None
    place = f"agent {agent}: option {SUBSTITUTES_OPTION}"
    if names is None:
        raise InputError(f"{place}: expected names with commas between them, found {text!r:.60}")
    allowed = [name for name in AGENTS if name not in HUMAN_AGENTS and name not in ASKING_AGENTS]
    for name in names:
        if name in ASKING_AGENTS:
            raise InputError(f"{place}: expected agents without a language model, found {name!r}")
        if name not in allowed:
            raise InputError(
                f"{place}: expected built-in agents ({', '.join(allowed)}), found {name!r:.60}"
                f"{suggest_name(name, allowed)}"
            )
    return tuple(dict.fromkeys(names))


def check_substitute_options(name: str, config: Mapping[str, Any]) -> None:
    """Raise InputError for options that are no plain values: they may come from a stranger's recording.

    An option that names a file is none: a substitute reads nothing but what comes with this package.
    """
    for key, value in config.items():
        if key == "weights" or not isinstance(value, str | int | float):
            raise InputError(
                f"agent {name}: option {key!r:.40}: expected options that name no file in a car that a person drives,"
                f" found {value!r:.60}"
            )


def join_sensors(own: Sequence[SensorSpec], substitutes: Iterable[str]) -> tuple[SensorSpec, ...]:
    """Return the own sensors and those of agents, each once.

    A car has one sensor of each kind and id, so not every agent can drive it. Raises InputError for one whose sensor is
    another than that on board; more of free space on board changes nothing else.
    """
    joined = {(spec.kind, spec.id): spec for spec in own}
    for name in substitutes:
        for spec in AGENTS[name]({}).sensors():
            if joined.setdefault((spec.kind, spec.id), spec) not in (spec, _add_free_space(spec)):
                raise InputError(
                    f"option {SUBSTITUTES_OPTION}: expected agents that need no other sensor than is on board, found"
                    f" {name!r}, whose sensor {spec.kind!r} is another one"
                )
    return tuple(joined.values())


def _add_free_space(spec: SensorSpec) -> SensorSpec:
    return replace(spec, options={**spec.options, FREE_SPACE: True}) if FREE_SPACE in spec.options else spec
