"""LocalSpeaker: a language model on board speaks for a CAV, in messages whose head always has the same form.

Inside the model members are called by letters; messages have station ids. What others say need not have the form: their
texts are read as words.
"""

import re
from collections.abc import Callable, Mapping
from typing import TypeVar

from mdrive_sumo.contract import Cause, Note, Objects, Reason
from mdrive_sumo.negotiation.conversation import Conversation, Utterance
from mdrive_sumo.negotiation.dialogue.answer_writers import AnswerRequest, AnswerWriter
from mdrive_sumo.negotiation.dialogue.answers import (
    LETTERS,
    MAX_MEMBERS,
    MAX_MESSAGE_BYTES,
    assign_letters,
    parse_agreement,
    parse_proposal,
    replace_letters,
    restore_letters,
)
from mdrive_sumo.negotiation.dialogue.dialogue_prompt import (
    FASTER_FEEDBACK,
    SaidLine,
    Talk,
    format_close_pair,
    format_prompt,
)
from mdrive_sumo.negotiation.dialogue.dialogue_view import DialogueView, OwnKnowledge, build_dialogue_view
from mdrive_sumo.negotiation.dialogue.vocabulary import AGREE, SAY, DialogueVocabulary
from mdrive_sumo.negotiation.language_model import FALLBACK, LanguageModel, LanguageModelError
from mdrive_sumo.negotiation.llm_endpoint import ChatCompletion
from mdrive_sumo.negotiation.negotiator import NegotiationMember
from mdrive_sumo.negotiation.rule_negotiator import find_leader_pairs
from mdrive_sumo.negotiation.speaker import GroupAgreement

T = TypeVar("T")

TASKS = {SAY: "say", AGREE: "agree"}
"""Names of tasks in transcripts."""
MAX_FOREIGN_CHARS = 200
"""Of a message without a head, in a prompt; messages of this speaker have no more bytes."""
_CLOSE = re.compile(rf"([{LETTERS}]) and ([{LETTERS}]) would come too close")
_SINGLE_CAPITAL = re.compile(rf"(?<![A-Za-z])[{LETTERS}](?![A-Za-z])")
NOTHING_KNOWN = OwnKnowledge(Objects.empty(), Reason(Cause.FREE))
"""Of a member for which another CAV speaks (`rounds` instant), and of one that has not planned yet."""


