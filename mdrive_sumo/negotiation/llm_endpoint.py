"""The language model's endpoint: one request over HTTP, in a bounded time and a bounded size."""

import json
import os
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import ssl  # slow to import, as httpx is, and most agents need neither

MAX_BODY_BYTES = 262_144
"""A larger body is refused."""
MAX_ANSWER_CHARS = 2000
"""A longer answer is refused; 256 tokens are about 1000 characters."""
PATH = "/chat/completions"
"""Of OpenAI's chat completions API, below its version."""


class LanguageModelError(Exception):
    """The model gave no answer. `kind` is the reason in one word."""

    def __init__(self, kind: str, text: str) -> None:
        super().__init__(f"{kind}: {text}"[:300])
        self.kind = kind


@dataclass(frozen=True, slots=True)
class ChatCompletion:
    """The text of an answer, and the tokens of the exchange (0 if the endpoint does not report them)."""

    text: str
    tokens: int = 0


def build_completions_url(endpoint: str) -> str:
    """Return the URL for completions of an OpenAI-compatible endpoint, given its root, its /v1 or the whole URL."""
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
    """Post a chat completion request and return the answer, within about `timeout_s` [s].

    Raises LanguageModelError.

    Redirects are not followed: they would send the key to another host. The key is read from the environment variable
    `key_variable` for every request, and is not stored.
    """
    import asyncio  # slow to import, as httpx is, and most agents need neither

    headers = {"Accept-Encoding": "identity", "Content-Type": "application/json"}
    if key_variable:
        headers["Authorization"] = f"Bearer {os.environ.get(key_variable, '')}"
    status, body = asyncio.run(_post(build_completions_url(endpoint), json.dumps(request).encode(), headers, timeout_s))
    if status != 200:
        raise LanguageModelError("status", f"HTTP status {status}")
    return _parse_answer(body, max_chars)


@cache
def _load_certificates() -> "ssl.SSLContext":
    """Return what checks certificates, read once a process: it takes 30 ms, an answer of a near endpoint less."""
    import httpx

    return httpx.create_ssl_context()


async def _post(url: str, content: bytes, headers: dict[str, str], timeout_s: float) -> tuple[int, bytes]:
    """Return (status, body). The time-out covers the whole exchange, so a slow stream of bytes cannot extend it."""
    import asyncio

    import httpx

    body = bytearray()
    try:
        async with (
            asyncio.timeout(timeout_s),
            httpx.AsyncClient(timeout=None, follow_redirects=False, verify=_load_certificates()) as client,
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


def _parse_answer(body: bytes, max_chars: int) -> ChatCompletion:
    """Return the text of the first choice; raise LanguageModelError for any other body."""
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
    return ChatCompletion(text, _parse_tokens(data.get("usage")))


def _parse_tokens(usage: object) -> int:
    """Return the total number of tokens, 0 if it is missing or implausible."""
    tokens = usage.get("total_tokens") if isinstance(usage, dict) else None
    return tokens if type(tokens) is int and 0 <= tokens < 1_000_000 else 0
