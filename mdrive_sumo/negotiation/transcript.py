"""Transcripts: every exchange with a language model as a line of JSON, and their replay."""

import hashlib
import json
import os
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.input_files import read_text
from mdrive_sumo.negotiation.llm_endpoint import ChatCompletion, LanguageModelError

FIELDS = ("seed", "ordinal", "digest", "request", "answer", "tokens", "error")


def compute_request_digest(request: Mapping[str, Any]) -> str:
    """Return a digest of the contents of a request."""
    text = json.dumps(request, sort_keys=True, separators=(",", ":"))
    return hashlib.blake2b(text.encode(), digest_size=16).hexdigest()


def format_exchange(
    seed: int, ordinal: int, request: Mapping[str, Any], outcome: ChatCompletion | LanguageModelError
) -> str:
    """Return an exchange as one line of JSON in ASCII."""
    entry: dict[str, Any] = {
        "seed": seed,
        "ordinal": ordinal,
        "digest": compute_request_digest(request),
        "request": request,
    }
    if isinstance(outcome, ChatCompletion):
        entry |= {"answer": outcome.text, "tokens": outcome.tokens}
    else:
        entry |= {"error": [outcome.kind, str(outcome)]}
    return json.dumps(entry, sort_keys=True, separators=(",", ":"))


class LanguageModelTranscript:
    """The answers that one agent received in a recorded run, by request, in their order."""

    def __init__(self, path: Path, seed: int) -> None:
        """Read the lines of the agent with that seed. Raises InputError for a file that is no transcript."""
        self._outcome_by_request: dict[tuple[str, int], ChatCompletion | LanguageModelError] = {}
        self._request_counts: Counter[str] = Counter()
        counts: Counter[str] = Counter()
        for ordinal, digest, outcome in sorted(_read_lines(path, seed), key=lambda line: line[0]):
            del ordinal
            self._outcome_by_request[digest, counts[digest]] = outcome
            counts[digest] += 1

    def replay(self, request: Mapping[str, Any]) -> ChatCompletion:
        """Return the recorded answer; raise the recorded error, or one of kind "missing" for an unknown request."""
        digest = compute_request_digest(request)
        outcome = self._outcome_by_request.get((digest, self._request_counts[digest]))
        self._request_counts[digest] += 1
        if outcome is None:
            raise LanguageModelError("missing", f"the transcript has no answer to request {digest}")
        if isinstance(outcome, LanguageModelError):
            raise outcome
        return outcome


def load_outcomes(path: Path, seed: int) -> tuple[ChatCompletion | LanguageModelError, ...]:
    """Return the answers to the agent with that seed, in order. Raises InputError for a file that is no transcript."""
    return tuple(outcome for _, _, outcome in sorted(_read_lines(path, seed), key=lambda line: line[0]))


def check_transcript(path: Path) -> None:
    """Raise InputError if the file cannot be read as a transcript."""
    for _ in _read_lines(path, -1):
        pass


def is_of_model_on_board(path: Path) -> bool | None:
    """Return whether the answers of a transcript are those of a model on board; None for one without any.

    Raises InputError for a file that is no transcript.
    """
    check_transcript(path)
    if str(path) == os.devnull:
        return None
    first = next((line for line in read_text(path).splitlines() if line.strip()), None)
    if first is None:
        return None
    request = json.loads(first).get("request")
    return isinstance(request, dict) and "task" in request


def _read_lines(path: Path, seed: int) -> list[tuple[int, str, ChatCompletion | LanguageModelError]]:
    """Return (ordinal, request digest, outcome) of the lines of one agent."""
    try:
        lines = [] if str(path) == os.devnull else read_text(path).splitlines()
    except (OSError, ValueError) as error:
        raise InputError(f"transcript {path}: expected a text file, found none ({error})") from None
    found = [_parse_entry(path, number, line) for number, line in enumerate(lines, 1) if line.strip()]
    return [(ordinal, digest, outcome) for owner, ordinal, digest, outcome in found if owner == seed]


def _parse_entry(path: Path, number: int, line: str) -> tuple[int, int, str, ChatCompletion | LanguageModelError]:
    """Return (seed, ordinal, request digest, outcome) of a line."""
    try:
        entry = json.loads(line)
        seed, ordinal, digest = entry["seed"], entry["ordinal"], entry["digest"]
        if type(seed) is not int or type(ordinal) is not int or not isinstance(digest, str):
            raise TypeError
        if "error" in entry:
            kind, text = entry["error"]
            return seed, ordinal, digest, _restore_error(str(kind), str(text))
        if not isinstance(entry["answer"], str):
            raise TypeError
        tokens = entry.get("tokens", 0)
        if type(tokens) is not int or tokens < 0:
            raise TypeError
        return seed, ordinal, digest, ChatCompletion(entry["answer"], tokens)
    except (ValueError, KeyError, TypeError, RecursionError):
        raise InputError(
            f"transcript {path}: line {number}: expected an exchange with {', '.join(FIELDS)}, found {line!r:.60}"
        ) from None


def _restore_error(kind: str, text: str) -> LanguageModelError:
    """Return the error that was recorded."""
    return LanguageModelError(kind, text.removeprefix(f"{kind}: "))
