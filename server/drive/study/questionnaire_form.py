"""Answers to a questionnaire, read from a submitted form and checked against the plan."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from mdrive_sumo.study.human.human_study_plan import (
    ChoiceQuestion,
    LikertQuestion,
    NumberQuestion,
    Question,
    TextQuestion,
)
from mdrive_sumo.study.human.participant_progress import Answer


@dataclass(frozen=True, slots=True)
class FormAnswers:
    """Answers by question, and one sentence for each that cannot be kept."""

    answers: Mapping[str, Answer]
    problems: Mapping[str, str]


def read_answers(questions: Sequence[Question], form: Mapping[str, object]) -> FormAnswers:
    """Return the answers of a form, whose fields have the ids of the questions. Unknown fields are dropped."""
    answers: dict[str, Answer] = {}
    problems: dict[str, str] = {}
    for question in questions:
        given = form.get(question.id)
        text = given.strip() if isinstance(given, str) else ""
        if not text:
            answers[question.id] = None
            if not question.optional:
                problems[question.id] = "expected an answer, found none"
            continue
        try:
            answers[question.id] = _read_answer(question, text)
        except ValueError as error:
            problems[question.id] = str(error)
    return FormAnswers(answers, problems)


def _read_answer(question: Question, text: str) -> Answer:
    """Return the answer of a field. Raises ValueError with one sentence."""
    match question:
        case LikertQuestion():
            options = [str(point) for point in range(1, question.points + 1)]
            if text not in options:
                raise ValueError(f"expected a number from 1 to {question.points}, found {text!r:.40}")
            return float(text)
        case NumberQuestion():
            return _read_number(question, text)
        case ChoiceQuestion():
            if text not in question.options:
                raise ValueError(f"expected one of {', '.join(question.options)}, found {text!r:.40}")
            return text
        case TextQuestion():
            if len(text) > question.max_length:
                raise ValueError(f"expected at most {question.max_length} characters, found {len(text)}")
            return text.encode("utf-8", "replace").decode()


def _read_number(question: NumberQuestion, text: str) -> float:
    expected = f"expected a number from {question.least:g} to {question.most:g}, found {text!r:.40}"
    try:
        value = float(text.replace(",", "."))
    except ValueError:
        raise ValueError(expected) from None
    if not math.isfinite(value) or not question.least <= value <= question.most:
        raise ValueError(expected)
    return value
