"""The language model: misbehaving endpoints, budgets, settings and options."""

import subprocess
import sys
import time
from http.server import BaseHTTPRequestHandler
from pathlib import Path
from typing import Any

import pytest
from testing.negotiation_fakes import completion, served

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.negotiation.language_model import (
    LanguageModel,
    LanguageModelSettings,
    check_settings,
    read_llm_options,
)
from mdrive_sumo.negotiation.llm_endpoint import build_completions_url
from mdrive_sumo.negotiation.prompt import clean_message, parse_actions
from mdrive_sumo.v2x.messages import Intention

pytestmark = pytest.mark.slow

GROUP = ("a", "b")


def settings_for(url: str, **more: Any) -> LanguageModelSettings:
    return check_settings(LanguageModelSettings(endpoint=url, timeout_s=30.0, **more))


@pytest.mark.parametrize("endpoint", ["http://h:1", "http://h:1/", "http://h:1/v1", "http://h:1/v1/chat/completions"])
def test_an_endpoint_has_several_spellings(endpoint: str) -> None:
    assert build_completions_url(endpoint) == "http://h:1/v1/chat/completions"


def misbehaving(handler: BaseHTTPRequestHandler) -> None:
    """Sends headers and then nothing."""
    handler.send_response(200)
    handler.end_headers()
    handler.wfile.flush()
    time.sleep(60.0)


def dripping(handler: BaseHTTPRequestHandler) -> None:
    """Sends one byte after the other."""
    handler.send_response(200)
    handler.end_headers()
    for _ in range(4000):
        handler.wfile.write(b" ")
        handler.wfile.flush()
        time.sleep(0.05)


def huge(handler: BaseHTTPRequestHandler) -> None:
    """Never ends."""
    handler.send_response(200)
    handler.end_headers()
    for _ in range(1000):
        handler.wfile.write(b"x" * 65536)


def rude(handler: BaseHTTPRequestHandler) -> None:
    """Hangs up."""
    handler.close_connection = True


def elsewhere(handler: BaseHTTPRequestHandler) -> None:
    """Sends one away."""
    handler.send_response(307)
    handler.send_header("Location", handler.path + "/other")
    handler.send_header("Content-Length", "0")
    handler.end_headers()


def body(data: bytes, status: int = 200) -> Any:
    def answer(handler: BaseHTTPRequestHandler) -> None:
        handler.send_response(status)
        handler.send_header("Content-Length", str(len(data)))
        handler.end_headers()
        handler.wfile.write(data)

    return answer


@pytest.mark.parametrize(
    ("raw", "reason", "exchanges"),
    [
        (misbehaving, "timeout: no answer within 0.3 s", 1),
        (dripping, "timeout: no answer within 0.3 s", 1),
        (huge, "size: more than 262144 bytes", 3),
        (rude, "connection: RemoteProtocolError", 3),
        (elsewhere, "status: HTTP status 307", 3),
        (body(b"busy", 429), "status: HTTP status 429", 3),
        (body(b"", 500), "status: HTTP status 500", 3),
        (body(b"hello"), "json: the body is no JSON", 3),
        (body(b"\xff\xfe\xfa"), "json: the body is no JSON", 3),
        (body(b"[" * 100_000), "json: the body is no JSON", 3),
        (body(b"[]"), "choices: no choices", 3),
        (body(b'{"choices": []}'), "choices: no choices", 3),
        (body(b'{"choices": [{"message": {"content": null}}]}'), "choices: no text", 3),
        (body(completion("x" * 2001)), "length: 2001 characters", 3),
        (body(completion("")), "answer: the message is empty", 3),
    ],
)
def test_the_rule_takes_over_from_any_faulty_endpoint(
    monkeypatch: pytest.MonkeyPatch, raw: Any, reason: str, exchanges: int
) -> None:
    monkeypatch.setattr("mdrive_sumo.negotiation.language_model.FIRST_PAUSE_S", 0.0)
    limit_s = 0.3 if reason.startswith("timeout") else 30.0
    with served(None, raw) as service:
        model = LanguageModel(LanguageModelSettings(endpoint=service.url, timeout_s=limit_s), 1)
        started = time.monotonic()
        assert model.ask([{"role": "user", "content": "?"}], 9, clean_message) is None
        assert time.monotonic() - started < 30.0
    kinds = [note.kind for note in model.notes]
    assert kinds == ["llm-exchange"] * exchanges + ["llm-fallback"]
    assert model.notes[-1].text.startswith(reason)


def test_httpx_is_imported_only_for_an_endpoint() -> None:
    code = "import sys, mdrive_sumo.agents, mdrive_sumo.negotiation.llm_negotiator; print('httpx' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, check=True, text=True).stdout == "False\n"


