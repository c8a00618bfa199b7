"""Turns an upload into a submission; for the API and for the pages."""

import os
from contextlib import suppress
from pathlib import Path

from anyio import to_thread
from fastapi import Request
from starlette.concurrency import run_in_threadpool

from mdrive_sumo.core.errors import InputError
from server import environments, paths
from server.api import submission_views
from server.api.child_calls import check_uploaded_agent
from server.api.dependencies import Services
from server.api.schemas.submissions import SubmissionOut
from server.api.submission_views import TeamMember
from server.api.subprocess_runner import CallEndedError
from server.api.upload import Upload, receive_upload
from server.archive import ArchiveLimits, ArchiveRefused, Manifest, inspect_archive, verify_contents
from server.enums import ChallengeTrack
from server.errors import check_text
from server.settings import ServerSettings
from server.store import phases, quota, submissions, tables
from server.store.submissions import NewSubmission
from server.tracks import check_style

INSPECT_S = 5.0
"""Time limit of the inspection of an archive's directory and small files [s]; it takes milliseconds."""
AGENT_START_S = 60.0
"""Time limit of the call [s]: imports, unpacking, a box, and 20 s for the agent itself."""
FIELDS = frozenset(("phase", "track", "name"))
"""Fields of the form besides the archive."""


async def receive_submission(
    request: Request, services: Services, member: TeamMember, idempotency_key: str | None, at_us: int
) -> SubmissionOut:
    """Receive the upload of a request and accept it as a submission. Raises InputError and ProblemError.

    Cheap checks come first: the team's quotas, the archive's directory, its environment. Only then are its contents
    read, in turns of the teams (`CheckQueue`).
    """
    settings, team = services.settings, member.team
    with services.upload_limit.acquire(team):
        await run_in_threadpool(_check_refused, services, team, at_us)
        async with receive_upload(request, FIELDS, settings.archives, settings.limits.archive_bytes) as upload:
            service = SubmissionService(services, member, upload, idempotency_key, at_us)
            if (known := await run_in_threadpool(service.find_known)) is not None:
                return known
            async with services.check_queue.turn(team):
                manifest = await to_thread.run_sync(service.check_archive, limiter=services.check_threads)
            return await run_in_threadpool(service.accept, manifest)


def starts_agents(settings: ServerSettings) -> bool:
    """Return whether uploaded agents are started on this machine: only where agents of public phases run anyway."""
    work = settings.work
    return settings.limits.start_agents and work.processes > 0 and not work.scheduler and work.phase_kinds != "hidden"


class SubmissionService:
    """Accepts one upload; its methods run in worker threads."""

    def __init__(
        self, services: Services, member: TeamMember, upload: Upload, idempotency_key: str | None, at_us: int
    ) -> None:
        self._services, self._upload, self._key, self._at_us = services, upload, idempotency_key, at_us
        self._caller, self._team = member

    def find_known(self) -> SubmissionOut | None:
        """Return the submission that the same upload made before; refuse what needs no look into the archive.

        Raises InputError. `submissions.accept` makes the final decision.
        """
        with self._services.store.read() as session:
            phase = phases.get(session, self._field("phase"))
            sent_before = submissions.find_environment(session, self._team, self._upload.sha256)
            known = submissions.find_known(session, self._make_submission(phase, sent_before), phase)
            if known is not None:
                return submission_views.to_submission(session, self._caller, known)
            phases.check_open(phase, self._at_us)
            quota.check_quota(session, self._team, phase, self._at_us)
        return None

    def check_archive(self) -> Manifest:
        """Check the archive, what is cheap first; a refused one is counted. Raises ArchiveRefused and InputError."""
        _check_refused(self._services, self._team, self._at_us)  # others were refused while this one waited
        try:
            return self._examine()
        except (ArchiveRefused, CallEndedError) as error:
            with self._services.store.write() as session:
                quota.add_refused(session, self._team, self._at_us)
            if isinstance(error, CallEndedError):
                limit_s = self._services.settings.limits.check_s
                sentence = f"archive: expected one that is checked within {limit_s:g} s, found one that is not"
                raise ArchiveRefused(sentence) from None
            raise

    def _examine(self) -> Manifest:
        limits = ArchiveLimits(**self._services.settings.limits.archive_fields())
        call, file = self._services.check_runner.call, self._upload.file
        manifest = call(INSPECT_S, inspect_archive, file, limits)
        check_style(manifest.style, self._track())
        self._check_environment(manifest.environment)
        call(self._services.settings.limits.check_s, verify_contents, file, limits)
        self._start_agent(manifest)
        return manifest

    def _start_agent(self, manifest: Manifest) -> None:
        """Refuse sensors that the agent declares; one that cannot be started in time is accepted, unchecked."""
        settings, checker = self._services.settings, self._services.check_runner
        if starts_agents(settings):
            with self._services.store.read() as session:
                sensor_track_only = phases.get(session, self._field("phase")).sensor_track_only
            with suppress(CallEndedError):
                checker.call(
                    AGENT_START_S, check_uploaded_agent, self._upload.file, manifest, settings, sensor_track_only
                )

    def accept(self, manifest: Manifest) -> SubmissionOut:
        """Move the checked archive to its place and insert the submission. Raises InputError."""
        with self._services.store.read() as session:
            phase = phases.get(session, self._field("phase"))
        new = self._make_submission(phase, manifest.environment)
        self._store_archive()
        jobs = self._services.suites.jobs(phase)
        with self._services.store.write() as session:
            accepted = submissions.accept(session, new, phase, jobs, self._at_us)
            return submission_views.to_submission(session, self._caller, accepted)

    def _check_environment(self, environment: str) -> None:
        """Refuse an environment that is not built here: in a worker that would count as a failure on our side."""
        built = environments.list_built(self._services.settings.environments)
        if environment not in built:
            offered = (
                f"one of {', '.join(built)}" if built else "one that is built on this server, which has none so far"
            )
            raise ArchiveRefused(f"model_env.yaml: environment: expected {offered}, found {environment}")

    def _make_submission(self, phase: tables.PhaseRow, environment: str) -> NewSubmission:
        return NewSubmission(
            team=self._team,
            track=self._track(),
            name=check_text(self._field("name"), "name of the method", 80),
            archive_sha256=self._upload.sha256,
            archive_bytes=self._upload.bytes,
            environment=environment,
            evaluator=self._services.suites.evaluator(phase, environment),
            idempotency_key=self._key,
        )

    def _field(self, name: str) -> str:
        value = self._upload.fields.get(name)
        if not value:
            raise InputError(f"{name}: expected a value in the form, found none")
        return value

    def _track(self) -> ChallengeTrack:
        wanted = self._field("track")
        if wanted not in tuple(ChallengeTrack):
            raise InputError(f"track: expected one of {', '.join(ChallengeTrack)}, found {wanted!r:.60}")
        return ChallengeTrack(wanted)

    def _store_archive(self) -> None:
        """Move the archive to where workers find it, and sync it to disk before the database refers to it."""
        target = paths.archive_path(self._services.settings, self._upload.sha256)
        with self._upload.file.open("rb") as file:
            os.fsync(file.fileno())
        self._upload.file.replace(target)
        _sync_folder(target.parent)


def _check_refused(services: Services, team: str, at_us: int) -> None:
    with services.store.read() as session:
        quota.check_refused(session, team, services.settings.limits.refused_per_day, at_us)


def _sync_folder(folder: Path) -> None:
    """Write the folder to disk: only then does a new name survive a crash."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
