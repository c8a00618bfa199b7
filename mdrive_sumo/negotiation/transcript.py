"""Transcripts: every exchange with a language model as a line of JSON, and a model that repeats them."""

import hashlib
import json
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.negotiation.llm_endpoint import ChatCompletion, LanguageModelError

FIELDS = ("seed", "ordinal", "digest", "request", "answer", "tokens", "error")


def compute_request_digest(request: Mapping[str, Any]) -> str:
    """Names a request by its contents."""
    text = json.dumps(request, sort_keys=True, separators=(",", ":"))
    return hashlib.blake2b(text.encode(), digest_size=16).hexdigest()


def format_exchange(
    seed: int, ordinal: int, request: Mapping[str, Any], outcome: ChatCompletion | LanguageModelError
) -> str:
    """An exchange as a line, without line ends in it: pure ASCII, whatever was said."""
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
    """What one agent was told in a recorded run: by request, in the order in which it was asked."""

    def __init__(self, path: Path, seed: int) -> None:
        """Reads the lines of the agent with that seed; raises InputError for a file that is no transcript."""
        self._told: dict[tuple[str, int], ChatCompletion | LanguageModelError] = {}
        self._asked: Counter[str] = Counter()
        counts: Counter[str] = Counter()
        for ordinal, digest, outcome in sorted(_lines(path, seed), key=lambda line: line[0]):
            del ordinal
            self._told[digest, counts[digest]] = outcome
            counts[digest] += 1

    def replay(self, request: Mapping[str, Any]) -> ChatCompletion:
        """The recorded answer; raises ModelError as recorded, or of the kind "missing" if this was never asked."""
        digest = compute_request_digest(request)
        outcome = self._told.get((digest, self._asked[digest]))
        self._asked[digest] += 1
        if outcome is None:
            raise LanguageModelError("missing", f"the transcript has no answer to request {digest}")
        if isinstance(outcome, LanguageModelError):
            raise outcome
        return outcome


def load_outcomes(path: Path, seed: int) -> tuple[ChatCompletion | LanguageModelError, ...]:
    """What the agent with that seed was told, in this order; raises InputError for a file that is no transcript."""
    return tuple(outcome for _, _, outcome in sorted(_lines(path, seed), key=lambda line: line[0]))


def check_transcript(path: Path) -> None:
    """Raises InputError if the file cannot be read as a transcript."""
    for _ in _lines(path, -1):
        pass


def _lines(path: Path, seed: int) -> list[tuple[int, str, ChatCompletion | LanguageModelError]]:
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, ValueError) as error:
        raise InputError(f"transcript {path}: expected a text file, found none ({error})") from None
    found = [_entry(path, number, line) for number, line in enumerate(lines, 1) if line.strip()]
    return [(ordinal, digest, outcome) for owner, ordinal, digest, outcome in found if owner == seed]


def _entry(path: Path, number: int, line: str) -> tuple[int, int, str, ChatCompletion | LanguageModelError]:
    try:
        entry = json.loads(line)
        seed, ordinal, digest = entry["seed"], entry["ordinal"], entry["digest"]
        if type(seed) is not int or type(ordinal) is not int or not isinstance(digest, str):
            raise TypeError
        if "error" in entry:
            kind, text = entry["error"]
            return seed, ordinal, digest, _again(str(kind), str(text))
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


def _again(kind: str, text: str) -> LanguageModelError:
    return LanguageModelError(kind, text.removeprefix(f"{kind}: "))
