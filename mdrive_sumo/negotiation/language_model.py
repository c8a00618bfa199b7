"""Access to a language model with retries, a budget, and a record of every exchange."""

import os
import re
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import urlsplit

from mdrive_sumo.contract import EXCHANGE, Note
from mdrive_sumo.contract.agent_options import Config, Option, read_options
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.negotiation.llm_endpoint import (
    MAX_ANSWER_CHARS,
    ChatCompletion,
    LanguageModelError,
    request_completion,
)
from mdrive_sumo.negotiation.transcript import LanguageModelTranscript, check_transcript, format_exchange

FALLBACK = "llm-fallback"
"""Kind of the notes of a place where the rule decided because the model gave nothing usable."""
FINAL_FAILURES = ("timeout", "missing")
"""Kinds of failure after which a request is not repeated."""
FIRST_PAUSE_S = 0.5
"""Pause before the first retry after an HTTP error; doubled for every further one."""

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class LanguageModelSettings:
    """The model, and the budget of one CAV in one episode."""

    endpoint: str = ""
    """URL of a service with OpenAI's chat completions API; unused if there is a transcript."""
    model: str = "default"
    """Name of the model, as the endpoint knows it."""
    api_key_env: str = ""
    """Name of the environment variable with the key; "": no key."""
    transcript: str = ""
    """A .jsonl file with recorded exchanges, which replaces the endpoint."""
    timeout_s: float = 30.0
    """For one exchange."""
    tries: int = 3
    """Attempts per request (protocol K17)."""
    max_calls: int = 300
    """Requests of one CAV in an episode."""
    max_tokens_total: int = 400_000
    """Counted from the usage that the endpoint reports."""
    give_up_after: int = 3
    """No further requests after this many failures in a row."""
    max_answer_chars: int = MAX_ANSWER_CHARS
    """A longer answer counts as a failure."""
    temperature: float = 0
    """0: the most likely answer."""


def check_settings(settings: LanguageModelSettings) -> LanguageModelSettings:
    """Return the settings; raise InputError if they name neither a valid endpoint nor a readable transcript."""
    if settings.transcript:
        check_transcript(Path(settings.transcript))
        return settings
    if not _is_address(settings.endpoint):
        raise InputError(  # options are recorded, so the URL must not contain a key
            "language model: option endpoint: expected the URL of an OpenAI-compatible service without user, password,"
            f" or query, or a transcript, found {re.sub('//.*@', '//...@', settings.endpoint)!r:.60}"
        )
    if settings.api_key_env and not os.environ.get(settings.api_key_env):
        raise InputError(
            "language model: option api_key_env: expected the name of a set environment variable, found"
            f" {settings.api_key_env!r}"
        )
    return settings


