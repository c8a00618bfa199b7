"""AgentSpec: which agent drives, with which options and limits, and where it runs."""

import hashlib
import inspect
import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

from mdrive_sumo.agent_process.agent_connection import AgentLimits
from mdrive_sumo.agent_process.agent_file import drives_one_vehicle
from mdrive_sumo.agent_process.agent_lookup import (
    CARLA_PREFIX,
    CARLA_SINGLE_PREFIX,
    find_carla_file,
    find_module_file,
    split_locator,
)
from mdrive_sumo.agent_process.child_process import AgentBox
from mdrive_sumo.agents.registry import AGENTS, DETECTOR_AGENTS, LEARNED_AGENTS
from mdrive_sumo.contract import Agent
from mdrive_sumo.contract.human_options import HUMAN_REPLAY, TAKE_OPTION
from mdrive_sumo.core.checksum import compute_file_checksum, compute_files_checksum
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.plug_ins import PlugIn, PlugInKind, list_plug_ins
from mdrive_sumo.core.setting import setting
from mdrive_sumo.core.suggestion import suggest_name
from mdrive_sumo.runs.run_paths import EPISODES_FOLDER

LIMITS_OPTION = "--agent-limits"
LOCAL_LIMITS = AgentLimits(reply_bytes=2**20, episode_bytes=2**30, option=LIMITS_OPTION)
"""Limits of a user's own agent: as large as the contract allows, since notes alone may have 200 000 characters."""
LIMITED_TIMES = ("start", "tick", "episode")
"""Names of the time limits, each of them a field of AgentLimits with `_s` behind it."""
DEFAULT_TIMES = ",".join(f"{name}={getattr(LOCAL_LIMITS, f'{name}_s'):g}" for name in LIMITED_TIMES)
SHORTEST_S, LONGEST_S = 0.01, 7 * 86_400.0
"""A hundredth of a second is about the time of one answer of an agent that does nothing; a week ends every job."""


def parse_agent_limits(text: str | Mapping[str, float]) -> AgentLimits:
    """Return the limits that the option sets; those that it does not name keep their defaults. Raises InputError.

    text: `start=600,tick=30,episode=7200` in any order, or the same as a mapping [s].
    """
    if not isinstance(cast(object, text), str | Mapping):
        raise InputError(f"{LIMITS_OPTION}: expected a text or a mapping of seconds, found {text!r:.40}")
    pairs = _split_limits(text) if isinstance(text, str) else [(str(name), str(one)) for name, one in text.items()]
    times: dict[str, float] = {}
    for name, value in pairs:
        if name not in LIMITED_TIMES:
            names = ", ".join(LIMITED_TIMES)
            raise InputError(
                f"{LIMITS_OPTION}: expected one of {names}, found {name!r:.40}{suggest_name(name, LIMITED_TIMES)}"
            )
        if f"{name}_s" in times:
            raise InputError(f"{LIMITS_OPTION}: {name}: expected it once, found it twice")
        times[f"{name}_s"] = _parse_seconds(name, value)
    limits = replace(LOCAL_LIMITS, **times)
    if limits.episode_s < limits.tick_s:
        raise InputError(
            f"{LIMITS_OPTION}: episode: expected at least the {limits.tick_s:g} s of a tick, found"
            f" {limits.episode_s:g} s; add episode=SECONDS, the time for all answers of an episode"
        )
    return limits


def format_agent_limits(limits: AgentLimits) -> str:
    """Return the times that are not the defaults, in the form that `parse_agent_limits` reads; "" if all are."""
    values = {name: (getattr(limits, f"{name}_s"), getattr(LOCAL_LIMITS, f"{name}_s")) for name in LIMITED_TIMES}
    return ",".join(f"{name}={value!r}".removesuffix(".0") for name, (value, usual) in values.items() if value != usual)


def _split_limits(text: str) -> list[tuple[str, str]]:
    pairs = [part.partition("=") for part in text.split(",")]
    if any(not sign for _, sign, _ in pairs):
        raise InputError(f"{LIMITS_OPTION}: expected start=SECONDS,tick=SECONDS,episode=SECONDS, found {text!r:.80}")
    return [(name.strip(), value.strip()) for name, _, value in pairs]


def _parse_seconds(name: str, value: str) -> float:
    try:
        seconds = float(value)
    except ValueError:
        seconds = math.nan
    if not SHORTEST_S <= seconds <= LONGEST_S:
        raise InputError(
            f"{LIMITS_OPTION}: {name}: expected {SHORTEST_S:g} to {LONGEST_S:.0f} seconds, found {value!r:.40}"
        )
    return seconds


