"""Negotiation by language model: rounds over the channel, and replays of transcripts."""

import json
import math
import time
from http.server import BaseHTTPRequestHandler
from pathlib import Path
from typing import Any

import pytest
from testing.negotiation_fakes import agreeable, completion, crossing, lines_of, member, replies, served, talk, texts_of

from mdrive_sumo.negotiation.chat_speaker import ChatSpeaker
from mdrive_sumo.negotiation.language_model import LanguageModel, LanguageModelSettings, check_settings
from mdrive_sumo.negotiation.llm_negotiator import LlmNegotiator
from mdrive_sumo.v2x.messages import Intention, Mcm, decode

pytestmark = pytest.mark.slow

GROUP = ("a", "b")


def negotiators(settings: LanguageModelSettings, instant: bool = False, names: str = "ab") -> dict[str, LlmNegotiator]:
    models = {name: LanguageModel(settings, seed) for seed, name in enumerate(names, 7)}
    return {name: LlmNegotiator(ChatSpeaker(model), instant) for name, model in models.items()}


def settings_for(url: str, **more: Any) -> LanguageModelSettings:
    return check_settings(LanguageModelSettings(endpoint=url, timeout_s=30.0, **more))


def test_cars_speak_in_turn_over_the_channel_and_obey() -> None:
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


def test_a_silent_member_is_skipped() -> None:
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


def test_the_key_is_sent_and_kept_nowhere(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NEGOTIATION_TEST_KEY", "sesame-1234")
    with served(agreeable) as service:
        steps = talk(crossing(), negotiators(settings_for(service.url, api_key_env="NEGOTIATION_TEST_KEY")), 12)
    assert service.headers["Authorization"] == "Bearer sesame-1234"
    assert "sesame" not in repr(replies(steps)) + repr(service.requests)


def flaky(request: dict[str, Any]) -> tuple[int, bytes]:
    """Sometimes busy, sometimes nonsense, by the contents of the request."""
    kind = sum(json.dumps(request).encode()) % 4
    return (503, b"") if kind == 0 else (200, completion("?!" * kind)) if kind == 1 else agreeable(request)


@pytest.mark.parametrize(
    ("answering", "instant"),
    [
        pytest.param(agreeable, False, marks=pytest.mark.full),
        pytest.param(agreeable, True, marks=pytest.mark.full),
        pytest.param(stubborn, False, marks=pytest.mark.full),
        (stubborn, True),
        (flaky, False),
        pytest.param(flaky, True, marks=pytest.mark.full),
    ],
)
def test_a_replay_gives_the_same_result_without_an_endpoint(
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


def test_a_missing_exchange_is_a_noted_fallback(tmp_path: Path) -> None:
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
