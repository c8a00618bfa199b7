"""StudyService: what participants and the organiser do, step by step; every step is on disk before it is shown."""

import asyncio
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from hmac import compare_digest

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.study.human.drive_order import PlannedDrive, plan_drives
from mdrive_sumo.study.human.human_study_folder import ORGANISER, HumanStudyFolder
from mdrive_sumo.study.human.human_study_plan import Question
from mdrive_sumo.study.human.participant_progress import (
    DriveEntry,
    ParticipantProgress,
    StepKind,
    StudyStep,
    find_step,
    plan_practice,
)
from mdrive_sumo.study.human.scripted_study import is_success
from server.drive.study.questionnaire_form import FormAnswers, read_answers
from server.drive.study.study_drives import StudyDrives

STUDY_PATH = "/study"


class WrongStep(InputError):
    """A form of a step that is over, as of a page that was loaded long ago."""


@dataclass(frozen=True, slots=True)
class ParticipantRow:
    """A participant in the organiser's overview."""

    code: str
    path: str
    """The participant's link; "" after a withdrawal."""
    step: str
    practice: int
    drives: int
    """Drives that count and are done."""
    planned: int
    withdrawn_at: int | None


class StudyService:
    """One study on this server. All methods run in one event loop."""

    def __init__(self, study: HumanStudyFolder, drives: StudyDrives, clock: Callable[[], int]) -> None:
        """clock: seconds since 1970."""
        self.study, self._drives, self._clock = study, drives, clock
        self._tokens = dict(study.load_links())
        self._locks = {code: asyncio.Lock() for code in study.plan.codes}

    # Links

    def find_code(self, token: str) -> str | None:
        """Return the code of a participant's link; None for any other."""
        name = self._find_name(token)
        return None if name == ORGANISER else name

    def is_organiser(self, token: str) -> bool:
        """Return whether a token is that of the organiser's link."""
        return self._find_name(token) == ORGANISER

    def _find_name(self, token: str) -> str | None:
        given = token.encode("utf-8", "replace")
        names = [name for name, known in self._tokens.items() if compare_digest(known.encode(), given)]
        return names[0] if names else None

    def make_path(self, code: str) -> str:
        """Return the path of a participant's link."""
        return f"{STUDY_PATH}?token={self._tokens[code]}"

    @property
    def organiser_path(self) -> str:
        """The path of the organiser's link."""
        return f"{STUDY_PATH}/overview?token={self._tokens[ORGANISER]}"

    def has_withdrawn(self, code: str) -> bool:
        """Return whether a participant has withdrawn."""
        return code in self.study.list_withdrawals()

    # Steps

    async def find_step(self, code: str) -> tuple[ParticipantProgress, StudyStep]:
        """Return how far a participant is, and the next step; a drive that has ended is noted first."""
        async with self._locks[code]:
            return await self._update(code)

    async def _update(self, code: str) -> tuple[ParticipantProgress, StudyStep]:
        progress = self.study.load_progress(code)
        step = self._find_step(progress)
        if step.kind is not StepKind.DRIVING or step.entry is None:
            return progress, step
        if self._is_lost(code, step.entry):
            progress = progress.lose_drive()
        elif take := self._drives.find_take(step.entry):
            succeeded = is_success(self.study.folder / take, step.entry.cav)
            progress = progress.end_drive(take, succeeded, self._clock())
        else:
            await self._drives.settle(step.entry)
            return progress, step
        self.study.save_progress(progress)
        if not self._is_partner_driving(code, step.entry):
            await self._drives.close(step.entry)
        return progress, self._find_step(progress)

    def _find_step(self, progress: ParticipantProgress) -> StudyStep:
        partner = self.study.plan.find_partner(progress.code)
        has_partner = not partner or not self.has_withdrawn(partner)
        return find_step(self.study.plan, progress, self._clock(), has_partner=has_partner)

    def _is_lost(self, code: str, entry: DriveEntry) -> bool:
        """Return whether a drive is one of a pair whose other half withdrew."""
        partner = self.study.plan.find_partner(code)
        return bool(partner) and partner in entry.folder and self.has_withdrawn(partner)

    def _is_partner_driving(self, code: str, entry: DriveEntry) -> bool:
        partner = self.study.plan.find_partner(code)
        if not partner or self.has_withdrawn(partner):
            return False
        drives = self.study.load_progress(partner).drives
        return any(one.folder == entry.folder and one.is_open for one in drives)

    async def consent(self, code: str) -> None:
        """Note the consent of a participant."""
        async with self._locks[code]:
            progress, step = await self._update(code)
            if step.kind is not StepKind.CONSENT:
                raise WrongStep("consent: it is noted already")
            self.study.save_progress(progress.consent(self._clock()))

    async def open_drive(self, code: str) -> str:
        """Begin the participant's next drive, or continue the open one; return the path of its page."""
        async with self._locks[code]:
            progress, step = await self._update(code)
            if step.entry is not None and step.kind is StepKind.DRIVING:
                planned = self._find_planned(progress, step.entry)
                return await self._drives.open(step.entry, planned, self._return_paths(code, planned))
            if step.drive is None:
                raise WrongStep("drive: expected a drive as the next step, found another one; load the page anew")
            entry = self.study.make_entry(code, "practice" if step.kind is StepKind.PRACTICE else "counted", step.drive)
            progress = progress.open_drive(entry, self.study.plan.breaks, self._clock())
            path = await self._drives.open(entry, step.drive, self._return_paths(code, step.drive))
            self.study.save_progress(progress)
            return path

    def _return_paths(self, code: str, drive: PlannedDrive) -> dict[int, str]:
        """Return where the drive pages lead at their end, by number of the CAV."""
        paths = {drive.cav: self.make_path(code)}
        if drive.condition.has_person:
            paths[drive.partner_cav] = self.make_path(self.study.plan.find_partner(code))
        return paths

    def _find_planned(self, progress: ParticipantProgress, entry: DriveEntry) -> PlannedDrive:
        if entry.kind == "counted":
            return plan_drives(self.study.plan, progress.code)[entry.number]
        before = progress.model_copy(update={"drives": progress.drives[:-1]})
        return plan_practice(self.study.plan, before)

    async def give_up(self, code: str) -> None:
        """End the open drive early; it counts as far as it was driven."""
        async with self._locks[code]:
            _, step = await self._update(code)
            if step.kind is not StepKind.DRIVING or step.entry is None:
                raise WrongStep("drive: expected an open one, found none; load the page anew")
            await self._drives.leave(step.entry)

    def list_questions(self, step: StudyStep) -> tuple[Question, ...]:
        """Return the questions of a step; none of any other."""
        questionnaires = self.study.plan.questionnaires
        if step.kind is StepKind.QUESTIONS:
            return questionnaires.after_drive
        return questionnaires.at_end if step.kind is StepKind.END_QUESTIONS else ()

    async def answer(self, code: str, form: Mapping[str, object]) -> FormAnswers:
        """Keep the answers of a form if none has a problem; return them with their problems."""
        async with self._locks[code]:
            progress, step = await self._update(code)
            questions = self.list_questions(step)
            if not questions:
                raise WrongStep("answers: expected questions as the step, found another one; load the page anew")
            answers = read_answers(questions, form)
            if not answers.problems:
                is_end = step.kind is StepKind.END_QUESTIONS
                kept = progress.answer_end if is_end else progress.answer_drive
                self.study.save_progress(kept(answers.answers))
            return answers

    async def withdraw(self, code: str) -> None:
        """Delete everything of a participant; a drive that goes on is ended first."""
        async with self._locks[code]:
            if not self.has_withdrawn(code):
                for entry in self.study.load_progress(code).drives:
                    await self._drives.close(entry)
            self.study.withdraw(code, self._clock())

    # Organiser

    def list_participants(self) -> list[ParticipantRow]:
        """Return every participant of the plan with what is done."""
        withdrawals = self.study.list_withdrawals()
        return [self._describe(code, withdrawals[code].at if code in withdrawals else None) for code in self._locks]

    def _describe(self, code: str, withdrawn_at: int | None) -> ParticipantRow:
        planned = len(plan_drives(self.study.plan, code))
        if withdrawn_at is not None:
            return ParticipantRow(code, "", "withdrawn", 0, 0, planned, withdrawn_at)
        progress = self.study.load_progress(code)
        practised, driven = (
            sum(not drive.is_open for drive in progress.list_drives(kind)) for kind in ("practice", "counted")
        )
        step = str(self._find_step(progress).kind)
        return ParticipantRow(code, self.make_path(code), step, practised, driven, planned, None)
