"""How far a participant is: what `progress.json` holds, and the next step that follows from it."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from mdrive_sumo.study.human.drive_order import PlannedDrive, plan_drives
from mdrive_sumo.study.human.human_study_plan import Breaks, Code, HumanStudyPlan, StudyCondition

PERSONS = "person"
"""`ParticipantProgress.driver` of a person; scripted drivers have `scripted:KIND`."""
SCRIPTED_PREFIX = "scripted:"
Answer = str | float | None
Moment = Annotated[int, Field(ge=0)]
"""Seconds since 1970, UTC."""


class _Record(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class DriveEntry(_Record):
    """A drive that was opened."""

    kind: Literal["practice", "counted"]
    number: Annotated[int, Field(ge=0)]
    """Place among the drives of its kind, from 0."""
    scenario: str
    cav: int
    condition: str
    """Name of the condition; practice has that of the first drive that counts."""
    folder: str
    """Folder of the drive, relative to the study's."""
    take: str = ""
    """Run folder of the take that counts, relative to the study's; "": not driven to an end yet."""
    is_success: bool = False
    is_lost: bool = False
    """Whether the take is gone, because the partner withdrew from the study."""
    answers: dict[str, Answer] | None = None
    """Answers by question; None: not asked yet."""

    @property
    def is_open(self) -> bool:
        """Whether the drive has begun and not ended."""
        return not self.take and not self.is_lost


class ParticipantProgress(_Record):
    """Everything that is kept of a participant besides the takes. No name, no address, nothing but a code."""

    format: Literal["mdrive-sumo/human-study-progress/1"] = "mdrive-sumo/human-study-progress/1"
    code: Code
    driver: str = PERSONS
    """`person`, or `scripted:KIND` for a program."""
    consented_at: Moment | None = None
    drives: tuple[DriveEntry, ...] = ()
    end_answers: dict[str, Answer] | None = None
    session_began_at: Moment | None = None
    last_ended_at: Moment | None = None
    """When the last drive ended."""

    @property
    def is_person(self) -> bool:
        """Whether a person drives, not a program."""
        return self.driver == PERSONS

    def list_drives(self, kind: Literal["practice", "counted"]) -> tuple[DriveEntry, ...]:
        """Return the drives of a kind, in their order."""
        return tuple(drive for drive in self.drives if drive.kind == kind)

    def consent(self, now: int) -> "ParticipantProgress":
        """Return the progress with the consent given."""
        return self.model_copy(update={"consented_at": now})

    def open_drive(self, entry: DriveEntry, breaks: Breaks, now: int) -> "ParticipantProgress":
        """Return the progress with a drive begun, and a new session if the last one is long over."""
        began = self.session_began_at
        if began is None or is_new_session(self, breaks, now):
            began = now
        return self.model_copy(update={"drives": (*self.drives, entry), "session_began_at": began})

    def end_drive(self, take: str, is_success: bool, now: int) -> "ParticipantProgress":
        """Return the progress with the open drive ended."""
        *before, last = self.drives
        ended = last.model_copy(update={"take": take, "is_success": is_success})
        return self.model_copy(update={"drives": (*before, ended), "last_ended_at": now})

    def lose_drive(self) -> "ParticipantProgress":
        """Return the progress with the open drive given up, because the partner withdrew."""
        *before, last = self.drives
        return self.model_copy(update={"drives": (*before, last.model_copy(update={"is_lost": True, "answers": {}}))})

    def answer_drive(self, answers: Mapping[str, Answer]) -> "ParticipantProgress":
        """Return the progress with the questions after the last drive answered."""
        *before, last = self.drives
        return self.model_copy(update={"drives": (*before, last.model_copy(update={"answers": dict(answers)}))})

    def answer_end(self, answers: Mapping[str, Answer]) -> "ParticipantProgress":
        """Return the progress with the questions at the end answered."""
        return self.model_copy(update={"end_answers": dict(answers)})


class StepKind(StrEnum):
    """What comes next for a participant."""

    CONSENT = "consent"
    PRACTICE = "practice"
    DRIVE = "drive"
    DRIVING = "driving"
    QUESTIONS = "questions"
    BREAK = "break"
    END_QUESTIONS = "end-questions"
    THANKS = "thanks"


