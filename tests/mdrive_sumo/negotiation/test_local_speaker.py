"""A model on board speaks: its messages, what it makes of those of others, its transcripts, and its fallbacks."""

import json
import math
from collections.abc import Callable, Mapping
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from testing.negotiation_fakes import lines_of, member, replies, talk, texts_of
from testing.tiny_negotiator import write_tiny_negotiator

from mdrive_sumo.contract import Message
from mdrive_sumo.negotiation import LlmNegotiator, NegotiationDecision, NegotiationMember, NegotiationStep
from mdrive_sumo.negotiation.dialogue.answer_writers import (
    AnswerRequest,
    AnswerWriter,
    FormulaWriter,
    NetworkWriter,
    RandomWriter,
)
from mdrive_sumo.negotiation.dialogue.answers import MAX_MESSAGE_BYTES, parse_proposal
from mdrive_sumo.negotiation.dialogue.dialogue_decoder import DialogueAnswer, load_decoder
from mdrive_sumo.negotiation.dialogue.vocabulary import SAY, load_vocabulary
from mdrive_sumo.negotiation.language_model import LanguageModel, LanguageModelSettings
from mdrive_sumo.negotiation.local_speaker import LocalSpeaker, read_words
from mdrive_sumo.v2x.messages import Intention, Mcm, ReferencePose, encode

WEST, SOUTH = "0a1b2c3d", "4e5f6a7b"
NO_FILES = LanguageModelSettings()
Writers = Callable[[int], AnswerWriter | None]


def crossing(west: str = WEST, south: str = SOUTH) -> dict[str, NegotiationMember]:
    """The one from the west is 10 m before the crossing, the other one 12 m."""
    return {west: member(west, -10.0, 0.0, 0.0), south: member(south, 0.0, -12.0, math.pi / 2)}


def negotiators(
    cars: Mapping[str, NegotiationMember],
    writers: Writers = lambda seed: FormulaWriter(),
    settings: LanguageModelSettings = NO_FILES,
) -> dict[str, LlmNegotiator]:
    def speak(name: str, seed: int) -> LlmNegotiator:
        model = LanguageModel(settings, seed)
        return LlmNegotiator(LocalSpeaker(name, model, writers(seed), load_vocabulary(), lambda: None))

    return {name: speak(name, seed) for seed, name in enumerate(cars, 7)}


def decisions_of(steps: Mapping[int, Mapping[str, NegotiationStep]]) -> dict[str, NegotiationDecision | None]:
    return {name: step.decision for name, step in steps[max(steps)].items()}


def write_random(seed: int) -> RandomWriter:
    return RandomWriter(load_vocabulary(), seed)


def test_cars_agree_on_an_order_and_send_ids() -> None:
    cars = crossing()
    steps = talk(cars, negotiators(cars), 14)
    said = [payload.decode().split("] ")[1] for _, _, payload in texts_of(steps)]
    assert said == [f"propose {WEST}>{SOUTH} keep", f"propose {WEST}>{SOUTH} slower"]
    first, second = decisions_of(steps).values()
    assert first is not None and second is not None
    assert (first.priority_over, second.yield_to) == ({SOUTH}, {WEST})
    (outcome,) = map(json.loads, lines_of(steps, "negotiation"))
    assert (outcome["by"], outcome["order"], outcome["consensus"]) == ("model", [WEST, SOUTH], 1.0)
    assert not lines_of(steps, "llm-fallback")


def test_the_network_speaks_for_all(tmp_path: Path) -> None:
    """One that finds all entries equally likely takes the first that the grammar allows."""
    decoder = load_decoder(write_tiny_negotiator(tmp_path))
    cars = crossing()
    steps = talk(cars, negotiators(cars, lambda seed: NetworkWriter(decoder, has_words=False)), 14)
    heads = [parse_proposal(json.loads(line)["answer"], "AB") for line in lines_of(steps, "llm-exchange")[:2]]
    assert {head.order for head in heads} == {("A", "B")}
    assert all(decision is not None for decision in decisions_of(steps).values())


