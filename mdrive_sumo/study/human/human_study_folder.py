"""The folder of a study: plan, progress of every participant, takes; whole after every step, whatever dies.

DIR/study.json                        plan, and whether persons or programs drive
DIR/links.json                        secret links of organiser and participants (persons only)
DIR/participants/CODE/progress.json   how far a participant is, with answers
DIR/participants/CODE/drives/...      takes
DIR/pairs/CODE+CODE/...               takes of two participants
DIR/withdrawals.json                  code and time of every withdrawal, and nothing else of the participant
DIR/runs/AGENT/...                    agents on the same scenarios
DIR/results/                          tables, figure and CSV, written anew on demand
"""

import json
import os
import secrets
import shutil
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, ValidationError

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.input_files import read_bytes
from mdrive_sumo.core.output_files import make_folder, open_appended, write_bytes, write_text
from mdrive_sumo.core.posix import import_posix
from mdrive_sumo.runs.evaluate import report_write_errors
from mdrive_sumo.scenario.scenario import describe_first_error
from mdrive_sumo.study.human.drive_order import PlannedDrive
from mdrive_sumo.study.human.human_study_plan import HumanStudyPlan
from mdrive_sumo.study.human.participant_progress import DriveEntry, Moment, ParticipantProgress

STUDY_FILE, LINKS_FILE, LOCK_FILE = "study.json", "links.json", "study.lock"
WITHDRAWALS_FILE, PROGRESS_FILE = "withdrawals.json", "progress.json"
PARTICIPANTS_FOLDER, PAIRS_FOLDER, RESULTS_FOLDER = "participants", "pairs", "results"
ORGANISER = "(organiser)"
"""Key of the organiser's link among those of participants, whose codes have no brackets."""
TOKEN_BYTES = 18
"""144 random bits: no link can be guessed."""
fcntl = import_posix("fcntl")


class HumanStudyFile(BaseModel):
    """`study.json`."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    format: Literal["mdrive-sumo/human-study/1"] = "mdrive-sumo/human-study/1"
    drivers: Literal["persons", "scripted"]
    """Whether persons or programs drive; never both in one folder."""
    plan: HumanStudyPlan


class Withdrawal(BaseModel):
    """All that stays of a participant who withdrew."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    code: str
    at: Moment


