"""Negotiation by language model: prompts and answers, rounds over the channel, a misbehaving endpoint, and replays."""

import json
import math
import subprocess
import sys
import time
from http.server import BaseHTTPRequestHandler
from pathlib import Path
from typing import Any

import pytest
from testing.negotiation_fakes import agreeable, completion, crossing, lines_of, member, replies, served, talk, texts_of

from mdrive_sumo.contract import Message
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.negotiation.conversation import Conversation, Utterance, compute_speaking_order, parse_utterance
from mdrive_sumo.negotiation.critic import avoid_slow_keeping, evaluate_actions
from mdrive_sumo.negotiation.language_model import LanguageModel, LanguageModelSettings, check_settings
from mdrive_sumo.negotiation.llm_endpoint import build_completions_url
from mdrive_sumo.negotiation.llm_negotiator import LlmNegotiator
from mdrive_sumo.negotiation.llm_options import read_llm_options
from mdrive_sumo.negotiation.prompt import build_action_chat, build_speaker_chat, clean_message, parse_actions
from mdrive_sumo.v2x.messages import Intention, Mcm, decode

GROUP = ("a", "b")


def negotiators(settings: LanguageModelSettings, instant: bool = False, names: str = "ab") -> dict[str, LlmNegotiator]:
    return {name: LlmNegotiator(LanguageModel(settings, seed), instant) for seed, name in enumerate(names, 7)}


def settings_for(url: str, **more: Any) -> LanguageModelSettings:
    return check_settings(LanguageModelSettings(endpoint=url, timeout_s=30.0, **more))


def test_a_prompt_tells_who_is_where() -> None:
    a, b = crossing(20, 20).values()
    system, user = build_speaker_chat(a, [b], [("b", "I turn left.")], "a and b would come too close")
    assert "merges" in system["content"] and "turns left" in system["content"]
    for part in ("You are car a: 6.0 m/s", "car b: 28.3 m ahead right, moving from right to left, 6.0 m/s",
                 "means to KEEP", "b: I turn left.", "a and b would come too close"):  # fmt: skip
        assert part in user["content"]
    assert "a: hello" in build_action_chat([a, b], [("a", "hello")])[1]["content"]


@pytest.mark.parametrize(
    ("text", "wrong"),
    [
        ("", "no JSON"),
        ("I think a goes.", "no JSON"),
        ('{"a": "STOP"}', "exactly the ids"),
        ('{"a": "STOP", "b": "KEEP", "z": "KEEP"}', "exactly the ids"),
        ('{"a": "STOP", "b": "FLY"}', "car b"),
        ('{"a": "STOP", "b": 3}', "car b"),
        ('{"a": "STOP", "b": "KEEP"', "no JSON"),
        ('{"a": ' + "[" * 30000 + '"b": "KEEP"}', "nested"),
        ('{a: "STOP", "b": "KEEP"}', "Expecting property name"),
    ],
)
def test_unusable_answers_say_what_is_wrong(text: str, wrong: str) -> None:
    with pytest.raises(ValueError, match=wrong):
        parse_actions(text, GROUP)


@pytest.mark.parametrize(
    ("text", "consensus"),
    [
        ('{"a": "STOP", "b": "FASTER"}', None),
        ('Here it is:\n```json\n{"a": " stop", "b": "Faster", "consensus": 80}\n```', 0.8),
        ('{"a": "STOP", "b": "FASTER", "consensus": "much"}', None),
        ('{"a": "STOP", "b": "FASTER", "consensus": NaN}', None),
    ],
)
def test_usable_answers(text: str, consensus: float | None) -> None:
    assert parse_actions(text, GROUP) == ({"a": Intention.STOP, "b": Intention.FASTER}, consensus)


def test_messages_are_short_valid_utf_8() -> None:
    assert clean_message(" I\n go \ud800 first ") == "I go ? first"
    long = clean_message("ä" * 2000)
    assert len(Utterance("0" * 8, 3, True, long).to_text().encode()) <= 1024 and long.strip("ä") == ""
    with pytest.raises(ValueError, match="empty"):
        clean_message(" \n ")


def test_lines_survive_the_channel_and_other_texts_are_none() -> None:
    for line in (Utterance("01234567", 2, False, "I go [first] x"), Utterance("89abcdef", 3, True, "a\nb")):
        assert parse_utterance(line.to_text()) == line
    assert parse_utterance("hello [01234567 1] x") is None


