"""Notes of agents for the transcript of the replay page."""

import json
from typing import Any

from mdrive_sumo.contract import DRIVER, EXCHANGE, REASON
from mdrive_sumo.episode import EpisodeRecord, NoteRecord
from mdrive_sumo.report.drivers import read_driver
from mdrive_sumo.report.reasons import read_reason

MAX_CHARS = 4000


def list_notes(episode: EpisodeRecord) -> list[tuple[int, str, str, str, str]]:
    """Return (tick, CAV, kind, text, details) of every note in order; the page shows details on demand.

    Texts have the scenario's ids of stations; reasons are sentences, and those without any text are left out.
    """
    rename = episode.restore_names
    rows: list[tuple[int, str, str, str, str]] = []
    for record in episode.notes:
        if record.note.kind == REASON:
            text, details = _shorten(read_reason(episode, record).text), ""
            if not text:
                continue
        elif record.note.kind == DRIVER and (driver := read_driver(episode, record)) is not None:
            text, details = f"driven by {driver.name}", ""
        else:
            text, details = map(rename, _format_note(record))
        rows.append((record.tick, record.ego, record.note.kind, text, details))
    return rows


def _format_note(record: NoteRecord) -> tuple[str, str]:
    """Return text and details; a note that is no JSON object, or nested deeper than Python's stack, as it is."""
    try:
        content = json.loads(record.note.text)
        if isinstance(content, dict):
            return _format_content(record.note.kind, content)
    except (ValueError, RecursionError):
        pass
    return _shorten(record.note.text), ""


def _format_content(kind: str, content: dict[str, Any]) -> tuple[str, str]:
    if kind != EXCHANGE:
        return _shorten(
            "\n".join(f"{name}: {_format_value(value)}" for name, value in content.items() if value != "")
        ), ""
    if "error" in content:
        parts = content["error"] if isinstance(content["error"], list) else [content["error"]]
        return _shorten("no answer: " + " · ".join(map(_format_value, parts))), _find_prompt(content)
    return _shorten(_format_value(content.get("answer", ""))), _find_prompt(content)


def _find_prompt(exchange: dict[str, Any]) -> str:
    """Return the last message of the request to the model."""
    request = exchange.get("request")
    chat = request.get("messages") if isinstance(request, dict) else None
    last = chat[-1] if isinstance(chat, list) and chat else None
    return _shorten(_format_value(last.get("content", ""))) if isinstance(last, dict) else ""


def _format_value(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{name} {_format_value(part)}" for name, part in value.items())
    if isinstance(value, list):
        return ", ".join(map(_format_value, value))
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)


def _shorten(text: str) -> str:
    return text if len(text) <= MAX_CHARS else text[: MAX_CHARS - 1] + "…"