class LanguageModel:
    """One CAV's access to the model during one episode."""

    def __init__(self, settings: LanguageModelSettings, seed: int) -> None:
        self._settings, self._seed = settings, seed
        self._transcript = LanguageModelTranscript(Path(settings.transcript), seed) if settings.transcript else None
        self._ordinal = 0
        self._tokens = 0
        self._failed = 0
        self.notes: list[Note] = []
        """Notes to record; the caller removes them from here."""

    def ask(self, conversation: list[dict[str, str]], max_tokens: int, read: Callable[[str], T]) -> T | None:
        """Return the answer of the model as parsed by `read`, which raises ValueError for an unusable one.

        None if there is no usable answer: the reason is noted as a fallback.
        """
        reason = self._find_exhausted_budget()
        pause = 0.0
        for _ in range(self._settings.tries if reason is None else 0):
            request = self._build_request(conversation, max_tokens)
            try:
                answer = self._exchange(request, partial(self._complete, request, pause))
            except LanguageModelError as error:
                reason = str(error)
                if error.kind in FINAL_FAILURES:
                    break
                pause = 2 * pause or FIRST_PAUSE_S if error.kind == "status" else 0.0
                continue
            try:
                parsed = read(answer.text)
            except ValueError as error:
                reason = f"answer: {error}"
                conversation = conversation + _build_correction(
                    answer.text[: self._settings.max_answer_chars // 4], str(error)
                )
            else:
                self._failed = 0
                return parsed
        return self._fail(str(reason))

    def ask_on_board(
        self, request: Mapping[str, Any], write: Callable[[], ChatCompletion], read: Callable[[str], T]
    ) -> T | None:
        """Return the answer of a model on board as parsed by `read`, as `ask` does; it is asked once.

        request: what the transcript has of it. write: returns the answer, and raises LanguageModelError.
        """
        reason = self._find_exhausted_budget()
        if reason is not None:
            return self._fail(reason)
        try:
            answer = self._exchange(request, write)
            parsed = read(answer.text)
        except LanguageModelError as error:
            return self._fail(str(error))
        except ValueError as error:
            return self._fail(f"answer: {error}")
        self._failed = 0
        return parsed

    def _fail(self, reason: str) -> None:
        """Count a request without a usable answer, and note that the rule decides."""
        self._failed += 1
        self.notes.append(Note(FALLBACK, reason))

    def _find_exhausted_budget(self) -> str | None:
        """Return why no further request is allowed, or None."""
        if self._failed >= self._settings.give_up_after:
            return f"given up: after {self._settings.give_up_after} failures in a row"
        if self._ordinal >= self._settings.max_calls:
            return f"budget: {self._settings.max_calls} calls"
        if self._tokens >= self._settings.max_tokens_total:
            return f"budget: {self._settings.max_tokens_total} tokens"
        return None

    def _build_request(self, conversation: list[dict[str, str]], max_tokens: int) -> dict[str, Any]:
        """Return the body of a chat completion request."""
        return {
            "model": self._settings.model,
            "messages": conversation,
            "max_tokens": max_tokens,
            "temperature": self._settings.temperature,
            "seed": self._seed,
        }

    def _exchange(self, request: Mapping[str, Any], complete: Callable[[], ChatCompletion]) -> ChatCompletion:
        """Return the recorded answer, or that of `complete`; note it, whatever it is. Raises LanguageModelError."""
        try:
            answer = complete() if self._transcript is None else self._transcript.replay(request)
        except LanguageModelError as error:
            self._note(request, error)
            raise
        self._note(request, answer)
        self._tokens += answer.tokens
        return answer

    def _complete(self, request: Mapping[str, Any], pause: float) -> ChatCompletion:
        """Return the completion of the endpoint, asked after a pause [s]. Raises LanguageModelError."""
        settings = self._settings
        if pause:
            time.sleep(min(pause, settings.timeout_s / 4))
        limit = settings.max_answer_chars
        return request_completion(settings.endpoint, dict(request), settings.timeout_s, settings.api_key_env, limit)

    def _note(self, request: Mapping[str, Any], outcome: ChatCompletion | LanguageModelError) -> None:
        """Note an exchange."""
        self.notes.append(Note(EXCHANGE, format_exchange(self._seed, self._ordinal, request, outcome)))
        self._ordinal += 1


def _build_correction(answer: str, error: str) -> list[dict[str, str]]:
    """Return the messages that ask the model to correct its answer."""
    return [
        {"role": "assistant", "content": answer or "(nothing)"},
        {"role": "user", "content": f"That cannot be used: {error}. Answer again, in the form asked for."},
    ]


def _is_address(endpoint: str) -> bool:
    """Return whether it is an HTTP URL without user, password or query, and with a valid port if there is one."""
    try:
        return bool(re.fullmatch(r"https?://[^/\s@?#]+(/[^\s@?#]*)?", endpoint)) and urlsplit(endpoint).port != 0
    except ValueError:
        return False


TEXTS: Mapping[str, str] = {
    "endpoint": "",
    "model": "default",
    "api_key_env": "",
    "transcript": "",
    "rounds": "channel",
}
NUMBERS: Mapping[str, Option] = {
    "timeout_s": Option(30.0, 0.1, 600.0),
    "tries": Option(3, 1, 10),
    "max_calls": Option(300, 0, 100_000),
    "max_tokens_total": Option(400_000, 0, 1e9),
    "give_up_after": Option(3, 1, 1000),
}
ROUNDS = ("channel", "instant")


def read_llm_options(
    agent: str, config: Config, others: tuple[str, ...] = (), is_on_board: bool = False
) -> tuple[LanguageModelSettings, bool]:
    """Return the settings of the model and whether rounds are instant; others: names of options read elsewhere.

    is_on_board: the model needs neither an endpoint nor a transcript. Raises InputError for an unknown name or an
    invalid value.
    """
    unknown = sorted(set(config) - set(TEXTS) - set(NUMBERS))
    if unknown:
        known = ", ".join(sorted((*TEXTS, *NUMBERS, *others)))
        raise InputError(f"agent {agent}: expected options among ({known}), found {unknown[0]!r}")
    texts = {name: _read_text(agent, name, config.get(name, default)) for name, default in TEXTS.items()}
    numbers = read_options(agent, {name: config[name] for name in NUMBERS if name in config}, NUMBERS)
    rounds = texts["rounds"]
    if rounds not in ROUNDS:
        raise InputError(f"agent {agent}: option rounds: expected {' or '.join(ROUNDS)}, found {rounds!r}")
    settings = LanguageModelSettings(
        endpoint=texts["endpoint"],
        model=texts["model"],
        api_key_env=texts["api_key_env"],
        transcript=texts["transcript"],
        timeout_s=numbers["timeout_s"],
        tries=int(numbers["tries"]),
        max_calls=int(numbers["max_calls"]),
        max_tokens_total=int(numbers["max_tokens_total"]),
        give_up_after=int(numbers["give_up_after"]),
    )
    if not is_on_board or settings.transcript:
        check_settings(settings)
    return settings, rounds == "instant"


def _read_text(agent: str, name: str, value: object) -> str:
    """Return the value; raise InputError unless it is a text."""
    if not isinstance(value, str):
        raise InputError(f"agent {agent}: option {name}: expected a text, found {value!r}")
    return value