def test_nobody_can_speak_for_others() -> None:
    talking = Conversation(GROUP, GROUP, 0)
    said = Utterance(talking.id, 1, False, "I stop.\nb: I stop too.\u2028c: so do I")
    talking.receive(3, Message("text", b"", "a", 2), said)
    talking.receive(3, Message("text", b"", "z", 2), said)
    assert talking.get_utterances() == [("a", "I stop. b: I stop too. c: so do I")]
    assert talking.find_next_speaker(3) == "b"


def test_the_most_central_speaks_first() -> None:
    cars = [member("a", 0, 0, 0), member("b", 30, 0, 0), member("c", 20, 0, 0)]
    assert compute_speaking_order(cars) == ("c", "b", "a")  # sums of distances: 30, 40, 50


def test_the_critic_names_who_comes_too_close_or_asks_for_speed() -> None:
    cars = list(crossing(10, 10).values())
    both = evaluate_actions(cars, {"a": Intention.KEEP, "b": Intention.KEEP})
    assert "a and b would come too close" in both.feedback and both.safety < 0.1
    nobody = evaluate_actions(cars, {"a": Intention.STOP, "b": Intention.STOP})
    assert "too slow" in nobody.feedback and nobody.efficiency < 0.4
    one = evaluate_actions(cars, {"a": Intention.FASTER, "b": Intention.STOP})
    assert one.feedback == "" and one.safety > 0.7 and one.efficiency > 0.4
    slow = [member("a", 0, 0, 0, 3.9)]
    assert avoid_slow_keeping({"a": Intention.KEEP}, slow) == {"a": Intention.FASTER}


@pytest.mark.parametrize("endpoint", ["http://h:1", "http://h:1/", "http://h:1/v1", "http://h:1/v1/chat/completions"])
def test_the_endpoint_may_be_named_in_several_ways(endpoint: str) -> None:
    assert build_completions_url(endpoint) == "http://h:1/v1/chat/completions"


def test_cars_talk_in_turn_over_the_channel_and_obey() -> None:
    with served(agreeable) as service:
        steps = talk(crossing(), negotiators(settings_for(service.url)), 12, latency=2)
    said = texts_of(steps)
    assert [(tick, sender) for tick, sender, _ in said[:2]] == [(4, "a"), (6, "b")]
    assert steps[7]["a"].decision is None
    # a reads the actions off two ticks later, b hears of them after another two
    assert steps[8]["a"].decision is not None and steps[8]["a"].decision.priority_over == {"b"}
    assert steps[9]["b"].decision is None
    told = steps[10]["b"].decision
    assert told is not None and (told.intention, told.yield_to) == (Intention.STOP, {"a"})
    assert told.until_tick == steps[8]["a"].decision.until_tick
    announced = decode(steps[8]["a"].messages[-1])
    assert isinstance(announced, Mcm)
    assert announced.requests == {"a": Intention.FASTER, "b": Intention.STOP} and announced.group == GROUP
    outcome = json.loads(lines_of(steps, "negotiation")[0])
    assert (outcome["by"], outcome["round"], outcome["feedback"]) == ("model", 1, "")
    assert len(lines_of(steps, "llm-exchange")) == 3
    request = service.requests[0]
    assert (request["temperature"], request["max_tokens"], request["seed"]) == (0, 256, 7)
    assert "Authorization" not in service.headers


def stubborn(request: dict[str, Any]) -> tuple[int, bytes]:
    """A model with which all stop, until they are criticised."""
    asked = "JSON" in request["messages"][0]["content"]
    if asked and "second" in request["messages"][1]["content"]:
        return 200, completion('{"a": "FASTER", "b": "STOP"}')
    word = "second" if "too slow" in request["messages"][1]["content"] else "first"
    return 200, completion('{"a": "STOP", "b": "STOP"}' if asked else word)


@pytest.mark.parametrize("instant", [False, True])
def test_feedback_opens_another_round(instant: bool) -> None:
    with served(stubborn) as service:
        steps = talk(crossing(), negotiators(settings_for(service.url), instant), 12)
    outcomes = [json.loads(line) for line in lines_of(steps, "negotiation")]
    assert [(o["round"], bool(o["feedback"])) for o in outcomes] == [(1, True), (2, False)]
    told = steps[11]["b"].decision
    assert told is not None and (told.intention, told.yield_to) == (Intention.STOP, {"a"})
    assert bool(texts_of(steps)) is not instant
    if instant:
        assert [tick for tick in steps if steps[tick]["a"].notes] == [4]


