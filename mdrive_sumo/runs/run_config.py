"""What a user asks of `eval`."""

import hashlib
import json
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from mdrive_sumo.actors import ActorMode
from mdrive_sumo.core.clock import IDEAL, Clock
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.scenario.weather import FrictionMode
from mdrive_sumo.scoring import ScoreMode
from mdrive_sumo.v2x.comm_settings import PRESETS, CommSettings, format_comm_json

Scalar = float | str | bool
RUNS_FOLDER = Path("runs")


@dataclass(frozen=True, slots=True)
class RunConfig:
    """An evaluation: scenarios of a suite that match a glob, driven by an agent, scored in a mode."""

    suite: str = "interdrive"
    """Name of a packaged suite, or a folder."""
    scenario: str = "*"
    agent: str = "idm"
    agent_config: Mapping[str, Scalar] = field(default_factory=dict[str, Scalar])
    seed: int = 0
    score_mode: ScoreMode = ScoreMode.MDRIVE
    comm: CommSettings = PRESETS["ideal"]
    clock: Clock = IDEAL
    actors: ActorMode = ActorMode.DEFAULT
    """How scripted road users behave."""
    friction: FrictionMode = FrictionMode.DRY
    """How slippery roads are."""
    record: bool = True
    workers: int = 1
    scheduler: str = ""
    """Address of a Dask scheduler, whose workers then drive; "": worker processes of our own."""
    out: Path | None = None
    """The run folder; None: `default_folder`."""
    fresh: bool = False
    """Start anew instead of continuing what the folder holds."""
    command: tuple[str, ...] = ()
    """As the user typed it, for the report."""


def load_agent_config(path: Path) -> dict[str, Scalar]:
    """Reads the options of an agent, a JSON object of numbers, strings and booleans; raises InputError."""
    try:
        config = json.loads(path.read_bytes())
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    except ValueError as error:
        raise InputError(f"{path}: expected JSON, found none ({error})") from None
    if not isinstance(config, dict):
        raise InputError(f"{path}: expected a JSON object, found a {type(config).__name__}")
    for key, value in config.items():
        if not isinstance(value, int | Scalar) or (isinstance(value, float) and not math.isfinite(value)):
            raise InputError(f"{path}: {key}: expected a finite number, a string or a boolean, found {value!r}")
    return config


def config_text(config: Mapping[str, Scalar]) -> str:
    """The options of an agent as canonical JSON."""
    return json.dumps(dict(config), sort_keys=True, separators=(",", ":"))


def config_hash(config: Mapping[str, Scalar]) -> str:
    """Checksum of an agent's options; "" if there are none."""
    return "sha256:" + hashlib.sha256(config_text(config).encode()).hexdigest() if config else ""


def default_folder(settings: RunConfig, suite_name: str) -> Path:
    """Where a run is kept that names no folder: the same for the same command, another one for another."""
    parts = [
        suite_name,
        re.sub(r"^.*/|\.py(?=:)", "", settings.agent),
        f"seed{settings.seed}",
        settings.scenario if settings.scenario != "*" else "",
        config_hash(settings.agent_config)[7:13],
        _comm_part(settings.comm),
        settings.clock.text if settings.clock != IDEAL else "",
        f"{settings.actors}-actors" if settings.actors != ActorMode.DEFAULT else "",
        f"{settings.friction}-friction" if settings.friction != FrictionMode.DRY else "",
        settings.score_mode if settings.score_mode != ScoreMode.MDRIVE else "",
        "" if settings.record else "norecord",
    ]
    return RUNS_FOLDER / re.sub(r"[^A-Za-z0-9_.+-]+", "_", "-".join(part for part in parts if part))


def _comm_part(comm: CommSettings) -> str:
    """The channel in a folder's name: "" if ideal, a preset's name, or that and a checksum of what was changed."""
    name = "" if comm.preset == "ideal" else comm.preset
    if comm == PRESETS.get(comm.preset):
        return name
    return (name or "comm") + hashlib.sha256(format_comm_json(comm).encode()).hexdigest()[:6]