@dataclass(frozen=True, slots=True)
class StudyStep:
    """The next step of a participant."""

    kind: StepKind
    drive: PlannedDrive | None = None
    """PRACTICE and DRIVE: what is to be opened."""
    entry: DriveEntry | None = None
    """DRIVING: the open drive. QUESTIONS: the drive that they are about."""
    until: int = 0
    """BREAK: when the next drive may begin [s since 1970]."""
    ends_session: bool = False
    """BREAK: whether the session is over."""


def find_step(plan: HumanStudyPlan, progress: ParticipantProgress, now: int, *, has_partner: bool = True) -> StudyStep:
    """Return the next step of a participant; it follows from plan and progress alone, so it survives any crash.

    has_partner: False once the partner withdrew: drives with a partner are left out.
    """
    if progress.is_person and progress.consented_at is None:
        return StudyStep(StepKind.CONSENT)
    last = progress.drives[-1] if progress.drives else None
    if last is not None and last.is_open:
        return StudyStep(StepKind.DRIVING, entry=last)
    if last is not None and last.kind == "counted" and last.answers is None and plan.questionnaires.after_drive:
        return StudyStep(StepKind.QUESTIONS, entry=last)
    drive = _find_next_drive(plan, progress, has_partner)
    if drive is not None:
        kind = StepKind.PRACTICE if must_practise(plan, progress) else StepKind.DRIVE
        return find_break(progress, plan.breaks, now) or StudyStep(kind, drive)
    if progress.end_answers is None and plan.questionnaires.at_end:
        return StudyStep(StepKind.END_QUESTIONS)
    return StudyStep(StepKind.THANKS)


def _find_next_drive(plan: HumanStudyPlan, progress: ParticipantProgress, has_partner: bool) -> PlannedDrive | None:
    if must_practise(plan, progress):
        return plan_practice(plan, progress)
    done = {entry.number for entry in progress.list_drives("counted")}
    left = (drive for drive in plan_drives(plan, progress.code) if drive.number not in done)
    return next((drive for drive in left if has_partner or not drive.condition.has_person), None)


def must_practise(plan: HumanStudyPlan, progress: ParticipantProgress) -> bool:
    """Return whether the participant has practice drives left."""
    practice, done = plan.practice, progress.list_drives("practice")
    if practice is None:
        return False
    if practice.drives is not None:
        return len(done) < practice.drives
    assert practice.successes is not None, "a plan has one of both"
    if len(done) >= practice.at_most:
        return False
    successes = [drive.is_success for drive in done]
    if practice.in_a_row:
        last = successes[-practice.successes :]
        return not (len(last) == practice.successes and all(last))
    return sum(successes) < practice.successes


def plan_practice(plan: HumanStudyPlan, progress: ParticipantProgress) -> PlannedDrive:
    """Return the next practice drive: alone, in the condition of the first drive that counts."""
    assert plan.practice is not None, "only while a participant must practise"
    number = len(progress.list_drives("practice"))
    scenario = plan.practice.scenarios[number % len(plan.practice.scenarios)]
    condition = plan_drives(plan, progress.code)[0].condition
    if condition.has_person:
        condition = StudyCondition(name=condition.name, v2x_view=condition.v2x_view, chat=condition.chat)
    return PlannedDrive(number, scenario, condition, scenario.cav)


def is_new_session(progress: ParticipantProgress, breaks: Breaks, now: int) -> bool:
    """Return whether the pause since the last drive ended the session before."""
    return progress.last_ended_at is not None and now - progress.last_ended_at >= 3600 * breaks.between_sessions_h


def find_break(progress: ParticipantProgress, breaks: Breaks, now: int) -> StudyStep | None:
    """Return the pause before the next drive; None if it may begin."""
    if not progress.is_person or progress.last_ended_at is None or is_new_session(progress, breaks, now):
        return None
    began = progress.session_began_at
    if began is not None and now - began >= 60 * breaks.session_min:
        until = progress.last_ended_at + round(3600 * breaks.between_sessions_h)
        return StudyStep(StepKind.BREAK, until=until, ends_session=True)
    until = progress.last_ended_at + round(breaks.between_drives_s)
    return StudyStep(StepKind.BREAK, until=until) if now < until else None
