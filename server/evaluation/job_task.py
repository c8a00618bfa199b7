"""The job that a worker process receives, and what it returns."""

from dataclasses import dataclass, field
from pathlib import Path

from sqlalchemy.orm import Session

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.output_files import make_folder
from server.enums import ChallengeTrack
from server.phase_suites import PhaseSuites
from server.settings import ArchiveSettings, SandboxSettings, ServerSettings
from server.store import phases, submissions
from server.store.jobs import JobOutcome
from server.store.tables import JobRow


@dataclass(frozen=True, slots=True)
class OtherArchive:
    """The agent that drives the CAVs that are not under test, in a job of cross-play."""

    archive_sha256: str
    environment: str


@dataclass(frozen=True, slots=True)
class JobTask:
    """One (submission, scenario, seed) as plain values, valid on every machine with the same data folder."""

    job: int
    attempt: int
    submission: str
    archive_sha256: str
    environment: str
    track: ChallengeTrack
    suite: str
    scenario: str
    seed: int
    public: bool
    """Whether recording and logs are stored."""
    data: Path
    """The server's data folder; shared by the machines of a cluster."""
    sandbox: SandboxSettings
    sensor_track_only: bool = field(default=False, kw_only=True)
    """Whether an agent that is given lists of objects is rejected."""
    hidden: bool = field(default=False, kw_only=True)
    """Whether the scenario is one of a hidden phase, also where a spot check stores nothing of a public one."""
    other: OtherArchive | None = field(default=None, kw_only=True)
    """In cross-play, where neither recording nor logs are stored; None: the agent drives all CAVs."""
    limits: ArchiveSettings
    checksum: str = ""
    """Of the scenario's file when this worker read the suite; see `EpisodeJob.checksum`."""

    @property
    def archive(self) -> Path:
        """Path of the archive."""
        return self.data / "archives" / f"{self.archive_sha256}.zip"

    @property
    def unpacked(self) -> Path:
        """Folder with the unpacked archive, shared by all jobs; its name is the checksum, see `archive_cache`."""
        return self.data / "unpacked" / self.archive_sha256

    @property
    def stage(self) -> Path:
        """Folder for the files of this attempt until its result is written."""
        return self.data / "stage" / f"{self.submission}.{self.job}.{self.attempt}"

    @property
    def home(self) -> Path:
        """Final folder of the files; see `server.paths`."""
        return self.data / "recordings" / self.submission / str(self.seed)


BY_MESSAGES = "others_failed_by_messages"
"""In the usage of a job of cross-play: messages of the agent under test made an agent of the others fail."""


@dataclass(frozen=True, slots=True)
class AgentRejection:
    """The agent requires what is not allowed; the whole submission is rejected with this reason."""

    why: str


class EvaluatorMismatchError(InputError):
    """A job in the queue needs another version of the code or suite than this process has."""


JobResult = JobOutcome | AgentRejection


def load_task(session: Session, job: JobRow, settings: ServerSettings, suites: PhaseSuites) -> JobTask:
    """Return the task of a claimed job. Raises NotFound."""
    submission = submissions.get(session, job.submission)
    phase = phases.get(session, submission.phase)
    return JobTask(
        job=job.id,
        attempt=job.attempt,
        submission=submission.id,
        archive_sha256=submission.archive_sha256,
        environment=submission.environment,
        track=ChallengeTrack(submission.track),
        suite=phase.suite,
        scenario=job.scenario,
        seed=job.seed,
        public=phase.public,
        hidden=not phase.public,
        sensor_track_only=phase.sensor_track_only,
        data=settings.data.absolute(),
        sandbox=settings.sandbox,
        limits=settings.limits,
        checksum=suites.find_checksum(phase, job.scenario),
    )


def move_files(task: JobTask) -> None:
    """Move recording and logs to their final folder. Raises OSError: then the job is not finished."""
    if not task.public or not task.stage.is_dir():
        return
    make_folder(task.home)
    for path in sorted(task.stage.iterdir()):
        path.replace(task.home / path.name)
