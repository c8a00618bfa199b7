"""Takes an upload in as a submission: for the API and for the pages."""

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
"""For an archive: 256 MiB to unpack and sum up take a few seconds."""
FIELDS = frozenset(("phase", "track", "name"))
"""Of the form, besides the archive."""


class SubmissionService:
    """One upload on its way to a submission; in a thread of its own."""

    def __init__(
        self, using: Services, caller: tuple[Caller, str], upload: Upload, key: str | None, at_us: int
    ) -> None:
        self._using, self._upload, self._key, self._at_us = using, upload, key, at_us
        self._caller, self._team = caller

    def granted(self) -> schemas.SubmissionOut:
        """The submission. Raises InputError."""
        limits = ArchiveLimits(**self._using.settings.limits.model_dump())
        with self._using.store.read() as session:
            phase = phases.get(session, self._field("phase"))
            self._check_first(session, phase)
        manifest = self._using.aside.call(CHECK_S, check_archive, self._upload.file, limits)
        check_style(manifest.style, self._track())
        self._check_environment(manifest.environment)
        new = self._new(phase, manifest.environment)
        self._keep()
        jobs = self._using.suites.jobs(phase)
        with self._using.store.write() as session:
            accepted = submissions.accept(session, new, phase, jobs, self._at_us)
            return submission_views.to_submission(session, self._caller, accepted)

    def _check_first(self, session: Session, phase: tables.PhaseRow) -> None:
        """What can be refused without looking into the archive; `accept` decides."""
        sent_before = submissions.find_environment(session, self._team, self._upload.sha256)
        if submissions.find_known(session, self._new(phase, sent_before), phase) is None:
            phases.check_open(phase, self._at_us)
            quota.check_quota(session, self._team, phase, self._at_us)

    def _check_environment(self, wanted: str) -> None:
        """Here, for in a worker it would be our failure."""
        built = environments.list_built(self._using.settings.environments)
        if wanted not in built:
            offered = f"one of {', '.join(built)}" if built else "one that is built on this server, which has none yet"
            raise ArchiveRefused(f"model_env.yaml: environment: expected {offered}, found {wanted}")

    def _new(self, phase: tables.PhaseRow, environment: str) -> NewSubmission:
        return NewSubmission(
            team=self._team,
            track=self._track(),
            name=check_text(self._field("name"), "name of the method", 80),
            archive_sha256=self._upload.sha256,
            archive_bytes=self._upload.bytes,
            environment=environment,
            evaluator=self._using.suites.evaluator(phase, environment),
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

    def _keep(self) -> None:
        """To where workers look for it; on the disk before the database says that it is there."""
        target = paths.archive_path(self._using.settings, self._upload.sha256)
        with self._upload.file.open("rb") as file:
            os.fsync(file.fileno())
        self._upload.file.replace(target)
        _sync_folder(target.parent)


def _sync_folder(folder: Path) -> None:
    """A new name is safe only when the folder is written, too."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