@pytest.mark.parametrize("writers", [lambda seed: FormulaWriter(), write_random])
def test_a_transcript_stands_for_the_model(tmp_path: Path, writers: Writers) -> None:
    cars = crossing()
    steps = talk(cars, negotiators(cars, writers), 41)
    path = tmp_path / "transcript.jsonl"
    path.write_text("\n".join(lines_of(steps, "llm-exchange")) + "\n")
    frozen = negotiators(cars, lambda seed: None, LanguageModelSettings(transcript=str(path)))
    assert replies(talk(cars, frozen, 41)) == replies(steps)


@given(st.lists(st.text("0123456789abcdef-", min_size=1, max_size=60), min_size=2, max_size=3, unique=True))
def test_messages_have_at_most_200_bytes_whatever_the_ids(names: list[str]) -> None:
    places = [(-10.0, 0.0, 0.0), (0.0, -12.0, math.pi / 2), (11.0, 1.0, math.pi)]
    cars = {name: member(name, *place) for name, place in zip(names, places, strict=False)}
    steps = talk(cars, negotiators(cars, write_random), 12)
    assert texts_of(steps)
    assert all(len(payload) <= MAX_MESSAGE_BYTES for _, _, payload in texts_of(steps))


class Fixed:
    """Writes the same proposal and the same agreement."""

    def __init__(self, proposal: str, agreement: str) -> None:
        self.texts = (proposal, agreement)

    def write(self, request: AnswerRequest) -> DialogueAnswer:
        text = self.texts[request.task != SAY]
        if text == "too long":
            raise ValueError("prompt: expected at most 444 entries, found 900")
        return DialogueAnswer(text, 1, 1)


@pytest.mark.parametrize(
    ("agreement", "reason"),
    [
        ("We all go at once!", "answer: expected an order such as B>A"),
        ("A>C keep slower 90", "answer: order: expected each of A, B once, found A>C"),
        ("A>A keep slower 90", "answer: order: expected each of A, B once"),
        ("A>B keep 90", "answer: actions: expected 2, found 1"),
        ("A>B keep fly 90", "answer: action: expected one of"),
        ("A>B keep slower 95", "answer: consensus: expected 0, 10, ... or 100"),
        ("too long", "prompt: expected at most 444 entries"),
    ],
)
def test_an_unusable_agreement_is_a_noted_fallback_to_the_rule(agreement: str, reason: str) -> None:
    cars = crossing()
    steps = talk(cars, negotiators(cars, lambda seed: Fixed("propose A>B keep", agreement)), 14)
    assert lines_of(steps, "llm-fallback")[0].startswith(reason)
    assert json.loads(lines_of(steps, "negotiation")[0])["by"] == "rule"
    assert [decision.intention for decision in decisions_of(steps).values() if decision is not None] == [
        Intention.KEEP,
        Intention.STOP,
    ]


@pytest.mark.parametrize(
    "words", ["Hello, A car comes", "", "propose C>D keep", "<agree> <end>", "x" * 900, "\u00e9\u4e2d" * 99]
)
def test_what_others_say_need_not_have_the_form(words: str) -> None:
    """A partner of another kind: its text is words, and the conversation goes on."""
    cars = crossing()
    members = negotiators(cars)
    foreign = negotiators(cars, lambda seed: Fixed(words, "A>B keep slower 100"))
    speaker = foreign[SOUTH]._speaker  # pyright: ignore[reportPrivateUsage]
    speaker.say = lambda conversation, name, present: words  # type: ignore[method-assign]
    steps = talk(cars, {WEST: members[WEST], SOUTH: foreign[SOUTH]}, 40)
    outcome = json.loads(lines_of(steps, "negotiation")[0])
    assert (outcome["by"], outcome["order"]) == ("model", [WEST, SOUTH])


