"""The next step of a participant follows from plan and progress, whatever happened before."""

import itertools
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from testing.human_study import FIRST, PAIRED, make_plan

from mdrive_sumo.study.human.drive_order import plan_drives
from mdrive_sumo.study.human.human_study_plan import HumanStudyPlan
from mdrive_sumo.study.human.participant_progress import (
    DriveEntry,
    ParticipantProgress,
    StepKind,
    StudyStep,
    find_step,
    must_practise,
)


def make_entry(step: StudyStep) -> DriveEntry:
    assert step.drive is not None
    kind = "practice" if step.kind is StepKind.PRACTICE else "counted"
    drive = step.drive
    return DriveEntry(
        kind=kind,
        number=drive.number,
        scenario=drive.scenario.id,
        cav=drive.cav,
        condition=drive.condition.name,
        folder=f"{kind}/{drive.name}",
    )


def walk(plan: HumanStudyPlan, successes: list[bool], pause_s: int = 0, drive_s: int = 60) -> list[StepKind]:
    """Do every step at once until the end; return the kinds. Breaks are waited for."""
    progress, now, kinds = ParticipantProgress(code=plan.codes[0]), 1000, []
    for _ in range(500):
        step = find_step(plan, progress, now)
        kinds.append(step.kind)
        if step.kind is StepKind.THANKS:
            return kinds
        if step.kind is StepKind.CONSENT:
            progress = progress.consent(now)
        elif step.kind is StepKind.BREAK:
            assert step.until > now
            now = step.until
        elif step.drive is not None:
            progress = progress.open_drive(make_entry(step), plan.breaks, now)
            assert find_step(plan, progress, now).kind is StepKind.DRIVING
            now += drive_s
            progress = progress.end_drive("take", successes.pop(0) if successes else True, now)
        elif step.kind is StepKind.QUESTIONS:
            progress = progress.answer_drive({"safe": 1.0})
        else:
            progress = progress.answer_end({})
        now += pause_s
    raise AssertionError("expected an end")


def test_steps_from_consent_to_thanks() -> None:
    kinds = walk(make_plan(scenarios=[FIRST]), [])
    assert kinds == [
        StepKind.CONSENT, StepKind.DRIVE, StepKind.QUESTIONS, StepKind.DRIVE, StepKind.QUESTIONS,
        StepKind.END_QUESTIONS, StepKind.THANKS,
    ]  # fmt: skip


def test_without_questions_only_drives_are_left() -> None:
    kinds = walk(make_plan(questionnaires={}), [])
    assert kinds == [StepKind.CONSENT, *[StepKind.DRIVE] * 4, StepKind.THANKS]


@given(st.lists(st.booleans(), max_size=12), st.integers(1, 3), st.integers(3, 8), st.booleans())
def test_practice_lasts_until_so_many_successes(successes: list[bool], wanted: int, most: int, in_a_row: bool) -> None:
    practice = {"scenarios": [FIRST], "successes": wanted, "at_most": most, "in_a_row": in_a_row}
    plan = make_plan(practice=practice, scenarios=[FIRST])
    drives = walk(plan, [*successes]).count(StepKind.PRACTICE)
    outcomes = [*successes, *[True] * wanted]
    done = [
        count
        for count in range(1, len(outcomes) + 1)
        if (all(outcomes[count - wanted : count]) and count >= wanted if in_a_row else sum(outcomes[:count]) >= wanted)
    ]
    assert drives == min(most, done[0])


def test_practice_of_a_number_of_drives() -> None:
    plan = make_plan(practice={"scenarios": [FIRST], "drives": 3}, scenarios=[FIRST])
    assert walk(plan, [False] * 3).count(StepKind.PRACTICE) == 3


def test_the_pause_between_two_drives_and_between_two_sessions() -> None:
    plan = make_plan(breaks={"between_drives_s": 30, "session_min": 10, "between_sessions_h": 3}, questionnaires={})
    progress = ParticipantProgress(code="P01").consent(0)
    step = find_step(plan, progress, 0)
    progress = progress.open_drive(make_entry(step), plan.breaks, 0).end_drive("take", True, 100)
    waiting = find_step(plan, progress, 129)
    assert (waiting.kind, waiting.until, waiting.ends_session) == (StepKind.BREAK, 130, False)
    assert find_step(plan, progress, 130).kind is StepKind.DRIVE
    over = find_step(plan, progress, 600)
    assert (over.kind, over.until, over.ends_session) == (StepKind.BREAK, 100 + 3 * 3600, True)
    assert find_step(plan, progress, 100 + 3 * 3600 - 1).kind is StepKind.BREAK
    again = find_step(plan, progress, 100 + 3 * 3600)
    assert again.kind is StepKind.DRIVE
    later = progress.open_drive(make_entry(again), plan.breaks, 20_000)
    assert later.session_began_at == 20_000


@given(st.integers(0, 300), st.integers(30, 900))
def test_no_session_is_longer_than_its_cap_and_a_drive(pause_s: int, drive_s: int) -> None:
    breaks = {"between_drives_s": 20, "session_min": 50, "between_sessions_h": 3}
    plan = make_plan(scenarios=[f"s{i}" for i in range(8)], breaks=breaks, questionnaires={})
    progress, now = ParticipantProgress(code="P01").consent(0), 0
    begun: list[int] = []
    while (step := find_step(plan, progress, now)).kind is not StepKind.THANKS:
        if step.kind is StepKind.BREAK:
            now = step.until
            continue
        progress = progress.open_drive(make_entry(step), plan.breaks, now)
        begun.append(now)
        assert progress.session_began_at is not None and now - progress.session_began_at < 50 * 60
        now += drive_s
        progress = progress.end_drive("take", True, now)
        now += pause_s
    assert all(later - earlier >= drive_s + 20 for earlier, later in itertools.pairwise(begun))


def test_programs_wait_for_nothing_and_consent_to_nothing() -> None:
    plan = make_plan(breaks={"between_drives_s": 30, "session_min": 0.1}, questionnaires={})
    progress = ParticipantProgress(code="P01", driver="scripted:attentive")
    for _ in range(4):
        step = find_step(plan, progress, 0)
        progress = progress.open_drive(make_entry(step), plan.breaks, 0).end_drive("take", True, 0)
    assert find_step(plan, progress, 0).kind is StepKind.THANKS


def test_drives_with_a_partner_who_withdrew_are_left_out() -> None:
    plan = make_plan(conditions=PAIRED, questionnaires={})
    progress = ParticipantProgress(code="P01").consent(0)
    drives = plan_drives(plan, "P01")
    names = [drive.condition.name for drive in drives]
    assert sorted(set(names)) == ["alone", "together"]
    seen: list[str] = []
    while (step := find_step(plan, progress, 0, has_partner=False)).drive is not None:
        progress = progress.open_drive(make_entry(step), plan.breaks, 0).end_drive("take", True, 0)
        seen.append(step.drive.condition.name)
    assert seen == ["alone", "alone"]


@pytest.mark.parametrize("field", ["name", "email", "age"])
def test_progress_has_no_room_for_personal_data(field: str) -> None:
    values: dict[str, Any] = {"code": "P01", field: "x"}
    with pytest.raises(ValueError, match=field):
        ParticipantProgress(**values)


def test_nobody_practises_without_practice() -> None:
    assert not must_practise(make_plan(), ParticipantProgress(code="P01"))
