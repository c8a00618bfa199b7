"""RunConfig: one evaluation as the user asks for it, from the command line to the worker and the journal."""

import hashlib
import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from mdrive_sumo.agent_process.agent_connection import AgentLimits
from mdrive_sumo.core.clock import IDEAL
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.input_files import read_bytes
from mdrive_sumo.loop import EpisodeOptions
from mdrive_sumo.runs.agent_limits import format_agent_limits, parse_agent_limits
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.fingerprint_paths import restore_paths
from mdrive_sumo.runs.other_agents import OtherAgents
from mdrive_sumo.scoring import ScoreMode
from mdrive_sumo.v2x.comm_settings import PRESETS, CommSettings, format_comm_json

ConfigValue = float | str | bool
RUNS_FOLDER = Path("runs")
FINGERPRINT_TYPES = {
    **dict.fromkeys(
        ("suite", "scenario", "agent", "agent_config", "agent_limits", "score_mode", "seeds", "others"), str
    ),
    **dict.fromkeys(("seed", "penetration"), int),
    **dict.fromkeys(("record", "sandbox"), bool),
}
"""Types of the values of a fingerprint that a stranger's journal may hold otherwise."""


@dataclass(frozen=True, slots=True)
class RunConfig:
    """An evaluation: the scenarios of a suite that match a glob, driven by an agent, scored in a mode."""

    suite: str = "interdrive"
    """Name of a packaged suite, or a folder."""
    scenario: str = "*"
    agent: AgentSpec = field(default_factory=lambda: AgentSpec("idm"))
    others: OtherAgents | None = None
    """A second agent, which drives the CAVs that are not under test; None: `agent` drives all."""
    seed: int = 0
    """The first seed."""
    more_seeds: tuple[int, ...] = ()
    """The other seeds of a run of several."""
    chosen_mode: ScoreMode | None = None
    """The score mode; None: that of the suite, which `prepare` fills in."""
    options: EpisodeOptions = field(default_factory=EpisodeOptions)
    record: bool = True
    sandbox: bool = False
    """Whether a third-party agent runs in boxes, where it can read neither scenarios nor networks."""
    pace_s: float = 0.0
    """Time from the requests of a tick to those of the next one; 0: none. See `RequestPace`."""
    workers: int = 1
    scheduler: str = ""
    """Address of a Dask scheduler, whose workers then drive; "": own worker processes."""
    out: Path | None = None
    """The run folder; None: `default_folder`."""
    fresh: bool = False
    """Start anew instead of continuing what the folder holds."""
    fail_fast: bool = False
    """Stop at the first failure of an agent."""
    record_cameras: bool = False
    """Keep the camera images that agents are given."""
    command: tuple[str, ...] = ()
    """The command as the user typed it, for the report."""

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
    def seeds(self) -> tuple[int, ...]:
        """All seeds; every scenario is driven with each."""
        return (self.seed, *self.more_seeds)

    def with_agent_limits(self, limits: AgentLimits) -> "RunConfig":
        """Return the run with these limits for its agents. Raises InputError if all of them are built in."""
        if self.is_builtin:
            return replace(self, agent=self.agent.with_limits(limits))
        others = self.others and replace(self.others, agent=replace(self.others.agent, limits=limits))
        return replace(self, agent=replace(self.agent, limits=limits), others=others)

    def to_dict(self) -> dict[str, str | int | bool]:
        """Return what identifies the run, as the journal's fingerprint holds it. Raises InputError for no locator.

        Where it runs (`workers`, `scheduler`, `out`), when its requests go out (`pace_s`) and how it was started
        (`fresh`, `fail_fast`, `command`) change no result, nor do images for people to look at (`record_cameras`).
        """
        return {
            "suite": self.suite,
            "scenario": self.scenario,
            "agent": self.agent.resolve().name,
            "agent_config": self.agent.config_text(),
            **({"agent_limits": self.agent_limits} if self.agent_limits else {}),
            **(_describe_others(self.others) if self.others else {}),
            "seed": self.seed,
            **({"seeds": ",".join(map(str, self.seeds))} if self.more_seeds else {}),
            "score_mode": str(self.score_mode),
            **self.options.to_dict(),
            "record": self.record,
            "sandbox": self.sandbox,
        }

    @classmethod
    def from_journal(cls, values: Mapping[str, Any], folder: Path) -> "RunConfig":
        """Return the run of the fingerprint in a run folder, to which its paths are relative. Raises as `from_dict`."""
        return replace(cls.from_dict(restore_paths(values, folder)), out=folder)

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> "RunConfig":
        """Return the run of a fingerprint. Raises KeyError, TypeError, ValueError and InputError for a corrupt one."""
        for name, kind in FINGERPRINT_TYPES.items():
            if type(values.get(name, kind())) is not kind:
                raise TypeError(f"{name}: expected a value of type {kind.__name__}, found {values[name]!r:.60}")
        config = cls(
            suite=values["suite"],
            scenario=values["scenario"],
            agent=AgentSpec(values["agent"], json.loads(values["agent_config"])),
            others=_read_others(values),
            seed=values["seed"],
            more_seeds=_parse_more_seeds(values["seed"], values.get("seeds", "")),
            chosen_mode=ScoreMode(values["score_mode"]),
            options=EpisodeOptions.from_dict(values),
            record=values["record"],
            sandbox=values.get("sandbox", False),
        )
        limits = values.get("agent_limits", "")
        return config.with_agent_limits(parse_agent_limits(limits)) if limits else config

    def find_folder(self, suite_name: str) -> Path:
        """Return the run folder: the given one, else `default_folder`."""
        return self.out or self.default_folder(suite_name)

    def default_folder(self, suite_name: str) -> Path:
        """Return the folder of a run that names none: the same for the same run, another one for another."""
        chosen, default = self.options.to_dict(), EpisodeOptions().to_dict()
        parts = [
            suite_name,
            _shorten_name(self.agent),
            *((f"with-{_shorten_name(self.others.agent)}",) if self.others else ()),
            f"{self.others.penetration}percent" if self.others and self.others.penetration is not None else "",
            _name_seeds(self.seeds),
            self.scenario if self.scenario != "*" else "",
            self.agent.config_hash()[7:13],
            self.agent_limits,
            _name_channel(self.options.comm),
            self.options.clock.text if self.options.clock != IDEAL else "",
            *(f"{chosen[key]}-{key}" for key in EpisodeOptions.list_choices() if chosen[key] != default[key]),
            self.score_mode if self.score_mode != ScoreMode.MDRIVE else "",
            "" if self.record else "norecord",
            "sandbox" if self.sandbox else "",
        ]
        return RUNS_FOLDER / re.sub(r"[^A-Za-z0-9_.+-]+", "_", "-".join(part for part in parts if part))


