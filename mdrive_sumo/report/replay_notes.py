"""What agents noted, as the replay viewer lists it beside the scene."""

import json
from typing import Any

from mdrive_sumo.episode import EpisodeRecord, NoteRecord

EXCHANGE = "llm-exchange"
LONGEST_CHARS = 4000


def list_notes(episode: EpisodeRecord) -> list[tuple[int, str, str, str, str]]:
    """(tick, CAV, kind, what to read at once, what to read on demand) in order."""
    return [(note.tick, note.ego, note.note.kind, *_told(note)) for note in episode.notes]


def _told(record: NoteRecord) -> tuple[str, str]:
    try:
        told = json.loads(record.note.text)
    except ValueError:
        return _shortened(record.note.text), ""
    if not isinstance(told, dict):
        return _shortened(record.note.text), ""
    if record.note.kind != EXCHANGE:
        return _shortened("\n".join(f"{name}: {_plain(value)}" for name, value in told.items() if value != "")), ""
    if "error" in told:
        return _shortened("no answer: " + " · ".join(map(_plain, told["error"]))), _asked(told)
    return _shortened(_plain(told.get("answer", ""))), _asked(told)


def _asked(exchange: dict[str, Any]) -> str:
    """What the model was last told."""
    request = exchange.get("request")
    chat = request.get("messages") if isinstance(request, dict) else None
    last = chat[-1] if isinstance(chat, list) and chat else None
    return _shortened(_plain(last.get("content", ""))) if isinstance(last, dict) else ""


def _plain(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{name} {_plain(part)}" for name, part in value.items())
    if isinstance(value, list):
        return ", ".join(map(_plain, value))
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)


def _shortened(text: str) -> str:
    return text if len(text) <= LONGEST_CHARS else text[: LONGEST_CHARS - 1] + "…"