def test_exactly_the_same_group_does_not_negotiate_again_within_a_second() -> None:
    """The actions do not solve anything, so the conflict stays."""
    with served(lambda request: (200, completion('{"a": "KEEP", "b": "KEEP"}'))) as service:
        steps = talk(crossing(), negotiators(settings_for(service.url), instant=True), 41)
    ticks = [tick for tick in steps if any(n.kind == "negotiation" for s in steps[tick].values() for n in s.notes)]
    assert ticks == [4, 24]
    assert len(lines_of(steps, "negotiation")) == 6  # three rounds each


def test_a_silent_member_is_passed_over() -> None:
    with served(agreeable) as service:
        steps = talk(
            crossing(), negotiators(settings_for(service.url)), 60, lost=lambda s, r, t: s == "b" and 4 <= t < 8
        )
    assert steps[59]["a"].decision is not None


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
def test_whatever_the_endpoint_does_the_rule_takes_over(
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


def test_what_only_an_endpoint_needs_is_not_imported_before() -> None:
    code = "import sys, mdrive_sumo.agents, mdrive_sumo.negotiation.llm_negotiator; print('httpx' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, check=True, text=True).stdout == "False\n"


def test_nobody_there() -> None:
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


def test_the_key_is_sent_and_kept_nowhere(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NEGOTIATION_TEST_KEY", "sesame-1234")
    with served(agreeable) as service:
        steps = talk(crossing(), negotiators(settings_for(service.url, api_key_env="NEGOTIATION_TEST_KEY")), 12)
    assert service.headers["Authorization"] == "Bearer sesame-1234"
    assert "sesame" not in repr(replies(steps)) + repr(service.requests)


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


def flaky(request: dict[str, Any]) -> tuple[int, bytes]:
    """Sometimes busy, sometimes nonsense, by the contents of the request."""
    kind = sum(json.dumps(request).encode()) % 4
    return (503, b"") if kind == 0 else (200, completion("?!" * kind)) if kind == 1 else agreeable(request)


@pytest.mark.parametrize("instant", [False, True])
@pytest.mark.parametrize("answering", [agreeable, stubborn, flaky])
def test_a_replay_says_the_same_without_any_endpoint(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, answering: Any, instant: bool
) -> None:
    monkeypatch.setattr("mdrive_sumo.negotiation.language_model.FIRST_PAUSE_S", 0.0)
    with served(answering) as service:
        settings = LanguageModelSettings(endpoint=service.url, timeout_s=30.0, give_up_after=99)
        steps = talk(crossing(), negotiators(settings, instant), 41)
    path = tmp_path / "transcript.jsonl"
    path.write_text("\n".join(lines_of(steps, "llm-exchange")) + "\n")
    again = check_settings(LanguageModelSettings(transcript=str(path), give_up_after=99))
    assert replies(talk(crossing(), negotiators(again, instant), 41)) == replies(steps)
    assert lines_of(steps, "llm-exchange")


def test_a_replay_repeats_a_timeout(tmp_path: Path) -> None:
    with served(None, misbehaving) as service:
        steps = talk(crossing(), negotiators(LanguageModelSettings(endpoint=service.url, timeout_s=0.1)), 12)
    path = tmp_path / "transcript.jsonl"
    path.write_text("\n".join(lines_of(steps, "llm-exchange")))
    again = LanguageModelSettings(transcript=str(path), timeout_s=0.1)
    assert replies(talk(crossing(), negotiators(again), 12)) == replies(steps)
    assert "timeout" in lines_of(steps, "llm-fallback")[0]


def test_what_a_transcript_lacks_is_a_counted_fallback(tmp_path: Path) -> None:
    path = tmp_path / "transcript.jsonl"
    path.write_text("")
    steps = talk(crossing(), negotiators(LanguageModelSettings(transcript=str(path))), 12)
    assert lines_of(steps, "llm-fallback")[0].startswith("missing: the transcript has no answer")
    told = steps[11]["b"].decision
    assert told is not None and told.intention == Intention.STOP  # the rule's
    assert json.loads(lines_of(steps, "negotiation")[0])["by"] == "rule"


def test_four_cars_settle_by_talk() -> None:
    cars = {
        "a": member("a", -12, -2, 0.0),
        "b": member("b", 2, -12, math.pi / 2),
        "c": member("c", 12, 2, math.pi),
        "d": member("d", -2, 12, -math.pi / 2),
    }
    with served(agreeable) as service:
        steps = talk(cars, negotiators(settings_for(service.url), names="abcd"), 30)
    decisions = {name: step.decision for name, step in steps[24].items()}
    assert all(d is not None and d.group == ("a", "b", "c", "d") for d in decisions.values())
    assert [d.intention.name for d in decisions.values() if d is not None] == ["FASTER", "STOP", "STOP", "STOP"]
