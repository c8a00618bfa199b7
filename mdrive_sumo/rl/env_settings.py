"""EnvSettings: what an environment drives, sees, does and says; the same for every kind of environment."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from mdrive_sumo.agents.registry import AGENTS
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.seeding import derive_seed, draw_first_uniform
from mdrive_sumo.core.suggestion import describe_unknown
from mdrive_sumo.rl.curriculum import CurriculumStage, check_stage, read_stages
from mdrive_sumo.rl.grid_view import GRIDS
from mdrive_sumo.runs.run_config import read_seed

PRIVILEGED = "privileged"
VIEWS = ("own", PRIVILEGED)
"""What an observation is made of: what the CAV's own sensors tell, or the true state of everything."""
CONTROLS = ("pedals", "speed-offset", "targets", "anchors")
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
    suite: str
    """Name or folder of its suite."""


@dataclass(frozen=True)
class EnvSettings:
    """The settings of an environment. Raises InputError for one that does not exist."""

    suite: str = "interdrive@0"
    """Name or folder of the suite that the scenarios belong to."""
    scenarios: Sequence[str] = ()
    """Ids of the scenarios that episodes are drawn from; none: all of the suite."""
    density: Sequence[int] = ()
    """Least and greatest number of other road users in them; none: any."""
    curriculum: Sequence[Mapping[str, Any]] = ()
    """Stages with the fields of `CurriculumStage`, instead of these three."""
    view: str = "own"
    """One of `VIEWS`."""
    grid: str = ""
    """One of `GRIDS`, as the second part of an observation; "": none."""
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
        if self.grid not in ("", *GRIDS):
            raise InputError(f"environment: grid: {describe_unknown(str(self.grid), GRIDS)}")
        if self.others and self.others not in AGENTS:
            raise InputError(f"environment: others: {describe_unknown(self.others, AGENTS)}")
        _check_number("nearest", self.nearest, 0, MOST_NEAREST)
        _check_number("senders", self.senders, 0, MOST_NEAREST)
        _check_number("ticks_per_decision", self.ticks_per_decision, 1, 20)
        _check_number("learner", self.learner, 0, 63)
        if self.message_bytes != 0:
            _check_number("message_bytes", self.message_bytes, LEAST_MESSAGE_BYTES, MOST_MESSAGE_BYTES)
        check_stage(self.stages[0], "environment")

    @cached_property
    def stages(self) -> tuple[CurriculumStage, ...]:
        """The stages of the curriculum; one if there is none. Raises InputError."""
        if self.curriculum:
            return read_stages(self.curriculum)
        return (CurriculumStage(self.suite, self.scenarios, self.density),)

    def check_scenarios(self) -> None:
        """Load the scenarios of all stages. Raises InputError for one that does not exist or has no such learner."""
        for stage in self.stages:
            short = [name for name, egos in stage.cav_ids.items() if self.others and len(egos) <= self.learner]
            if short:
                raise InputError(
                    f"environment: learner: expected a CAV {self.learner} in each scenario, found none in {short[0]}"
                )

    @property
    def slots(self) -> int:
        """Number of learners of the scenario with the most of them."""
        return 1 if self.others else max(len(egos) for stage in self.stages for egos in stage.cav_ids.values())

    def choose_episode(self, seed: int, number: int, options: Mapping[str, Any]) -> EpisodeChoice:
        """Return episode `number` of a seed; `options` of a reset may name the `scenario`, or its `scenario_seed`.

        Other options are not ours (PettingZoo's own test sends one). Raises InputError.
        """
        stage = self.find_stage(number)
        ids = tuple(stage.cav_ids)
        drawn = ids[int(draw_first_uniform(seed, "rl-scenario", number) * len(ids))]
        scenario = options.get("scenario", drawn)
        owner = next((one for one in (stage, *self.stages) if scenario in one.cav_ids), None)
        if owner is None:
            raise InputError(f"reset: scenario: {describe_unknown(str(scenario), ids[:8])}")
        varied = derive_seed(seed, "rl-episode", str(number)) if self.vary else 0
        return EpisodeChoice(scenario, read_seed(options.get("scenario_seed", varied)), owner.suite)

    def find_stage(self, number: int) -> CurriculumStage:
        """Return the stage of episode `number` of a seed."""
        begin = 0
        for stage in self.stages[:-1]:
            begin += stage.episodes
            if number < begin:
                return stage
        return self.stages[-1]

    def find_cavs(self, episode: EpisodeChoice) -> tuple[str, ...]:
        """Return the ids of the CAVs of an episode's scenario, in the order of its file."""
        pools = (stage.cav_ids for stage in self.stages if stage.suite == episode.suite)
        return next(pool[episode.scenario] for pool in pools if episode.scenario in pool)


def _check_number(name: str, value: object, least: int, most: int) -> None:
    if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
        raise InputError(f"environment: {name}: expected an integer from {least} to {most}, found {value!r:.40}")
