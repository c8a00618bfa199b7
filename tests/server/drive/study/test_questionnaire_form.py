"""Answers are kept as the plan asks, or told in one sentence what is wrong with them."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import TypeAdapter

from mdrive_sumo.study.human.human_study_plan import Question
from server.drive.study.questionnaire_form import read_answers

QUESTIONS: tuple[Question, ...] = tuple(
    TypeAdapter(Question).validate_python({"text": "?", **item})
    for item in (
        {"id": "scale", "kind": "likert", "points": 5},
        {"id": "effort", "kind": "number", "least": -1, "most": 100},
        {"id": "device", "kind": "choice", "options": ["wheel", "keyboard"]},
        {"id": "comment", "kind": "text", "max_length": 10, "optional": True},
    )
)
GOOD = {"scale": "3", "effort": "12,5", "device": "wheel", "comment": " fine "}


def test_answers_of_every_kind_are_kept() -> None:
    given = read_answers(QUESTIONS, GOOD | {"unknown": "x"})
    assert given.problems == {}
    assert given.answers == {"scale": 3.0, "effort": 12.5, "device": "wheel", "comment": "fine"}


@pytest.mark.parametrize(
    ("name", "text", "sentence"),
    [
        ("scale", "", "expected an answer, found none"),
        ("scale", "6", "expected a number from 1 to 5, found '6'"),
        ("scale", "3.0", "expected a number from 1 to 5"),
        ("effort", "much", "expected a number from -1 to 100, found 'much'"),
        ("effort", "nan", "expected a number from -1 to 100"),
        ("effort", "1e9", "expected a number from -1 to 100"),
        ("device", "horse", "expected one of wheel, keyboard, found 'horse'"),
        ("comment", "x" * 11, "expected at most 10 characters, found 11"),
    ],
)
def test_what_cannot_be_kept_is_told(name: str, text: str, sentence: str) -> None:
    given = read_answers(QUESTIONS, GOOD | {name: text})
    assert [*given.problems] == [name]
    assert given.problems[name].startswith(sentence)


def test_only_optional_questions_may_stay_without_an_answer() -> None:
    given = read_answers(QUESTIONS, {})
    assert {*given.problems} == {"scale", "effort", "device"}
    assert given.answers["comment"] is None


@given(st.dictionaries(st.sampled_from(["scale", "effort", "device", "comment"]), st.text(max_size=20)))
def test_any_form_has_an_answer_or_a_problem_for_every_question(form: dict[str, str]) -> None:
    given = read_answers(QUESTIONS, form)
    assert {*given.answers} | {*given.problems} == {"scale", "effort", "device", "comment"}
