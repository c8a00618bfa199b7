"""Settings of a server: a TOML file overridden by environment variables, validated before anything starts.

`MDRIVE_DATA=/srv/mdrive` sets `data`, `MDRIVE_LIMITS__ARCHIVE_BYTES=1000` sets `archive_bytes` of `[limits]`.
"""

import os
import tomllib
from collections.abc import Mapping
from dataclasses import fields
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import AwareDatetime, BaseModel, ConfigDict, Field, ValidationError, model_validator

from mdrive_sumo.agent_process.agent_connection import AgentLimits as ConnectionLimits
from mdrive_sumo.agent_process.sandbox.kernel_trial import choose_backend
from mdrive_sumo.agent_process.sandbox.limits import BoxLimits
from mdrive_sumo.agent_process.sandbox.private_files import MEMORY
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.input_files import read_text
from mdrive_sumo.loop.request_pace import MAX_PACE_S
from mdrive_sumo.scenario.scenario import describe_first_error
from server.store.phases import NewPhase
from server.store.retention import RetentionPolicy

Count = Annotated[int, Field(ge=1)]


class SettingsModel(BaseModel):
    """Base class of all sections."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class PhaseSettings(SettingsModel):
    """One `[[phases]]` section."""

    id: Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9-]{0,39}$")]
    title: Annotated[str, Field(min_length=1, max_length=120)]
    suite: Annotated[str, Field(min_length=1)]
    """A packaged suite's name, without a season season 0, or a folder on this machine."""
    public: bool
    """False: the scenarios are hidden; only aggregates are shown."""
    packaged_suite: bool = False
    """Whether a hidden phase may have scenarios of a packaged suite, which everyone can read: for trials."""
    opens: AwareDatetime
    closes: AwareDatetime
    per_day: Count = 10
    in_parallel: Count = 1
    in_total: Count = 1000
    seeds: Count = 1
    sensor_track_only: bool = False
    """Whether agents that are given lists of objects (docs/sensors.md, sensor track) are rejected."""
    cross_play_scenarios: Annotated[int, Field(ge=0, le=50)] = 0
    """Scenarios that each pair of ranked agents drives together for the board of cross-play; 0: no such board."""

    @model_validator(mode="after")
    def _has_a_length(self) -> Self:
        if self.closes <= self.opens:
            raise ValueError(f"closes: expected a time after opens {self.opens}, found {self.closes}")
        return self

    def as_new(self) -> NewPhase:
        """Return the phase for the store."""
        copied = self.model_dump(exclude={"opens", "closes", "packaged_suite"})
        return NewPhase(opens_us=_to_us(self.opens), closes_us=_to_us(self.closes), **copied)


WARM_UP = PhaseSettings(
    id="warm-up",
    title="Warm-up",
    suite="interdrive@0",
    public=True,
    opens=datetime(2026, 1, 1, tzinfo=UTC),
    closes=datetime(2100, 1, 1, tzinfo=UTC),
    per_day=100,
)
"""Default phase of `mdrive-sumo serve` without settings."""


def _to_us(moment: datetime) -> int:
    return int(moment.timestamp()) * 1_000_000


PREFIX = "MDRIVE_"
OTHER_VARIABLES = ("MDRIVE_STRICT_SKIPS", "MDRIVE_SETTINGS", "MDRIVE_TOKEN", "MDRIVE_SERVER")
"""Variables of this project that are not server settings."""

_BOX = BoxLimits()
_LINE = ConnectionLimits()
_POLICY = RetentionPolicy()


class ArchiveSettings(SettingsModel):
    """Limits of an archive."""

    archive_bytes: Count = 64 * 2**20
    unpacked_bytes: Count = 256 * 2**20
    entries: Count = 2000
    ratio: Count = 200
    """Unpacked size over packed size of each entry above 1 MiB."""
    total_ratio: Count = 50
    """Unpacked size over packed size of the whole archive above 8 MiB: bounds the work of a check by the upload."""
    check_s: Annotated[float, Field(gt=0)] = 20.0
    """Time limit of the check of one archive [s]."""
    refused_per_day: Count = 20
    """Archives of a team that are examined and refused, per UTC day."""
    start_agents: bool = True
    """Start each uploaded agent once in a sandbox, where this machine runs agents, to refuse its sensors at once."""

    def archive_fields(self) -> dict[str, int]:
        """Return the fields of `server.archive.ArchiveLimits`."""
        return self.model_dump(exclude={"check_s", "refused_per_day", "start_agents"})


