"""RunConfig: one evaluation as the user asks for it, from the command line to the worker and the journal."""

import hashlib
import json
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice
from operator import index
from pathlib import Path
from typing import Any, SupportsIndex, Unpack, cast

from mdrive_sumo.agent_process.agent_connection import AgentLimits
from mdrive_sumo.core.clock import IDEAL
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.input_files import read_bytes
from mdrive_sumo.core.json_object import parse_json_object
from mdrive_sumo.core.setting import Scalar, check_names, list_settings, setting
from mdrive_sumo.episode.episode_options import CONDITIONS, EpisodeArguments, EpisodeOptions
from mdrive_sumo.loop.request_pace import MAX_PACE_S
from mdrive_sumo.runs.agent_spec import AgentFactory, AgentSpec, format_agent_limits, parse_agent_limits
from mdrive_sumo.runs.fingerprint_paths import restore_paths
from mdrive_sumo.runs.other_agents import OtherAgents, parse_other_agents
from mdrive_sumo.scenario.season import read_stored_name, write_stored_name
from mdrive_sumo.scoring import ScoreMode
from mdrive_sumo.v2x.comm_settings import PRESETS, CommSettings, format_comm_json

RUNS_FOLDER = Path("runs")
"""Where runs are kept that name no folder: below the folder in which the user works."""
ConfigValue = float | str | bool
MAX_SEEDS = 1000
"""Most seeds of a command; chosen: the 225 scenarios of `mdrive` then have 225 000 episodes."""
MAX_SEED = 2**31 - 1
"""Largest seed: that of SUMO, a signed number of 32 bits."""


class RunArguments(EpisodeArguments, total=False):
    """Keyword arguments of `evaluate`, which are the options of `mdrive-sumo eval`.

    These lines are for type checkers: names, defaults and checks are those of `RunConfig`, and a test compares both.
    """

    scenario: str
    agent_config: Mapping[str, ConfigValue] | None
    agent_limits: Mapping[str, float] | str | AgentLimits | None
    others: str | None
    penetration: int | None
    seeds: int | Iterable[int]
    pace_ms: float
    workers: int | None
    scheduler: str
    out: str | Path | None
    score_mode: str | None
    record: bool
    record_features: bool
    record_cameras: bool
    sandbox: bool
    fresh: bool
    fail_fast: bool