class HumanStudyFolder:
    """A study on disk. Every change is one file that takes its place when it is whole."""

    def __init__(self, folder: Path, file: HumanStudyFile) -> None:
        """Use `create` or `open_existing`."""
        self.folder, self.plan, self.drivers = folder, file.plan, file.drivers
        self._finish_withdrawals()

    @classmethod
    def create(cls, folder: Path, plan: HumanStudyPlan, drivers: Literal["persons", "scripted"]) -> "HumanStudyFolder":
        """Return the study of a new folder, or continue the same study. Raises InputError for another one."""
        path, file = folder / STUDY_FILE, HumanStudyFile(drivers=drivers, plan=plan)
        if path.exists():
            before = cls._read(path)
            if before.drivers != drivers:
                raise InputError(
                    f"{folder}: expected a study of {drivers}, found one of {before.drivers}; --out names another"
                    " folder"
                )
            differing = [
                name for name in HumanStudyPlan.model_fields if getattr(before.plan, name) != getattr(plan, name)
            ]
            if differing:
                raise InputError(
                    f"{folder}: expected the plan with which the study began, found another"
                    f" {', '.join(differing)}; --out names another folder"
                )
            return cls(folder, before)
        if folder.exists() and (not folder.is_dir() or any(entry.name != LOCK_FILE for entry in folder.iterdir())):
            raise InputError(f"{folder}: expected a new or empty folder, or one of `study human`, found something else")
        with report_write_errors(path):
            make_folder(folder)
            write_text(path, file.model_dump_json(indent=1) + "\n")
        return cls(folder, file)

    @classmethod
    def open_existing(cls, folder: Path) -> "HumanStudyFolder":
        """Return the study of a folder. Raises InputError."""
        return cls(folder, cls._read(folder / STUDY_FILE))

    @staticmethod
    def _read(path: Path) -> HumanStudyFile:
        try:
            return HumanStudyFile.model_validate_json(read_bytes(path))
        except FileNotFoundError:
            raise InputError(
                f"{path.parent}: expected the folder of a study with {STUDY_FILE}, found none;"
                " mdrive-sumo study human --plan PLAN --out DIR begins one"
            ) from None
        except OSError as error:
            raise InputError(f"{path}: cannot be read: {error.strerror}") from None
        except ValidationError as error:
            raise InputError(f"{path}: {describe_first_error(error)}") from None

    @contextmanager
    def lock(self) -> Generator[None]:
        """Keep other processes from writing in the folder. Raises InputError if one does."""
        path = self.folder / LOCK_FILE
        with report_write_errors(path):
            descriptor = open_appended(path)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(descriptor)
            raise InputError(f"{self.folder}: another process runs this study; stop it first") from None
        try:
            yield
        finally:
            os.close(descriptor)

    # Progress

    def load_progress(self, code: str) -> ParticipantProgress:
        """Return how far a participant is; nothing done without a file. Raises InputError for a damaged one."""
        path = self._find_participant(code) / PROGRESS_FILE
        try:
            progress = ParticipantProgress.model_validate_json(read_bytes(path))
        except FileNotFoundError:
            return ParticipantProgress(code=code)
        except OSError as error:
            raise InputError(f"{path}: cannot be read: {error.strerror}") from None
        except ValidationError as error:
            raise InputError(f"{path}: {describe_first_error(error)}") from None
        if progress.code != code or progress.is_person != (self.drivers == "persons"):
            raise InputError(f"{path}: expected the progress of {code}, one of {self.drivers}, found another's")
        return progress

    def save_progress(self, progress: ParticipantProgress) -> None:
        """Write how far a participant is. Raises InputError, also for a participant who withdrew."""
        if progress.code in self.list_withdrawals():
            raise InputError(f"participant {progress.code}: withdrew from the study; nothing is kept")
        path = self._find_participant(progress.code) / PROGRESS_FILE
        with report_write_errors(path):
            make_folder(path.parent)
            write_text(path, progress.model_dump_json(indent=1) + "\n")

    def list_progress(self) -> tuple[ParticipantProgress, ...]:
        """Return the progress of every participant who did not withdraw, in the order of the plan."""
        withdrawn = self.list_withdrawals()
        return tuple(self.load_progress(code) for code in self.plan.codes if code not in withdrawn)

    def _find_participant(self, code: str) -> Path:
        if code not in self.plan.codes:
            raise InputError(f"participant {code!r:.40}: expected a code of the plan, found another")
        return self.folder / PARTICIPANTS_FOLDER / code

    def name_drive_folder(self, code: str, kind: Literal["practice", "counted"], drive: PlannedDrive) -> str:
        """Return the folder of a drive, relative to the study's: below both codes where two participants drive."""
        partner = self.plan.find_partner(code) if drive.condition.has_person else ""
        if partner:
            return f"{PAIRS_FOLDER}/{'+'.join(sorted((code, partner), key=self.plan.codes.index))}/{drive.name}"
        part = "practice" if kind == "practice" else "drives"
        return f"{PARTICIPANTS_FOLDER}/{code}/{part}/{drive.name}"

    def make_entry(self, code: str, kind: Literal["practice", "counted"], drive: PlannedDrive) -> DriveEntry:
        """Return the entry of a drive that begins."""
        return DriveEntry(
            kind=kind,
            number=drive.number,
            scenario=drive.scenario.id,
            cav=drive.cav,
            condition=drive.condition.name,
            folder=self.name_drive_folder(code, kind, drive),
        )

    # Withdrawal

    def withdraw(self, code: str, now: int) -> None:
        """Delete everything of a participant but the fact and the time. Raises InputError.

        The fact is written first: after a crash the deletion is finished when the folder is opened. Takes with a
        partner show the participant too, so they go; results are written anew from what is left.
        """
        self._find_participant(code)
        withdrawals = self.list_withdrawals()
        if code not in withdrawals:
            path = self.folder / WITHDRAWALS_FILE
            entries = [*withdrawals.values(), Withdrawal(code=code, at=now)]
            with report_write_errors(path):
                write_text(path, json.dumps([entry.model_dump() for entry in entries], indent=1) + "\n")
        self._finish_withdrawals()

    def list_withdrawals(self) -> dict[str, Withdrawal]:
        """Return the withdrawals by code. Raises InputError for a damaged file."""
        path = self.folder / WITHDRAWALS_FILE
        try:
            entries: Any = json.loads(read_bytes(path))
            withdrawals = [Withdrawal.model_validate(entry) for entry in entries]
        except FileNotFoundError:
            return {}
        except (OSError, ValueError, TypeError) as error:
            raise InputError(f"{path}: expected a list of codes and times, found a fault: {error}"[:300]) from None
        return {entry.code: entry for entry in withdrawals}

    def _finish_withdrawals(self) -> None:
        for code in self.list_withdrawals():
            folders = [self.folder / PARTICIPANTS_FOLDER / code]
            partner = self.plan.find_partner(code)
            if partner:
                folders.append(
                    self.folder / PAIRS_FOLDER / "+".join(sorted((code, partner), key=self.plan.codes.index))
                )
            if any(folder.exists() for folder in folders):
                for folder in (self.folder / RESULTS_FOLDER, *folders):  # results first: they are found by the others
                    _remove(folder)

    # Links

    def load_links(self) -> Mapping[str, str]:
        """Return the secret token of the organiser (`ORGANISER`) and of every participant, drawn at the first call."""
        path = self.folder / LINKS_FILE
        try:
            links: Any = json.loads(read_bytes(path))
        except FileNotFoundError:
            links = {name: secrets.token_urlsafe(TOKEN_BYTES) for name in (ORGANISER, *self.plan.codes)}
            with report_write_errors(path):
                write_bytes(path, (json.dumps(links, indent=1) + "\n").encode(), mode=0o600)
        except (OSError, ValueError) as error:
            raise InputError(f"{path}: expected links by code, found a fault: {error}"[:300]) from None
        if not isinstance(links, dict) or {*links} != {ORGANISER, *self.plan.codes}:
            raise InputError(f"{path}: expected a link for the organiser and every code, found others")
        return {str(name): str(token) for name, token in links.items()}


def _remove(folder: Path) -> None:
    if folder.exists():
        with report_write_errors(folder):
            shutil.rmtree(folder)
