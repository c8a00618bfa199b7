"""Turns an upload into a submission; for the API and for the pages."""

import os
from pathlib import Path

from sqlalchemy.orm import Session

from mdrive_sumo.core.errors import InputError
from server import environments, paths
from server.api import schemas, submission_views
from server.api.caller import Caller
from server.api.dependencies import Services
from server.api.upload import Upload
from server.archive import ArchiveLimits, ArchiveRefused, check_archive
from server.enums import ChallengeTrack
from server.store import phases, quota, submissions, tables
from server.store.errors import check_text
from server.store.submissions import NewSubmission
from server.tracks import check_style

CHECK_S = 60.0
"""Time limit of an archive's check [s]: unpacking and hashing 256 MiB takes a few seconds."""
FIELDS = frozenset(("phase", "track", "name"))
"""Fields of the form besides the archive."""


class SubmissionService:
    """Accepts one upload; runs in a worker thread."""

    def __init__(
        self, services: Services, caller: tuple[Caller, str], upload: Upload, idempotency_key: str | None, at_us: int
    ) -> None:
        self._services, self._upload, self._key, self._at_us = services, upload, idempotency_key, at_us
        self._caller, self._team = caller

    def accept(self) -> schemas.SubmissionOut:
        """Check the upload, move the archive to its place and insert the submission. Raises InputError."""
        limits = ArchiveLimits(**self._services.settings.limits.model_dump())
        with self._services.store.read() as session:
            phase = phases.get(session, self._field("phase"))
            self._check_first(session, phase)
        manifest = self._services.check_runner.call(CHECK_S, check_archive, self._upload.file, limits)
        check_style(manifest.style, self._track())
        self._check_environment(manifest.environment)
        new = self._make_submission(phase, manifest.environment)
        self._store_archive()
        jobs = self._services.suites.jobs(phase)
        with self._services.store.write() as session:
            accepted = submissions.accept(session, new, phase, jobs, self._at_us)
            return submission_views.to_submission(session, self._caller, accepted)

    def _check_first(self, session: Session, phase: tables.PhaseRow) -> None:
        """Refuse what needs no look into the archive; `submissions.accept` makes the final decision."""
        sent_before = submissions.find_environment(session, self._team, self._upload.sha256)
        if submissions.find_known(session, self._make_submission(phase, sent_before), phase) is None:
            phases.check_open(phase, self._at_us)
            quota.check_quota(session, self._team, phase, self._at_us)

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
        found = self._upload.fields.get(name)
        if not found:
            raise InputError(f"{name}: expected a value in the form, found none")
        return found

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


def _sync_folder(folder: Path) -> None:
    """Write the folder to disk: only then does a new name survive a crash."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