@dataclass(frozen=True, slots=True)
class RunConfig:
    """An evaluation: the scenarios of a suite that match a glob, driven by an agent, scored in a mode.

    The one model of a run's settings, with those of `AgentSpec`, `OtherAgents` and `EpisodeOptions`, in the order of
    `mdrive-sumo eval --help`. Options, arguments and identity derive from the fields (decision 072). What changes
    episodes and is no matter of agents, scenarios or seeds belongs to `EpisodeOptions`; results and reports list it.
    """

    suite: str = setting("interdrive", help="What to drive.", metavar="NAME|DIR")
    """Name of a packaged suite, with or without its season, or a folder."""
    scenario: str = setting("*", help="Only scenarios whose id or category matches; may be repeated.", metavar="GLOB")
    """Globs over ids and categories, with commas between them."""
    agent: AgentSpec = field(default_factory=lambda: AgentSpec("idm"))
    others: OtherAgents | None = None
    """A second agent, which drives the CAVs that are not under test; None: `agent` drives all."""
    options: EpisodeOptions = field(default_factory=EpisodeOptions)
    seeds: tuple[int, ...] = setting(
        (0,),
        typed=1,
        bounds=(1, MAX_SEEDS),
        help="Drive every scenario with so many seeds, --seed being the first; means have intervals.",
    )
    """All seeds; every scenario is driven with each."""
    pace_ms: float = setting(
        0.0,
        help="Send the requests of a tick so long after those of the one before, whatever the agents take: no agent"
        " then learns how long another one thinks. It changes no result. 0: as soon as all have answered.",
        option="--pace",
        unit="ms",
        bounds=(0, 1000 * MAX_PACE_S),
        is_identity=False,
    )
    """Time from the requests of a tick to those of the next one [ms]; 0: none. See `RequestPace`."""
    workers: int = setting(1, bounds=(1, None), is_identity=False)
    """Number of worker processes. Its option, `cli.options.workers_option`, is that of many commands."""
    scheduler: str = setting("", help="Address of the Dask scheduler.", metavar="tcp://HOST:PORT", is_identity=False)
    """Address of a Dask scheduler, whose workers then drive; "": own worker processes."""
    out: Path | None = setting(None, help="Run folder [default: runs/...].", metavar="DIR", is_identity=False)
    """The run folder; None: `default_folder`."""
    chosen_mode: ScoreMode | None = setting(None, key="score_mode", help="[default: that of the suite]")
    """The score mode; None: that of the suite, which `prepare` fills in."""
    record: bool = setting(True, help="Keep no recordings: no view, rescore, or verify of every tick.")
    """Whether recordings are kept."""
    record_features: bool = setting(
        True, help="Keep recordings without the content of `feature` messages.", is_identity=False
    )
    """Whether recordings have the content of `feature` messages; without it they are smaller."""
    record_cameras: bool = setting(
        False, help="Keep the colour images of the agent's cameras, for view: RUN/cameras.", is_identity=False
    )
    sandbox: bool = setting(
        False,
        help="Run a third-party agent in boxes without the suite's files; else results are labelled unsandboxed.",
    )
    """Whether a third-party agent runs in boxes, where it can read neither scenarios nor networks."""
    fresh: bool = setting(False, help="Start anew instead of continuing an interrupted run.", is_identity=False)
    """Whether what the folder holds is dropped instead of continued."""
    fail_fast: bool = setting(False, help="Stop at the first failure of the agent.", is_identity=False)
    """Whether the run stops at the first failure of an agent."""
    command: tuple[str, ...] = ()
    """The command as the user typed it, for the report."""

    @property
    def seed(self) -> int:
        """The first seed."""
        return self.seeds[0]

    @property
    def score_mode(self) -> ScoreMode:
        """The score mode; `mdrive` if none is chosen or filled in."""
        return self.chosen_mode or ScoreMode.MDRIVE

    @property
    def agents(self) -> tuple[AgentSpec, ...]:
        """All agents of the run, the one under test first."""
        return (self.agent, *((self.others.agent,) if self.others else ()))

    @property
    def agent_limits(self) -> str:
        """The time limits of the third-party agents as `--agent-limits` writes them; "" for the defaults."""
        return next(filter(None, (format_agent_limits(agent.limits) for agent in self.agents)), "")

    @property
    def is_builtin(self) -> bool:
        """Whether all agents are built in, so that none has a process, a log or code of its own."""
        return all(agent.is_builtin for agent in self.agents)

    @property
    def has_many_seeds(self) -> bool:
        """Whether episodes are named by their seeds, too."""
        return len(self.seeds) > 1

    def with_agent_limits(self, limits: AgentLimits) -> "RunConfig":
        """Return the run with these limits for its agents. Raises InputError if all of them are built in."""
        if self.is_builtin:
            return replace(self, agent=self.agent.with_limits(limits))
        others = self.others and replace(self.others, agent=replace(self.others.agent, limits=limits))
        return replace(self, agent=replace(self.agent, limits=limits), others=others)

    @classmethod
    def parse(
        cls, suite: str = "interdrive", agent: str | AgentFactory = "idm", **arguments: Unpack[RunArguments]
    ) -> "RunConfig":
        """Return the run that a user asks for, with texts or typed values. Raises InputError."""
        values: dict[str, Any] = {**arguments, "suite": suite}
        check_names(values, (one.key for one in list_settings(cls)))
        limits, agent_config = values.pop("agent_limits", None), values.pop("agent_config", None)
        parts: dict[str, Any] = {
            "agent": AgentSpec(agent, {} if agent_config is None else agent_config),
            "others": parse_other_agents(values.pop("others", None), values.pop("penetration", None)),
            "seeds": parse_seeds(values.pop("seeds", 1)),
            **{one.field: one.parse(values.pop(one.key)) for one in _OWN_SETTINGS if one.key in values},
        }
        config = cls(options=EpisodeOptions.parse(**values), **parts)
        check_agent_config(config.agent.config, "agent_config")
        if limits is None or (isinstance(limits, str) and not limits):
            return config
        return config.with_agent_limits(limits if isinstance(limits, AgentLimits) else parse_agent_limits(limits))

    def to_dict(self) -> dict[str, Scalar]:
        """Return what identifies the run, as the journal's fingerprint holds it. Raises InputError for no locator.

        Where it runs (`workers`, `scheduler`, `out`), when its requests go out (`pace_ms`) and how it was started
        (`fresh`, `fail_fast`, `command`) change no result, nor does what recordings keep for people to look at
        (`record_features`, `record_cameras`).
        """
        own = {one.key: one.write(getattr(self, one.field)) for one in _IDENTITY} | {"score_mode": str(self.score_mode)}
        kept = {key: own.pop(key) for key in ("record", "sandbox")}  # journals have them after the conditions
        return {
            "suite": write_stored_name(str(own.pop("suite"))),
            "scenario": own.pop("scenario"),
            "agent": self.agent.resolve().name,
            "agent_config": self.agent.config_text(),
            **({"agent_limits": self.agent_limits} if self.agent_limits else {}),
            **(self.others.to_dict() if self.others else {}),
            "seed": self.seed,
            **({"seeds": ",".join(map(str, self.seeds))} if self.has_many_seeds else {}),
            **own,
            **self.options.to_dict(),
            **kept,
        }

    @classmethod
    def from_journal(cls, values: Mapping[str, Any], folder: Path) -> "RunConfig":
        """Return the run of the fingerprint in a run folder, to which its paths are relative. Raises as `from_dict`."""
        return replace(cls.from_dict(restore_paths(values, folder)), out=folder)

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> "RunConfig":
        """Return the run of a fingerprint; a missing condition and a missing `sandbox` have their defaults.

        Raises KeyError, TypeError, ValueError and InputError for a corrupt one.
        """
        for key in ("agent", "agent_config", "agent_limits", "others", "seeds"):
            if not isinstance(values.get(key, ""), str):
                raise TypeError(f"{key}: expected a text, found {values[key]!r:.60}")
        own = {one.field: one.read(values[one.key]) for one in _IDENTITY if one.key in values or one.key not in _LATER}
        own["suite"] = read_stored_name(own["suite"])
        config = cls(
            agent=AgentSpec(values["agent"], parse_json_object(values["agent_config"], "agent_config")),
            others=OtherAgents.from_dict(values),
            options=EpisodeOptions.from_dict(values),
            seeds=_read_seeds(values["seed"], values.get("seeds", "")),
            **own,
        )
        limits = values.get("agent_limits", "")
        return config.with_agent_limits(parse_agent_limits(limits)) if limits else config

    def find_folder(self, suite_name: str) -> Path:
        """Return the run folder: the given one, else `default_folder`."""
        return self.out or self.default_folder(suite_name)

    def default_folder(self, suite_name: str) -> Path:
        """Return the folder of a run that names none: the same for the same run, another one for another."""
        others = self.others
        parts = [
            suite_name,
            _shorten_name(self.agent),
            f"with-{_shorten_name(others.agent)}" if others else "",
            f"{others.penetration}percent" if others and others.penetration is not None else "",
            _name_seeds(self.seeds),
            self.scenario if self.scenario != "*" else "",
            self.agent.config_hash()[7:13],
            self.agent_limits,
            _name_channel(self.options.comm),
            self.options.clock.text if self.options.clock != IDEAL else "",
            *(condition.name_value(getattr(self.options, condition.field)) for condition in CONDITIONS),
            self.score_mode if self.score_mode != ScoreMode.MDRIVE else "",
            *(one.name_value(getattr(self, one.field)) for one in _IDENTITY if one.key not in _NAMED),
        ]
        return RUNS_FOLDER / re.sub(r"[^A-Za-z0-9_.+-]+", "_", "-".join(part for part in parts if part))