class SandboxSettings(SettingsModel):
    """Sandboxes of the agents. The limits are those of `mdrive_sumo.agent_process.sandbox.BoxLimits`."""

    backend: Literal["auto", "bubblewrap", "gvisor"] = "auto"
    """auto: on each machine gVisor, a kernel for each box, where its trial succeeds, else bubblewrap."""
    hidden_on_shared_kernel: bool = False
    """Whether jobs of hidden phases may run in boxes that share the host's kernel (bubblewrap)."""
    required: tuple[str, ...] = (
        *("namespaces", "read-only", "privileges", "seccomp", "private-files", "proc", "uid", "cgroup", "rlimits"),
    )
    """Layers of `mdrive-sumo doctor --sandbox` that a machine must have to run agents."""
    copies: Path = MEMORY
    """Folder for the files of each box, used if the layer `private-files` is required; best a tmpfs."""
    episode_memory_bytes: Count = 6 * 2**30
    """Memory of a worker's process outside the sandboxes [bytes]: simulation, sensors, frames, copies that it makes."""
    memory_bytes: Count = _BOX.memory_bytes
    processes: Count = _BOX.processes
    cpu_s: Count = _BOX.cpu_s
    file_bytes: Count = _BOX.file_bytes
    tmp_bytes: Count = _BOX.tmp_bytes
    open_files: Count = _BOX.open_files
    log_bytes: Count = _BOX.log_bytes
    tick_s: Annotated[float, Field(gt=0)] = 10.0
    """Wall time that an agent has for one reply [s]."""
    episode_s: Annotated[float, Field(gt=0)] = _LINE.episode_s
    """Wall time that an agent has for all replies of an episode [s]: bounds how long one CAV can occupy a worker."""
    pace_s: Annotated[float, Field(ge=0, le=MAX_PACE_S)] = 0.0
    """Time from the requests of a tick to those of the next one, whatever the agents take [s]; 0: none. No result
    depends on it, so it is no part of the evaluator."""
    reply_bytes: Count = 64 * 1024

    def box_limits(self) -> BoxLimits:
        """Return the limits of a sandbox."""
        return BoxLimits(**{field.name: getattr(self, field.name) for field in fields(BoxLimits)})

    def choose_backend(self) -> str:
        """Return the backend of boxes on this machine; the first call with `auto` opens a box."""
        return choose_backend(self.backend)

    def copies_folder(self) -> Path | None:
        """Return where boxes get files of their own; None if they share those of the host."""
        return self.copies if "private-files" in self.required else None

    def line_limits(self) -> ConnectionLimits:
        """Return the limits of the connection to an agent."""
        return ConnectionLimits(
            tick_s=self.tick_s, episode_s=self.episode_s, pace_s=self.pace_s, reply_bytes=self.reply_bytes
        )


class WorkerSettings(SettingsModel):
    """Workers that run the jobs."""

    processes: Annotated[int, Field(ge=0)] = 2
    """Worker processes of this server; 0 if others work for it."""
    scheduler: str = ""
    """Address of a Dask scheduler, tcp://...; "" for local processes."""
    phase_kinds: Literal["all", "hidden", "public"] = "all"
    """Whose jobs the workers of this machine take; all: hidden and public ones, never at the same time."""
    drop_caches: bool = True
    """When hidden and public work change, drop the page cache (root only) and move the kernel's inode numbers."""
    lease_s: Annotated[int, Field(ge=40)] = 60
    """Time for which a worker holds a job without a heartbeat [s]; above the 30 s that a writer may wait for the
    database."""
    heartbeat_s: Count = 10
    """Time between two heartbeats of a worker [s]."""
    spot_check: Annotated[float, Field(ge=0, le=1)] = 0.02
    """Share of finished submissions of which one scenario is run again and compared."""
    job_budget_s: Annotated[float, Field(gt=0)] = 120.0
    """Worker time of a submission [s]: this for each of its jobs (7.5 hours for 225 scenarios), at least 1 hour."""

    @property
    def job_budget_us(self) -> int:
        """Return `job_budget_s` in microseconds."""
        return round(self.job_budget_s * 1e6)

    @model_validator(mode="after")
    def _beats_in_time(self) -> Self:
        if self.heartbeat_s * 3 > self.lease_s:
            raise ValueError(
                f"heartbeat_s: expected at most a third of lease_s {self.lease_s}, found {self.heartbeat_s}"
            )
        return self


class RetentionSettings(SettingsModel):
    """Retention in days; see `store.retention.RetentionPolicy`."""

    archive_days: Count = _POLICY.archive_days
    refused_days: Count = _POLICY.refused_days
    recording_days: Count = _POLICY.recording_days
    result_days: Count = _POLICY.result_days

    def policy(self) -> RetentionPolicy:
        """Return the policy for the store."""
        return RetentionPolicy(**self.model_dump())


class RegistrationSettings(SettingsModel):
    """Self-registration of teams."""

    open: bool = False
    per_day: Count = 20
    """Registrations of all teams per UTC day."""


