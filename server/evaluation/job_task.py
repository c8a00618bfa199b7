"""One (submission, scenario, seed) as a worker process is told of it, and what it tells back."""

from dataclasses import dataclass
from pathlib import Path

from sqlalchemy.orm import Session

from server.enums import ChallengeTrack
from server.settings import ArchiveSettings, SandboxSettings, ServerSettings
from server.store import phases, submissions
from server.store.jobs import JobOutcome
from server.store.tables import JobRow


@dataclass(frozen=True, slots=True)
class JobTask:
    """Plain values; nothing of the database, and nothing that only one machine knows but the data folder."""

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
    """Whether recording and logs are kept."""
    data: Path
    """The server's data folder: on a cluster, a shared one."""
    sandbox: SandboxSettings
    limits: ArchiveSettings

    @property
    def archive(self) -> Path:
        """What the team sent."""
        return self.data / "archives" / f"{self.archive_sha256}.zip"

    @property
    def unpacked(self) -> Path:
        """What it holds, once for all jobs; its name begins with the checksum, see `unpacking.tidy`."""
        return self.data / "unpacked" / self.archive_sha256

    @property
    def stage(self) -> Path:
        """Where this attempt, and no other, puts files until it is known whether they count."""
        return self.data / "stage" / f"{self.submission}.{self.job}.{self.attempt}"

    @property
    def home(self) -> Path:
        """Where they go then; see `server.paths`."""
        return self.data / "recordings" / self.submission / str(self.seed)


@dataclass(frozen=True, slots=True)
class AgentRejection:
    """The agent asks for what it may not have, said in one sentence for the team: the whole submission is rejected."""

    why: str


JobResult = JobOutcome | AgentRejection


def load_task(session: Session, job: JobRow, settings: ServerSettings) -> JobTask:
    """Of a claimed job. Raises NotFound."""
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
        data=settings.data.absolute(),
        sandbox=settings.sandbox,
        limits=settings.limits,
    )
