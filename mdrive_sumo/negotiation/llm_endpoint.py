"""The language model's endpoint: one request over HTTP, in a bounded time and a bounded size."""

import json
import os
from dataclasses import dataclass
from typing import Any

MAX_BODY_BYTES = 262_144
"""An answer's body is cut off there."""
MAX_ANSWER_CHARS = 2000
"""256 tokens are some 1000 characters."""
PATH = "/chat/completions"


class LanguageModelError(Exception):
    """The model gave no answer. `kind` says why in one word."""

    def __init__(self, kind: str, text: str) -> None:
        super().__init__(f"{kind}: {text}"[:300])
        self.kind = kind


@dataclass(frozen=True, slots=True)
class ChatCompletion:
    """What a model said, and how many tokens the exchange took, as far as the endpoint tells."""

    text: str
    tokens: int = 0


def build_completions_url(endpoint: str) -> str:
    """The address of an OpenAI-compatible endpoint of which its root, its /v1 or the whole address is given."""
    base = endpoint.rstrip("/")
    if base.endswith(PATH):
        return base
    return base + PATH if base.endswith("/v1") else f"{base}/v1{PATH}"


def request_completion(
    endpoint: str,
    request: dict[str, Any],
    timeout_s: float,
    key_variable: str = "",
    max_chars: int = MAX_ANSWER_CHARS,
) -> ChatCompletion:
    """Posts a chat completion request; raises ModelError. Never takes longer than the time-out [s] or so.

    Redirects are not followed: they would carry the key elsewhere. The key is read from the environment variable of
    that name for every request, and kept nowhere.
    """
    import asyncio  # slow to import, as httpx is, and most agents need neither

    headers = {"Accept-Encoding": "identity", "Content-Type": "application/json"}
    if key_variable:
        headers["Authorization"] = f"Bearer {os.environ.get(key_variable, '')}"
    status, body = asyncio.run(
        _posted(build_completions_url(endpoint), json.dumps(request).encode(), headers, timeout_s)
    )
    if status != 200:
        raise LanguageModelError("status", f"HTTP status {status}")
    return _answer(body, max_chars)


async def _posted(url: str, content: bytes, headers: dict[str, str], timeout_s: float) -> tuple[int, bytes]:
    """(status, body). The time-out is for everything together, so nobody can drip bytes for ever."""
    import asyncio

    import httpx

    body = bytearray()
    try:
        async with (
            asyncio.timeout(timeout_s),
            httpx.AsyncClient(timeout=None, follow_redirects=False) as client,
            client.stream("POST", url, content=content, headers=headers) as response,
        ):
            async for chunk in response.aiter_raw(65_536):
                body += chunk
                if len(body) > MAX_BODY_BYTES:
                    raise LanguageModelError("size", f"more than {MAX_BODY_BYTES} bytes")
            return response.status_code, bytes(body)
    except TimeoutError:
        raise LanguageModelError("timeout", f"no answer within {timeout_s:g} s") from None
    except (httpx.HTTPError, httpx.InvalidURL, UnicodeError, OSError, OverflowError, ExceptionGroup) as error:
        raise LanguageModelError("connection", type(error).__name__) from None


def _answer(body: bytes, max_chars: int) -> ChatCompletion:
    """The first choice's text; whatever else the body is raises ModelError."""
    try:
        data = json.loads(body)
        text = data["choices"][0]["message"]["content"]
    except (ValueError, RecursionError):
        raise LanguageModelError("json", "the body is no JSON") from None
    except (KeyError, IndexError, TypeError):
        raise LanguageModelError("choices", "no choices[0].message.content") from None
    if not isinstance(text, str):
        raise LanguageModelError("choices", "no text in choices[0].message.content")
    if len(text) > max_chars:
        raise LanguageModelError("length", f"{len(text)} characters, at most {max_chars} are allowed")
    return ChatCompletion(text, _tokens(data.get("usage")))


def _tokens(usage: object) -> int:
    found = usage.get("total_tokens") if isinstance(usage, dict) else None
    return found if type(found) is int and 0 <= found < 1_000_000 else 0