def _shorten_name(agent: AgentSpec) -> str:
    return re.sub(r"^.*/|\.py(?=:)", "", agent.name)


def _describe_others(others: OtherAgents) -> dict[str, str | int]:
    penetration = {} if others.penetration is None else {"penetration": others.penetration}
    return {"others": others.agent.resolve().name, **penetration}


def _read_others(values: Mapping[str, Any]) -> OtherAgents | None:
    return OtherAgents(AgentSpec(values["others"]), values.get("penetration")) if "others" in values else None


def check_seeds(seeds: Sequence[int]) -> None:
    """Raise InputError unless there is at least one seed and none twice."""
    if not seeds:
        raise InputError("seeds: expected at least one, found none")
    if len(set(seeds)) < len(seeds):
        raise InputError(f"seeds: expected each once, found {', '.join(map(str, seeds))}")


def _parse_more_seeds(seed: int, text: str) -> tuple[int, ...]:
    """Return the seeds of a fingerprint after the first. Raises ValueError for a corrupt entry."""
    seeds = [int(part) for part in text.split(",")] if text else [seed]
    if seeds[0] != seed or len(set(seeds)) < len(seeds):
        raise ValueError(f"seeds: expected different ones beginning with {seed}, found {text!r:.60}")
    return tuple(seeds[1:])


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
    for key, value in config.items():
        if not isinstance(value, int | ConfigValue) or (isinstance(value, float) and not math.isfinite(value)):
            raise InputError(f"{path}: {key}: expected a finite number, a string or a boolean, found {value!r}")
    return config


def _name_channel(comm: CommSettings) -> str:
    """Return the channel's part of a folder's name: "" if ideal, a preset, or that and a checksum of the changes."""
    name = "" if comm.preset == "ideal" else comm.preset
    if comm == PRESETS.get(comm.preset):
        return name
    return (name or "comm") + hashlib.sha256(format_comm_json(comm).encode()).hexdigest()[:6]
