"""The job that a worker process receives, and what it returns."""

from dataclasses import dataclass
from pathlib import Path

from sqlalchemy.orm import Session

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.output_files import make_folder
from mdrive_sumo.runs.worker_process import WorkerFailure
from server.enums import ChallengeTrack, JobKind, ScenarioVerdict
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


@dataclass(frozen=True, slots=True, kw_only=True)
class JobTask:
    """A job as plain values, valid on every machine with the same data folder."""

    kind: JobKind = JobKind.SUBMISSION
    job: int
    attempt: int
    submission: str
    """The submission under test."""
    archive_sha256: str
    environment: str
    track: ChallengeTrack
    suite: str
    scenario: str
    seed: int
    public: bool
    """Whether the scenario is one of a public phase."""
    data: Path
    """The server's data folder; shared by the machines of a cluster."""
    sandbox: SandboxSettings
    sensor_track_only: bool = False
    """Whether an agent that is given lists of objects is rejected."""
    other: OtherArchive | None = None
    """In cross-play; None: the agent drives all CAVs."""
    limits: ArchiveSettings
    checksum: str = ""
    """Of the scenario's file when this worker read the suite; see `EpisodeJob.checksum`."""

    @property
    def keeps_files(self) -> bool:
        """Whether recording and logs are stored: of the scenarios of submissions in public phases only."""
        return self.public and self.kind is JobKind.SUBMISSION

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


UNKNOWN_FAILURE = "unknown"
"""In place of a failure on our side of which nothing is said."""
BY_MESSAGES = "others_failed_by_messages"
"""In the usage of a job of cross-play: messages of the agent under test made an agent of the others fail."""


@dataclass(frozen=True, slots=True)
class AgentRejection:
    """The agent requires what is not allowed; the whole submission is rejected with this reason."""

    why: str


class EvaluatorMismatchError(InputError):
    """A job in the queue needs another version of the code or suite than this process has."""


JobResult = JobOutcome | AgentRejection


def describe_failure(outcome: JobResult | WorkerFailure) -> str | None:
    """Return why an outcome is a failure on our side; None if it is none."""
    if isinstance(outcome, WorkerFailure):
        return f"{outcome.kind}: {outcome.reason}"
    if isinstance(outcome, AgentRejection) or outcome.verdict is not ScenarioVerdict.FAILED_OURS:
        return None
    return outcome.failure or UNKNOWN_FAILURE


def load_task(session: Session, job: JobRow, settings: ServerSettings, suites: PhaseSuites) -> JobTask | None:
    """Return the task of a claimed job; None if one of its submissions needs another evaluator.

    Raises NotFound, and InputError for a suite or an environment that cannot be read.
    """
    kind = JobKind(job.kind)
    tested, others = (submissions.get(session, name) for name in (job.submission, job.others))
    phase = phases.get(session, tested.phase)
    if any(each.evaluator != suites.evaluator(phase, each.environment) for each in (tested, others)):
        return None
    is_pair = kind is JobKind.CROSS_PLAY
    return JobTask(
        kind=kind,
        job=job.id,
        attempt=job.attempt,
        submission=tested.id,
        archive_sha256=tested.archive_sha256,
        environment=tested.environment,
        track=ChallengeTrack.NEGOTIATION if is_pair else ChallengeTrack(tested.track),
        suite=phase.suite,
        scenario=job.scenario,
        seed=job.seed,
        public=phase.public,
        sensor_track_only=phase.sensor_track_only and not is_pair,
        other=OtherArchive(others.archive_sha256, others.environment) if is_pair else None,
        data=settings.data.absolute(),
        sandbox=settings.sandbox,
        limits=settings.limits,
        checksum=suites.find_checksum(phase, job.scenario),
    )


def move_files(task: JobTask) -> None:
    """Move recording and logs to their final folder. Raises OSError: then the job is not finished."""
    if not task.keeps_files or not task.stage.is_dir():
        return
    make_folder(task.home)
    for path in sorted(task.stage.iterdir()):
        path.replace(task.home / path.name)