_OWN_SETTINGS = tuple(one for one in list_settings(RunConfig) if one.owner is RunConfig and one.key != "seeds")
"""Settings that are fields of `RunConfig`, of which one argument gives the value."""
_IDENTITY = tuple(one for one in _OWN_SETTINGS if one.is_identity)
_LATER = ("sandbox",)
"""Settings that journals from before them lack."""
_NAMED = ("suite", "scenario", "score_mode")
"""Settings that the name of a folder has in a form and a place of their own."""


def _shorten_name(agent: AgentSpec) -> str:
    return re.sub(r"^.*/|\.py(?=:)", "", agent.name)


def read_seed(seed: SupportsIndex) -> int:
    """Return a seed as a Python integer; those of NumPy are taken, too. Raises InputError."""
    number = _read_integer("seed", seed)
    if not 0 <= number <= MAX_SEED:
        raise InputError(f"seed: expected an integer from 0 to {MAX_SEED}, found {number}")
    return number


def _read_integer(name: str, value: SupportsIndex) -> int:
    try:
        if not isinstance(value, bool):
            return index(value)
    except TypeError:
        pass
    raise InputError(f"{name}: expected an integer, found {value!r:.40}")


def parse_seeds(seeds: int | Iterable[int]) -> tuple[int, ...]:
    """Return the seeds of a number of them (3 means 0, 1 and 2), or of the seeds themselves. Raises InputError."""
    try:
        given: Iterator[int] = iter(cast(Iterable[int], seeds))
    except TypeError:  # a number, also one that NumPy holds in an array without dimensions
        given = iter(range(_read_integer("seeds", cast(int, seeds))))
    chosen = tuple(map(read_seed, islice(given, MAX_SEEDS + 1)))
    check_seeds(chosen)
    return chosen