AgentFactory = Callable[[Mapping[str, Any]], Agent]


@dataclass(frozen=True, slots=True)
class AgentSpec:
    """One agent, of which every CAV gets an instance. It can be pickled even if its class is defined in a notebook."""

    agent: str | AgentFactory = setting(
        typed="idm",
        help="The agent; every CAV gets an instance of it.",
        metavar="NAME|module:Class|path.py:Class|carla:path.py",
    )
    """Built-in name, `module:Class`, `path.py:Class`, `carla:path.py`, or the class itself."""
    config: Mapping[str, Any] = setting(
        factory=dict[str, Any], key="agent_config", metavar="FILE", help="Options of the agent, a JSON object."
    )
    """Options: finite numbers, strings and booleans."""
    limits: AgentLimits = setting(
        LOCAL_LIMITS,
        key="agent_limits",
        metavar="start=S,tick=S,episode=S",
        help="Seconds that a third-party agent may take to be created, for one answer, and for all answers of an"
        f" episode [default: {DEFAULT_TIMES}].",
    )
    box: AgentBox | None = None
    """Sandbox of a third-party agent; None: a plain child process. Built-in agents run in the worker process."""
    known_as: str = ""
    """The agent as the user typed it, if `agent` is its place in the box."""

    def __post_init__(self) -> None:
        """Raises InputError for what can be no agent."""
        if not isinstance(self.agent, str) and not callable(self.agent):
            raise InputError(
                f"agent: expected a name ({next(iter(AGENTS))}, idm, ...), module:Class, path.py:Class or a class,"
                f" found {self.agent!r:.40}"
            )
        if not isinstance(cast(object, self.config), Mapping):
            raise InputError(f"agent_config: expected a mapping of options, found {self.config!r:.40}")

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle a class by value: a worker process cannot import what a notebook defines."""
        if isinstance(self.agent, str):
            return AgentSpec, (self.agent, dict(self.config), self.limits, self.box, self.known_as)
        return _restore, (pickle_agent(self.agent), dict(self.config), self.limits, self.box, self.known_as)

    @property
    def name(self) -> str:
        """The agent as text: what the user typed, or `module:Class` of a class."""
        if isinstance(self.agent, str):
            return self.known_as or self.agent
        return f"{self.agent.__module__}:{getattr(self.agent, '__qualname__', type(self.agent).__qualname__)}"

    @property
    def plug_in(self) -> PlugIn | None:
        """The entry point of another package that `agent` names, if it does."""
        plug_ins = list_plug_ins(PlugInKind.AGENTS) if isinstance(self.agent, str) and not self.is_builtin else {}
        return plug_ins.get(self.known_as or str(self.agent))

    @property
    def is_builtin(self) -> bool:
        """Whether it is one of `agents.AGENTS`, which run in the worker process."""
        return isinstance(self.agent, str) and self.agent in AGENTS

    @property
    def is_learned(self) -> bool:
        """Whether it is a built-in agent that ONNX Runtime computes for."""
        return isinstance(self.agent, str) and (self.agent in LEARNED_AGENTS or self.agent in DETECTOR_AGENTS)

    def with_pace(self, pace_s: float) -> "AgentSpec":
        """Return the agent as it is asked in a run with a pace; 0: none."""
        return replace(self, limits=replace(self.limits, pace_s=pace_s))

    def with_limits(self, limits: AgentLimits) -> "AgentSpec":
        """Return the agent with other limits. Raises InputError for a built-in agent, which has none."""
        if self.is_builtin and format_agent_limits(limits):
            raise InputError(
                f"{LIMITS_OPTION}: expected an agent of a file or module, found {self.name}, which is built in"
            )
        return replace(self, limits=limits)

    def resolve(self) -> "AgentSpec":
        """Return the agent as any process finds it: the path of a file is absolute. Raises InputError.

        It also says of a CARLA leaderboard agent whether it drives one vehicle or all of them.
        """
        if not isinstance(self.agent, str) or self.is_builtin:
            return self
        if (file := find_carla_file(self.agent)) is not None:
            is_single = self.agent.startswith(CARLA_SINGLE_PREFIX) or drives_one_vehicle(file)
            return replace(self, agent=f"{CARLA_SINGLE_PREFIX if is_single else CARLA_PREFIX}{file.resolve()}")
        if (plug_in := self.plug_in) is not None:
            return replace(self, agent=plug_in.locator, known_as=plug_in.name)
        place, name = split_locator(self.agent)
        return replace(self, agent=f"{Path(place).resolve()}:{name}") if place.endswith(".py") else self

    def own_signals(self) -> "AgentSpec":
        """Return the agent for a repeated run, in which each signal that ends its box is its own failure."""
        return self if self.box is None else replace(self, box=replace(self.box, owns_signals=True))

    def config_text(self) -> str:
        """Return the options as canonical JSON."""
        return json.dumps(dict(self.config), sort_keys=True, separators=(",", ":"))

    def config_hash(self) -> str:
        """Return the checksum of the options and of the files that they name; "" if there are none.

        Where the files are does not count: a run that is copied to another machine has the same.
        """
        files = self._list_option_files()
        named = {name: Path(value).name if name in files else value for name, value in self.config.items()}
        text = replace(self, config=named).config_text() + self.files_checksum()
        return "sha256:" + hashlib.sha256(text.encode()).hexdigest() if self.config else ""

    def files_checksum(self) -> str:
        """Return the checksum of the files that options name, such as weights; "" if they name none."""
        named = self._list_option_files()
        files = {f"{name}{place}": path for name, found in named.items() for place, path in found.items()}
        return compute_files_checksum(files) if files else ""

    def _list_option_files(self) -> dict[str, dict[str, Path]]:
        """Return the files that options name, by option and place: "" for the file itself; of a take its recordings,
        of a detector its encoder."""
        files = {name: {"": Path(value)} for name, value in self.config.items() if _is_file(value)}
        if files and isinstance(self.agent, str) and self.agent in DETECTOR_AGENTS:
            from mdrive_sumo.agents.learned.model_weights import find_encoder  # here: jobs of others do not need it

            for found in files.values():
                encoder = find_encoder(found[""])
                found |= {"/encoder": encoder} if encoder.is_file() else {}
        take = self.config.get(TAKE_OPTION)
        if self.agent == HUMAN_REPLAY and isinstance(take, str) and "\0" not in take:
            recordings = sorted((Path(take) / EPISODES_FOLDER).glob("*.npz"))
            files[TAKE_OPTION] = {f"/{path.name}": path for path in recordings}
        return files

    def code_checksum(self) -> str:
        """Return the checksum of the agent's source; "" for a built-in agent.

        It covers one file, not what that imports. No code of the agent runs. Raises InputError.
        """
        if self.is_builtin:
            return ""
        if not isinstance(self.agent, str):
            return "sha256:" + hashlib.sha256(_read_source(self.agent).encode()).hexdigest()
        if (file := self.find_file()) is not None:
            return compute_file_checksum(file) if file.is_file() else ""
        file = find_module_file(split_locator(str(self.resolve().agent))[0])
        return compute_file_checksum(file) if file else ""

    def find_file(self) -> Path | None:
        """Return the file that `path.py:Class` or `carla:path.py` names; None for other agents. Raises InputError."""
        if not isinstance(self.agent, str) or self.is_builtin or self.plug_in is not None:
            return None
        if (file := find_carla_file(self.agent)) is not None:
            return file
        place, _ = split_locator(self.agent)
        return Path(place) if place.endswith(".py") else None


def _is_file(value: Any) -> bool:
    """Return whether an option's value names a file; a path that the system cannot have names none."""
    try:
        return isinstance(value, str) and Path(value).is_file()
    except OSError:
        return False


def pickle_agent(agent: AgentFactory) -> bytes:
    """Return an agent's class as bytes, by value where it is defined in a notebook or a script."""
    import cloudpickle  # only here: no other command needs it

    return cloudpickle.dumps(agent)


def _restore(agent: bytes, *rest: Any) -> AgentSpec:
    import cloudpickle

    return AgentSpec(cloudpickle.loads(agent), *rest)


def _read_source(agent: AgentFactory) -> str:
    """Return the source of a class by its methods: Python 3.11 finds that of a notebook's class in no other way."""
    methods = [value for _, value in sorted(vars(agent).items()) if inspect.isfunction(value)]
    try:
        return "\n".join(inspect.getsource(method) for method in methods)
    except OSError:  # typed into an interpreter that keeps no source: the bytecode stands for it
        return "\n".join(f"{method.__qualname__} {method.__code__.co_code.hex()}" for method in methods)
