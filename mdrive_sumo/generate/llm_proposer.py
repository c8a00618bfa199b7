"""Proposer that queries an OpenAI-compatible language model and reports problems back to it until the proposal is
valid.

Paper, "Agentic scenario generation": category descriptions and demonstrations in context, validation by rules.
"""

import json
import re
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from mdrive_sumo.contract import EXCHANGE, Note
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.output_files import make_parents, write_text
from mdrive_sumo.core.seeding import derive_seed
from mdrive_sumo.generate.category_requirements import Category
from mdrive_sumo.generate.llm_answer import load_demonstrations, parse_proposal
from mdrive_sumo.generate.llm_prompt import build_prompt
from mdrive_sumo.generate.proposal import Proposal
from mdrive_sumo.generate.rejection import PipelineStage, ProposalRejected
from mdrive_sumo.negotiation.language_model import LanguageModel, LanguageModelSettings, check_settings
from mdrive_sumo.negotiation.llm_endpoint import ChatCompletion
from mdrive_sumo.negotiation.transcript import load_outcomes
from mdrive_sumo.runs.evaluate import report_write_errors

MAX_TOKENS = 4096
MAX_ANSWER_CHARS = 32_000
"""Ten times a long indented proposal; the rest is for models that print their reasoning."""
INVALID = "answer: "
"""Prefix of the reason if the last answer was not a valid proposal; without it there was no answer."""


@dataclass(frozen=True, slots=True)
class LlmSettings:
    """Settings of the model, its examples and its transcripts."""

    endpoint: str = ""
    """Address of any OpenAI-compatible chat completions service; unused in a replay."""
    model: str = "default"
    api_key_env: str = ""
    """Name of the environment variable with the key; "": no key. The key itself is never stored."""
    attempts: int = 3
    """Requests for one proposal, including failed ones and repairs."""
    timeout_s: float = 60.0
    """[s] Limit for one request."""
    temperature: float = 0.7
    examples: Path | None = None
    """Folder of expert demonstrations: proposals as JSON files, all categories together."""
    transcripts: Path | None = None
    """Folder for all exchanges, one file per proposal."""
    replay: Path | None = None
    """Folder of transcripts to replay; no request is sent."""


def propose(category: Category, seed: str, settings: LlmSettings) -> Proposal:
    """Return a valid proposal of the category; different seeds give different ones.

    Raises ProposalRejected if the last attempt was not a valid proposal either, InputError if there was no answer at
    all.
    """
    if settings.replay is not None:
        return _replay(category, seed, settings.replay)
    number = _model_seed(category, seed)
    examples = load_demonstrations(settings.examples, category) if settings.examples else ()
    model = LanguageModel(_model_settings(settings), number)
    proposal = model.ask(
        build_prompt(category, number, examples), MAX_TOKENS, lambda text: parse_proposal(text, category)
    )
    if settings.transcripts is not None:
        _save_transcript(model.notes, category, transcript_path(settings.transcripts, category, seed))
    if proposal is None:
        raise _build_error(category, model.notes[-1].text)
    return proposal


def transcript_path(folder: Path, category: Category, seed: str) -> Path:
    """Return the path of the exchanges of one proposal."""
    return folder / (re.sub(r"[^\w.-]+", "_", f"{category}_{seed}") + ".jsonl")


def _replay(category: Category, seed: str, folder: Path) -> Proposal:
    """Return the proposal that a recorded model produced, under the current rules; raises as it did."""
    path = transcript_path(folder, category, seed)
    reason = "the transcript has no exchange for this category and seed"
    for outcome in load_outcomes(path, _model_seed(category, seed)):
        if not isinstance(outcome, ChatCompletion):
            reason = str(outcome)
            continue
        try:
            return parse_proposal(outcome.text, category)
        except ValueError as error:
            reason = f"{INVALID}{error}"
    raise _build_error(category, reason)


def _model_seed(category: Category, seed: str) -> int:
    """Return the seed as the model sees it; a private seed stays private."""
    return derive_seed(0, "proposal", category, seed)


def _model_settings(settings: LlmSettings) -> LanguageModelSettings:
    if not 1 <= settings.attempts <= 10:
        raise InputError(f"language model: attempts: expected 1 to 10, found {settings.attempts}")
    if not 0 < settings.timeout_s <= 600:
        raise InputError(
            f"language model: timeout_s: expected more than 0 and at most 600, found {settings.timeout_s:g}"
        )
    if not 0 <= settings.temperature <= 2:
        raise InputError(f"language model: temperature: expected 0 to 2, found {settings.temperature:g}")
    return check_settings(
        LanguageModelSettings(
            endpoint=settings.endpoint,
            model=settings.model,
            api_key_env=settings.api_key_env,
            timeout_s=settings.timeout_s,
            tries=settings.attempts,
            max_answer_chars=MAX_ANSWER_CHARS,
            temperature=settings.temperature,
        )
    )


def _build_error(category: Category, reason: str) -> ProposalRejected | InputError:
    if reason.startswith(INVALID):
        wrong = textwrap.shorten(reason.removeprefix(INVALID), 300)
        return ProposalRejected(
            PipelineStage.RULES, f"the language model never proposed a valid {category}; the last time: {wrong}"
        )
    return InputError(f"language model: expected a proposal for {category}, found no answer: {reason}")


def _save_transcript(notes: Sequence[Note], category: Category, path: Path) -> None:
    """Write one line of JSON per exchange: request, answer or error, and the problems of the answer."""
    lines = [_format_exchange(note.text, category) for note in notes if note.kind == EXCHANGE]
    with report_write_errors(path):
        make_parents(path)
        write_text(path, "".join(lines))


def _format_exchange(exchange: str, category: Category) -> str:
    entry = json.loads(exchange)
    if "answer" in entry:
        try:
            parse_proposal(entry["answer"], category)
        except ValueError as error:
            entry["problems"] = str(error)
    return json.dumps(entry, sort_keys=True, separators=(",", ":")) + "\n"