class LocalSpeaker:
    """Implements `Speaker` for one CAV; its agreements have an order of passing."""

    def __init__(
        self,
        me: str,
        model: LanguageModel,
        writer: AnswerWriter | None,
        vocabulary: DialogueVocabulary,
        know: Callable[[], OwnKnowledge | None],
    ) -> None:
        """me: station id. model: budget and transcript. writer: None if a transcript has all answers. know: returns
        what the CAV knows now beside the MCMs, None before it has planned."""
        self._me, self._model, self._writer, self._vocabulary, self._know = me, model, writer, vocabulary, know

    @property
    def notes(self) -> list[Note]:
        """Implement `Speaker.notes`."""
        return self._model.notes

    def say(self, conversation: Conversation, speaker: str, members: Mapping[str, NegotiationMember]) -> str | None:
        """Implement `Speaker.say`. With its ids the message has at most `MAX_MESSAGE_BYTES`, header included."""
        letter_by_station = self._assign_letters(conversation)
        if letter_by_station is None:
            return None
        view = self._build_view(speaker, members, letter_by_station)
        header = Utterance(conversation.id, conversation.round, False, "").to_text()
        max_bytes = MAX_MESSAGE_BYTES - len(header.encode())
        station_by_letter = {letter: station for station, letter in letter_by_station.items()}
        if not fits_head(tuple(letter_by_station), max_bytes):
            station_by_letter = {}
        id_bytes = tuple(len(station.encode()) for station in station_by_letter.values())
        text = self._ask(
            self._build_request(SAY, view, build_talk(conversation, letter_by_station), id_bytes, max_bytes),
            lambda answer: _check_proposal(answer, view.letters),
        )
        return None if text is None else replace_letters(text, station_by_letter)

    def describe(self, conversation: Conversation, speaker: str, members: Mapping[str, NegotiationMember]) -> list[str]:
        """Return what the model would be told before the next message of a member, line by line."""
        letter_by_station = assign_letters(conversation.group)
        view = self._build_view(speaker, members, letter_by_station)
        return format_prompt(SAY, view, build_talk(conversation, letter_by_station), self._vocabulary)

    def conclude(
        self, conversation: Conversation, me: str, members: Mapping[str, NegotiationMember]
    ) -> GroupAgreement | None:
        """Implement `Speaker.conclude`."""
        letter_by_station = self._assign_letters(conversation)
        if letter_by_station is None:
            return None
        view = self._build_view(me, members, letter_by_station)
        talk = build_talk(conversation, letter_by_station)
        request = self._build_request(AGREE, view, talk, (), MAX_MESSAGE_BYTES)
        agreement = self._ask(request, lambda answer: parse_agreement(answer, view.letters))
        if agreement is None:
            return None
        station_by_letter = {letter: station for station, letter in letter_by_station.items()}
        actions = {station_by_letter[letter]: action for letter, action in agreement.action_by_member.items()}
        order = tuple(station_by_letter[letter] for letter in agreement.order)
        return GroupAgreement(actions, order, agreement.consensus)

    def _assign_letters(self, conversation: Conversation) -> dict[str, str] | None:
        """Return the letter of each member; None for a group without letters, which is noted."""
        if len(conversation.group) <= MAX_MEMBERS:
            return assign_letters(conversation.group)
        text = f"group: {len(conversation.group)} members, at most {MAX_MEMBERS} have letters"
        self._model.notes.append(Note(FALLBACK, text))
        return None

    def _build_view(
        self, speaker: str, members: Mapping[str, NegotiationMember], letter_by_station: Mapping[str, str]
    ) -> DialogueView:
        known = self._know() if speaker == self._me else None
        everyone = tuple(members.values())
        leaders = find_leader_pairs(everyone)
        return build_dialogue_view(speaker, everyone, letter_by_station, leaders, known or NOTHING_KNOWN)

    def _build_request(
        self, task: int, view: DialogueView, talk: Talk, id_bytes: tuple[int, ...], max_bytes: int
    ) -> AnswerRequest:
        lines = tuple(format_prompt(task, view, talk, self._vocabulary))
        return AnswerRequest(task, view, lines, id_bytes, max_bytes)

    def _ask(self, request: AnswerRequest, read: Callable[[str], T]) -> T | None:
        asked = {
            "task": TASKS[request.task],
            "lines": list(request.lines),
            "letters": request.view.letters,
            "id_bytes": list(request.id_bytes),
            "max_bytes": request.max_bytes,
        }
        return self._model.ask_on_board(asked, lambda: self._write(request), read)

    def _write(self, request: AnswerRequest) -> ChatCompletion:
        """Return the answer of the writer. Raises LanguageModelError."""
        if self._writer is None:
            raise LanguageModelError("missing", "expected a transcript with all answers")
        try:
            answer = self._writer.write(request)
        except ValueError as error:
            raise LanguageModelError("prompt", str(error).removeprefix("prompt: ")) from None
        return ChatCompletion(answer.text, answer.read_entries + answer.written_entries)


def _check_proposal(text: str, letters: str) -> str:
    """Return the text. Raises ValueError unless it is a proposal."""
    parse_proposal(text, letters)
    return text


def fits_head(stations: tuple[str, ...], max_bytes: int) -> bool:
    """Return whether the longest head of a message with station ids has at most so many bytes."""
    order = ">".join(stations)
    return len(f"propose {order} slower".encode()) <= max_bytes


def build_talk(conversation: Conversation, letter_by_station: Mapping[str, str]) -> Talk:
    """Return what was said in a conversation so far, in letters."""
    letters = "".join(sorted(letter_by_station.values()))
    said = [
        SaidLine(number, letter_by_station[name], read_words(text, letter_by_station, letters))
        for number in range(1, conversation.round + 1)
        for name in conversation.order
        if (text := conversation.text_by_turn.get((number, name), ""))
    ]
    feedback = _read_feedback(restore_letters(conversation.feedback, letter_by_station))
    return Talk(tuple(said), feedback, conversation.round)


def read_words(text: str, letter_by_station: Mapping[str, str], letters: str) -> str:
    """Return the text of a member in letters. One without a head is shortened, and its capitals are no members."""
    restored = restore_letters(text, letter_by_station)
    try:
        parse_proposal(restored, letters)
    except ValueError:
        plain = _SINGLE_CAPITAL.sub(lambda match: match[0].lower(), text)
        return restore_letters(plain, letter_by_station)[:MAX_FOREIGN_CHARS]
    return restored


def _read_feedback(text: str) -> str:
    """Return the critic's objection as prompts have it."""
    pair = _CLOSE.search(text)
    if pair is not None:
        return format_close_pair(pair[1], pair[2])
    return FASTER_FEEDBACK if "too slow" in text else ""