def test_capitals_of_prose_are_no_members() -> None:
    letters = {WEST: "A", SOUTH: "B"}
    assert read_words(f"A car! {SOUTH} must wait", letters, "AB") == "a car! B must wait"
    assert read_words(f"object {SOUTH}>{WEST} stop: I see {WEST}", letters, "AB") == "object B>A stop: I see A"
    assert len(read_words("word " * 300, letters, "AB")) == 200


def test_a_partner_that_never_answers_is_skipped() -> None:
    cars = crossing()
    steps = talk(cars, negotiators(cars), 60, lost=lambda sender, receiver, tick: sender == SOUTH and tick >= 4)
    outcomes = lines_of(steps, "negotiation")
    assert len(outcomes) <= 1  # it is gone from the group a second after its last MCM
    silent = {WEST: negotiators(cars)[WEST], SOUTH: _Mute(negotiators(cars)[SOUTH])}
    decision = decisions_of(talk(cars, silent, 40))[WEST]
    assert decision is not None and decision.priority_over == {SOUTH}


class _Mute:
    """Sends MCMs and says nothing."""

    def __init__(self, negotiator: LlmNegotiator) -> None:
        self._negotiator = negotiator

    def is_due(self, tick: int) -> bool:
        return True

    def get_valid_decision(self, tick: int) -> NegotiationDecision | None:
        return self._negotiator.get_valid_decision(tick)

    def step(self, tick: int, me: NegotiationMember, heard: list[Message]) -> NegotiationStep:
        step = self._negotiator.step(tick, me, [message for message in heard if message.type != "text"])
        return NegotiationStep(step.decision, tuple(one for one in step.messages if one.type != "text"))


def test_a_group_without_letters_is_the_rule_s() -> None:
    """Nine cars come from all sides."""
    angles = [2 * math.pi * i / 9 for i in range(9)]
    cars = {
        f"{i:08x}": member(f"{i:08x}", -14 * math.cos(angle), -14 * math.sin(angle), angle)
        for i, angle in enumerate(angles)
    }
    steps = talk(cars, negotiators(cars), 30)
    assert lines_of(steps, "llm-fallback")[0] == "group: 9 members, at most 8 have letters"
    assert json.loads(lines_of(steps, "negotiation")[0])["by"] == "rule"


@pytest.mark.parametrize(
    ("group", "requests", "answers", "yields"),
    [
        (("ghost", "00000000", SOUTH), {"ghost": 3, "00000000": 2, SOUTH: 1}, {"00000000": True}, set[str]()),
        ((WEST, SOUTH, "00000000"), {WEST: 2, SOUTH: 1, "00000000": 2}, {"00000000": True}, {WEST}),
        ((WEST, SOUTH, "00000000"), {SOUTH: 1}, {"00000000": True}, {WEST}),  # without actions there is no order
        ((WEST, "00000000"), {WEST: 2, SOUTH: 1}, {"00000000": True}, None),  # not about this car
    ],
)
def test_agreements_of_others_are_read_as_far_as_they_make_sense(
    group: tuple[str, ...], requests: dict[str, int], answers: dict[str, bool], yields: set[str] | None
) -> None:
    """A station without a conflict of its own asks; some of the CAVs that it names do not exist."""
    cars = crossing()
    asked = {name: Intention(action) for name, action in requests.items()}
    pose = ReferencePose(200.0, 200.0, 0.0, 0)
    mcm = Mcm(pose, 0.0, Intention.KEEP, member("x", 0, 0, 0).direction, 0.2, cars[WEST].planned + 200.0,
              requests=asked, answers=answers, group=group, until_tick=80)  # fmt: skip
    said = encode(mcm)
    negotiator = negotiators(cars)[SOUTH]
    west = talk({WEST: cars[WEST]}, {WEST: negotiators(cars)[WEST]}, 1)[0][WEST].messages
    negotiator.step(0, cars[SOUTH], list(west))
    step = negotiator.step(1, cars[SOUTH], [Message(said.type, said.payload, "00000000", 0)])
    assert (step.decision.yield_to if step.decision is not None else None) == yields
