"""Parses the answer of a language model as a proposal, or reports its problems in words that the model can act on."""

from pathlib import Path

from pydantic import ValidationError

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.input_files import read_bytes
from mdrive_sumo.generate.category_requirements import Category
from mdrive_sumo.generate.proposal import Proposal
from mdrive_sumo.generate.rules import find_rule_violations
from mdrive_sumo.scenario.scenario import shorten_value

END_OF_THOUGHT = "</think>"
"""End marker of the reasoning that some models print before they answer."""
MAX_REPORTED = 12
"""Largest number of problems reported to a model at once."""


def parse_proposal(text: str, category: Category) -> Proposal:
    """Return the valid proposal of that category in an answer; raises ValueError with all problems in one line.

    Code fences and text around the JSON object are ignored.
    """
    answer = text.rpartition(END_OF_THOUGHT)[2]
    start, end = answer.find("{"), answer.rfind("}")
    if start < 0 or end < start:
        raise ValueError("expected one JSON object, found none")
    try:
        proposal = Proposal.model_validate_json(answer[start : end + 1])
    except ValidationError as error:
        raise ValueError(_join_problems(_describe_errors(error))) from None
    if proposal.category is not category:
        raise ValueError(f"category: expected {category}, found {proposal.category}")
    if wrong := find_rule_violations(proposal):
        raise ValueError(_join_problems(list(wrong)))
    return proposal


def load_demonstrations(folder: Path, category: Category) -> tuple[Proposal, ...]:
    """Return the proposals of that category in the folder's .json files, by name; raises InputError for an invalid
    file."""
    if not folder.is_dir():
        raise InputError(f"examples {folder}: expected a folder of proposals, found none")
    return tuple(
        found for path in sorted(folder.glob("*.json")) if (found := _load_demonstration(path)).category == category
    )


def _load_demonstration(path: Path) -> Proposal:
    try:
        proposal = Proposal.model_validate_json(read_bytes(path))
    except OSError as error:
        raise InputError(f"example {path}: cannot be read: {error.strerror}") from None
    except ValidationError as error:
        raise InputError(f"example {path}: {_describe_errors(error)[0]}") from None
    if wrong := find_rule_violations(proposal):
        raise InputError(f"example {path}: {wrong[0]}")
    return proposal


def _describe_errors(error: ValidationError) -> list[str]:
    """Return one sentence (where, expected, found) for each schema violation."""
    return [
        f"{'.'.join(map(str, problem['loc'])) or 'the answer'}: {problem['msg']}"
        + ("" if problem["type"] in ("missing", "json_invalid") else f", found {shorten_value(problem['input'])}")
        for problem in error.errors(include_url=False)
    ]


def _join_problems(sentences: list[str]) -> str:
    more = len(sentences) - MAX_REPORTED
    return "; ".join(sentences[:MAX_REPORTED]) + (f"; and {more} more" if more > 0 else "")
