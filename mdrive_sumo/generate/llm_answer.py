"""What a language model answered, as a proposal, or what is wrong with it in words it can act on."""

from pathlib import Path

from pydantic import ValidationError

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.generate.category_requirements import Category
from mdrive_sumo.generate.proposal import Proposal
from mdrive_sumo.generate.rules import find_rule_violations
from mdrive_sumo.scenario.scenario import shorten_value

END_OF_THOUGHT = "</think>"
"""Models that reason aloud close it like this before they answer."""
MOST_TOLD = 12
"""Problems that a model is told at once."""


def parse_proposal(text: str, category: Category) -> Proposal:
    """The valid proposal of that category in an answer; raises ValueError with all that is wrong, in one line.

    Code fences and words around the JSON object are forgiven.
    """
    answer = text.rpartition(END_OF_THOUGHT)[2]
    start, end = answer.find("{"), answer.rfind("}")
    if start < 0 or end < start:
        raise ValueError("expected one JSON object, found none")
    try:
        proposal = Proposal.model_validate_json(answer[start : end + 1])
    except ValidationError as error:
        raise ValueError(_listed(_sentences(error))) from None
    if proposal.category is not category:
        raise ValueError(f"category: expected {category}, found {proposal.category}")
    if wrong := find_rule_violations(proposal):
        raise ValueError(_listed(list(wrong)))
    return proposal


def load_demonstrations(folder: Path, category: Category) -> tuple[Proposal, ...]:
    """Proposals of that category in the folder's .json files, by name; raises InputError for a file that is none."""
    if not folder.is_dir():
        raise InputError(f"examples {folder}: expected a folder of proposals, found none")
    return tuple(
        found for path in sorted(folder.glob("*.json")) if (found := _demonstration(path)).category == category
    )


def _demonstration(path: Path) -> Proposal:
    try:
        proposal = Proposal.model_validate_json(path.read_bytes())
    except OSError as error:
        raise InputError(f"example {path}: cannot be read: {error.strerror}") from None
    except ValidationError as error:
        raise InputError(f"example {path}: {_sentences(error)[0]}") from None
    if wrong := find_rule_violations(proposal):
        raise InputError(f"example {path}: {wrong[0]}")
    return proposal


def _sentences(error: ValidationError) -> list[str]:
    """Where, expected, found: one sentence for everything that does not fit the schema."""
    return [
        f"{'.'.join(map(str, problem['loc'])) or 'the answer'}: {problem['msg']}"
        + ("" if problem["type"] in ("missing", "json_invalid") else f", found {shorten_value(problem['input'])}")
        for problem in error.errors(include_url=False)
    ]


def _listed(sentences: list[str]) -> str:
    more = len(sentences) - MOST_TOLD
    return "; ".join(sentences[:MOST_TOLD]) + (f"; and {more} more" if more > 0 else "")