def test_an_unreachable_endpoint() -> None:
    model = LanguageModel(LanguageModelSettings(endpoint="http://127.0.0.1:9", timeout_s=30.0), 1)
    assert model.ask([], 9, clean_message) is None
    assert model.notes[-1].text == "connection: ConnectError"


def test_an_unusable_answer_is_sent_back_with_what_is_wrong() -> None:
    def answering(request: dict[str, Any]) -> tuple[int, bytes]:
        return 200, completion('{"a": "STOP", "b": "KEEP"}' if len(request["messages"]) > 2 else '{"a": "HALT"}')

    with served(answering) as service:
        model = LanguageModel(settings_for(service.url), 1)
        found = model.ask([{"role": "user", "content": "?"}], 9, lambda text: parse_actions(text, GROUP))
    assert found is not None and found[0]["a"] == Intention.STOP
    assert "exactly the ids a, b" in service.requests[1]["messages"][-1]["content"]


def test_an_endpoint_that_fails_three_times_in_a_row_is_given_up() -> None:
    with served(lambda request: (500, b"")) as service:
        model = LanguageModel(LanguageModelSettings(endpoint=service.url, timeout_s=30.0), 1)
        for _ in range(5):
            assert model.ask([], 9, clean_message) is None
    assert len(service.requests) == 9
    assert [note.text[:8] for note in model.notes if note.kind == "llm-fallback"] == ["status: "] * 3 + ["given up"] * 2


@pytest.mark.parametrize(("limit", "reason"), [({"max_calls": 2}, "2 calls"), ({"max_tokens_total": 11}, "11 tokens")])
def test_the_budget_is_kept(limit: dict[str, int], reason: str) -> None:
    with served(lambda request: (200, completion("ok", usage={"total_tokens": 6}))) as service:
        model = LanguageModel(settings_for(service.url, **limit), 1)
        said = [model.ask([], 9, clean_message) for _ in range(4)]
    assert said == ["ok", "ok", None, None] and len(service.requests) == 2
    assert reason in model.notes[-1].text


@pytest.mark.parametrize(
    ("settings", "wrong"),
    [
        (LanguageModelSettings(), "option endpoint"),
        (LanguageModelSettings(endpoint="file:///etc/passwd"), "option endpoint"),
        (LanguageModelSettings(endpoint="http://"), "option endpoint"),
        (LanguageModelSettings(endpoint="http://127.0.0.1:99999/v1"), "option endpoint"),
        (LanguageModelSettings(endpoint="http://127.0.0.1:port/v1"), "option endpoint"),
        (LanguageModelSettings(endpoint="https://me:sesame@h/v1"), r"found 'https://\.\.\.@h/v1'"),
        (LanguageModelSettings(endpoint="https://h/v1?key=sesame"), "or query"),
        (LanguageModelSettings(endpoint="http://h", api_key_env="NO_SUCH_VARIABLE_HERE"), "option api_key_env"),
        (LanguageModelSettings(transcript="/no/such/file.jsonl"), "transcript /no/such/file.jsonl"),
    ],
)
def test_unusable_settings(settings: LanguageModelSettings, wrong: str) -> None:
    with pytest.raises(InputError, match=wrong):
        check_settings(settings)


def test_options_make_settings() -> None:
    assert read_llm_options("x", {"endpoint": "http://h", "rounds": "instant", "tries": 2}) == (
        LanguageModelSettings(endpoint="http://h", tries=2),
        True,
    )


@pytest.mark.parametrize(
    ("option", "wrong"),
    [
        ({"endpont": "http://h"}, "found 'endpont'"),
        ({"rounds": "fast"}, "option rounds: expected channel or instant, found 'fast'"),
        ({"model": 3}, "option model: expected a text, found 3"),
        ({"timeout_s": 0}, r"option timeout_s: expected a number in \[0.1, 600\], found 0"),
        ({"tries": "many"}, "option tries: expected a number"),
        ({"endpoint": ""}, "option endpoint: expected the URL"),
    ],
)
def test_unusable_options(option: dict[str, Any], wrong: str) -> None:
    with pytest.raises(InputError, match=wrong):
        read_llm_options("colmdriver", {"endpoint": "http://h"} | option)


ENDLESS = '{"seed": 1, "ordinal": 0, "digest": "x", "answer": "y", "tokens": Infinity}'


@pytest.mark.parametrize(
    "line", ["hello", "{}", "[]", ENDLESS, '{"seed": 1, "ordinal": 0, "digest": "x"}', '{"seed": true}']
)
def test_a_file_that_is_no_transcript(tmp_path: Path, line: str) -> None:
    path = tmp_path / "t.jsonl"
    path.write_text(f"\n{line}\n")
    with pytest.raises(InputError, match="line 2: expected an exchange"):
        check_settings(LanguageModelSettings(transcript=str(path)))
