"""ChatSpeaker: asks a language model behind an endpoint in English, and reads its actions as JSON."""

from collections.abc import Mapping
from functools import partial

from mdrive_sumo.contract import Note
from mdrive_sumo.negotiation.conversation import Conversation
from mdrive_sumo.negotiation.language_model import LanguageModel
from mdrive_sumo.negotiation.negotiator import NegotiationMember
from mdrive_sumo.negotiation.prompt import (
    ACTION_TOKENS,
    MESSAGE_TOKENS,
    build_action_chat,
    build_speaker_chat,
    clean_message,
    parse_actions,
)
from mdrive_sumo.negotiation.speaker import GroupAgreement


class ChatSpeaker:
    """Implements `Speaker`. Its agreements have no order of passing: the actions decide who goes first."""

    def __init__(self, model: LanguageModel) -> None:
        self._model = model

    @property
    def notes(self) -> list[Note]:
        """Implement `Speaker.notes`."""
        return self._model.notes

    def say(self, conversation: Conversation, speaker: str, members: Mapping[str, NegotiationMember]) -> str | None:
        """Implement `Speaker.say`."""
        others = [members[name] for name in conversation.order if name != speaker]
        said = conversation.get_utterances()
        chat = build_speaker_chat(members[speaker], others, said, conversation.feedback)
        return self._model.ask(chat, MESSAGE_TOKENS, clean_message)

    def conclude(
        self,
        conversation: Conversation,
        me: str,  # noqa: ARG002
        members: Mapping[str, NegotiationMember],
    ) -> GroupAgreement | None:
        """Implement `Speaker.conclude`."""
        chat = build_action_chat(tuple(members.values()), conversation.get_utterances(rounds=1))
        answer = self._model.ask(chat, ACTION_TOKENS, partial(parse_actions, group=conversation.group))
        return None if answer is None else GroupAgreement(answer[0], (), answer[1])