class ConnectionSettings(SettingsModel):
    """What clients may hold open at a time, see `server.api.concurrency_limit` and `server.cli.limited_protocol`."""

    total: Annotated[int, Field(ge=16)] = 1000
    """Connections of this server; one beyond is accepted for a moment if the headers of its request have arrived: then
    those are closed that have waited longest for their clients. Others are refused."""
    per_address: Annotated[int, Field(ge=16)] = 256
    """Connections of one address, that of a proxy on this machine excepted; one beyond is closed at once."""
    streams: Count = 256
    """Event streams of all teams: each queries the database once a second."""
    streams_per_team: Count = 16
    uploads: Count = 64
    """Uploads of all teams: quotas are counted only when an archive is complete, disks fill up before."""
    uploads_per_team: Count = 8


class WebhookSettings(SettingsModel):
    """Notifications of teams over HTTP; see `server.api.webhook_address` for where they may go."""

    enabled: bool = False
    allowed_hosts: tuple[str, ...] = ()
    """HOST or HOST:PORT to which http, private addresses and other ports are allowed."""
    timeout_s: Annotated[float, Field(gt=0, le=60)] = 10.0
    """Time limit of one attempt [s], from the look-up of the name to the status of the answer."""


class ServerSettings(SettingsModel):
    """The whole file. Without phases nothing can be submitted; everything else has a default."""

    data: Path = Path("mdrive-data")
    """Archives, recordings, and the database unless `database` says otherwise."""
    database: str = ""
    """postgresql://USER@HOST/NAME; "" for a SQLite file in `data`."""
    host: str = "127.0.0.1"
    port: Annotated[int, Field(ge=0, le=65535)] = 8000
    wheel: Path | None = None
    """Wheel of mdrive-sumo that participants download; None: they install from a clone."""
    limits: ArchiveSettings = ArchiveSettings()
    sandbox: SandboxSettings = SandboxSettings()
    work: WorkerSettings = WorkerSettings()
    keep: RetentionSettings = RetentionSettings()
    registration: RegistrationSettings = RegistrationSettings()
    connections: ConnectionSettings = ConnectionSettings()
    webhooks: WebhookSettings = WebhookSettings()
    phases: tuple[PhaseSettings, ...] = ()

    @model_validator(mode="after")
    def _names_phases_once(self) -> Self:
        ids = [phase.id for phase in self.phases]
        if len(set(ids)) < len(ids):
            raise ValueError(f"phases: expected every id once, found {', '.join(ids)}")
        return self

    @property
    def database_url(self) -> str:
        """URL for `Store`."""
        return self.database or f"sqlite:///{self.data.absolute() / 'challenge.sqlite'}"

    @property
    def archives(self) -> Path:
        """Folder of the archives `<sha256>.zip`."""
        return self.data / "archives"

    @property
    def recordings(self) -> Path:
        """Folder with one folder per submission."""
        return self.data / "recordings"

    @property
    def environments(self) -> Path:
        """Folder of the environments, see `server.environments`."""
        return self.data / "environments"


_SECTIONS: Mapping[str, Mapping[str, object]] = {
    "": ServerSettings.model_fields,
    "limits": ArchiveSettings.model_fields,
    "sandbox": SandboxSettings.model_fields,
    "work": WorkerSettings.model_fields,
    "keep": RetentionSettings.model_fields,
    "registration": RegistrationSettings.model_fields,
    "connections": ConnectionSettings.model_fields,
    "webhooks": WebhookSettings.model_fields,
}
_NOT_SCALAR = (*_SECTIONS, "phases")
"""Settings that no single variable can express."""
_LISTS = ("required", "allowed_hosts")
"""Settings that are lists; a variable has commas between the items."""


def load_settings(file: Path | None, environ: Mapping[str, str] = os.environ) -> ServerSettings:
    """Load the settings of `file` (None: defaults), overridden by MDRIVE_* of `environ`. Raises InputError."""
    content = _read_file(file) if file is not None else {}
    for name in sorted(environ):
        if name.startswith(PREFIX) and name not in OTHER_VARIABLES:
            _apply_variable(content, name, environ[name])
    try:
        return ServerSettings.model_validate(content)
    except ValidationError as error:
        raise InputError(f"{file or 'settings'}: {describe_first_error(error)}") from None


def _read_file(file: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(read_text(file))
    except OSError as error:
        raise InputError(f"{file}: cannot be read: {error.strerror}") from None
    except (ValueError, RecursionError) as error:  # no TOML, no text, a number of 5000 digits, nesting without end
        raise InputError(f"{file}: expected TOML: {error}") from None


def _apply_variable(content: dict[str, Any], name: str, text: str) -> None:
    section, _, field = name.removeprefix(PREFIX).lower().rpartition("__")
    fields_of_section = _SECTIONS.get(section, {})
    if field not in fields_of_section or field in _NOT_SCALAR:
        raise InputError(f"environment: {name} is not a setting of the server; unset it or correct its name")
    table = content.setdefault(section, {}) if section else content
    if not isinstance(table, dict):
        raise InputError(f"settings: {section}: expected a table, found {table!r}")
    table[field] = text.split(",") if field in _LISTS else text