def check_seeds(seeds: Sequence[int]) -> None:
    """Raise InputError unless there are 1 to `MAX_SEEDS` seeds and none twice."""
    if not seeds:
        raise InputError("seeds: expected at least one, found none")
    if len(seeds) > MAX_SEEDS:
        raise InputError(f"seeds: expected at most {MAX_SEEDS}, found more")
    if len(set(seeds)) < len(seeds):
        raise InputError(f"seeds: expected each once, found {', '.join(map(str, seeds))}")


def _read_seeds(first: object, text: str) -> tuple[int, ...]:
    """Return the seeds of a fingerprint. Raises TypeError and ValueError for a corrupt entry."""
    if type(first) is not int:
        raise TypeError(f"seed: expected a value of type int, found {first!r:.60}")
    seeds = tuple(int(part) for part in text.split(",")) if text else (first,)
    if seeds[0] != first or len(set(seeds)) < len(seeds):
        raise ValueError(f"seeds: expected different ones beginning with {first}, found {text!r:.60}")
    return seeds


def _name_seeds(seeds: tuple[int, ...]) -> str:
    """Return the seeds' part of a folder's name: seed0, seeds0-2 for a sequence, seeds0_3_7 for others."""
    if len(seeds) == 1:
        return f"seed{seeds[0]}"
    if seeds == tuple(range(seeds[0], seeds[0] + len(seeds))):
        return f"seeds{seeds[0]}-{seeds[-1]}"
    return "seeds" + "_".join(map(str, seeds))


def load_agent_config(path: Path) -> dict[str, ConfigValue]:
    """Read the options of an agent, a JSON object of finite numbers, strings and booleans. Raises InputError."""
    try:
        config = json.loads(read_bytes(path))
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: expected JSON, found none ({error})") from None
    if not isinstance(config, dict):
        raise InputError(f"{path}: expected a JSON object, found a {type(config).__name__}")
    check_agent_config(config, str(path))
    return config


def check_agent_config(config: Mapping[Any, Any], place: str) -> None:
    """Raise InputError unless all options of an agent are finite numbers, strings and booleans with names."""
    for key, value in config.items():
        if not isinstance(key, str):
            raise InputError(f"{place}: expected names of options, found {key!r:.40}")
        if not isinstance(value, int | ConfigValue) or (isinstance(value, float) and not math.isfinite(value)):
            raise InputError(f"{place}: {key}: expected a finite number, a string or a boolean, found {value!r:.40}")


def _name_channel(comm: CommSettings) -> str:
    """Return the channel's part of a folder's name: "" if ideal, a preset, or that and a checksum of the changes."""
    name = "" if comm.preset == "ideal" else comm.preset
    if comm == PRESETS.get(comm.preset):
        return name
    return (name or "comm") + hashlib.sha256(format_comm_json(comm).encode()).hexdigest()[:6]
