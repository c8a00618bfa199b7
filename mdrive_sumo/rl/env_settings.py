"""EnvSettings: what an environment drives, sees, does and says; the same for every kind of environment."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, cast

from mdrive_sumo.agents.registry import AGENTS
from mdrive_sumo.api.scenario_source import find_scenario
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.seeding import derive_seed, draw_first_uniform
from mdrive_sumo.core.suggestion import describe_unknown
from mdrive_sumo.runs.run_config import read_seed
from mdrive_sumo.scenario.suite import load_suite

PRIVILEGED = "privileged"
VIEWS = ("own", PRIVILEGED)
"""What an observation is made of: what the CAV's own sensors tell, or the true state of everything."""
CONTROLS = ("pedals", "speed-offset", "anchors")
"""What an action is, see `driving_actions`."""
LEAST_MESSAGE_BYTES, MOST_MESSAGE_BYTES = 16, 256
"""Size of a message of a policy. Chosen: 16 bytes are half a CAM, 256 twelve objects of a CPM."""
MOST_NEAREST = 64
"""Chosen: 84 background vehicles are the densest traffic of the suites, and no policy needs all of them."""


@dataclass(frozen=True, slots=True)
class EpisodeChoice:
    """Which episode an environment drives next."""

    scenario: str
    """Id of the scenario."""
    seed: int
    """Seed of the run; 0 is the scenario as written."""


@dataclass(frozen=True)
class EnvSettings:
    """The settings of an environment. Raises InputError for one that does not exist."""

    suite: str = "interdrive@0"
    """Name or folder of the suite that the scenarios belong to."""
    scenarios: Sequence[str] = ()
    """Ids of the scenarios that episodes are drawn from; none: all of the suite."""
    view: str = "own"
    """One of `VIEWS`."""
    control: str = "pedals"
    """One of `CONTROLS`."""
    nearest: int = 8
    """Number of road users in an observation, the nearest ones."""
    message_bytes: int = 0
    """Length of the message that is part of an action; 0: policies do not talk."""
    senders: int = 3
    """Number of other CAVs whose latest message is in an observation."""
    ticks_per_decision: int = 4
    """Ticks of 0.05 s that an action lasts; 4: 5 Hz."""
    others: str = ""
    """Built-in agent that drives the CAVs that are no learner; "" if all learn."""
    learner: int = 0
    """Place of the only learner in the order of the scenario file, if there are `others`."""
    vary: bool = True
    """Whether each episode has a seed of its own; else every one is the scenario as written."""
    options: Mapping[str, Any] = field(default_factory=dict[str, Any])
    """Conditions of the episodes as for `md.simulate`: `comm`, `sensing`, `attack`, ..."""

    def __post_init__(self) -> None:
        for name, known in (("view", VIEWS), ("control", CONTROLS)):
            if getattr(self, name) not in known:
                raise InputError(f"environment: {name}: {describe_unknown(str(getattr(self, name)), known)}")
        if self.others and self.others not in AGENTS:
            raise InputError(f"environment: others: {describe_unknown(self.others, AGENTS)}")
        _check_number("nearest", self.nearest, 0, MOST_NEAREST)
        _check_number("senders", self.senders, 0, MOST_NEAREST)
        _check_number("ticks_per_decision", self.ticks_per_decision, 1, 20)
        _check_number("learner", self.learner, 0, 63)
        if self.message_bytes != 0:
            _check_number("message_bytes", self.message_bytes, LEAST_MESSAGE_BYTES, MOST_MESSAGE_BYTES)
        if isinstance(cast(object, self.scenarios), str):
            raise InputError(f"environment: scenarios: expected a list of ids, found the text {self.scenarios!r:.40}")

    @cached_property
    def cav_ids(self) -> Mapping[str, tuple[str, ...]]:
        """Ids of the CAVs by id of scenario, both in the order of the files. Raises InputError."""
        suite = load_suite(self.suite)
        written = [find_scenario(one, suite).scenario for one in self.scenarios] or list(suite)
        cav_ids = {one.id: tuple(ego.id for ego in one.egos) for one in written}
        short = [name for name, egos in cav_ids.items() if self.others and len(egos) <= self.learner]
        if short:
            raise InputError(
                f"environment: learner: expected a CAV {self.learner} in each scenario, found none in {short[0]}"
            )
        return cav_ids

    @property
    def slots(self) -> int:
        """Number of learners of the scenario with the most of them."""
        return 1 if self.others else max(map(len, self.cav_ids.values()))

    def choose_episode(self, seed: int, number: int, options: Mapping[str, Any]) -> EpisodeChoice:
        """Return episode `number` of a seed; `options` of a reset may name the `scenario`, or its `scenario_seed`.

        Other options are not ours (PettingZoo's own test sends one). Raises InputError.
        """
        ids = tuple(self.cav_ids)
        drawn = ids[int(draw_first_uniform(seed, "rl-scenario", number) * len(ids))]
        scenario = options.get("scenario", drawn)
        if scenario not in self.cav_ids:
            raise InputError(f"reset: scenario: {describe_unknown(str(scenario), ids[:8])}")
        varied = derive_seed(seed, "rl-episode", str(number)) if self.vary else 0
        return EpisodeChoice(scenario, read_seed(options.get("scenario_seed", varied)))


def _check_number(name: str, value: object, least: int, most: int) -> None:
    if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
        raise InputError(f"environment: {name}: expected an integer from {least} to {most}, found {value!r:.40}")
