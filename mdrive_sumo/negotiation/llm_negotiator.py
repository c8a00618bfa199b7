"""Negotiation by a language model: CAVs exchange messages, the most central one states the actions (protocol 10.4)."""

import json
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

from mdrive_sumo.contract import Message, Note
from mdrive_sumo.contract.briefing import V2xRate
from mdrive_sumo.negotiation.conflict_graph import (
    CONFLICT,
    STEP_TICKS,
    ConflictGraph,
    build_conflict_graph,
    find_next_planning_tick,
)
from mdrive_sumo.negotiation.conversation import (
    Conversation,
    Utterance,
    compute_speaking_order,
    parse_utterance,
)
from mdrive_sumo.negotiation.critic import Critique, avoid_slow_keeping, evaluate_actions
from mdrive_sumo.negotiation.language_model import LanguageModel
from mdrive_sumo.negotiation.mcm_sending import McmSending
from mdrive_sumo.negotiation.negotiator import NegotiationDecision, NegotiationMember, NegotiationStep
from mdrive_sumo.negotiation.peer_table import PeerTable
from mdrive_sumo.negotiation.prompt import (
    ACTION_TOKENS,
    MESSAGE_TOKENS,
    build_action_chat,
    build_speaker_chat,
    clean_message,
    parse_actions,
)
from mdrive_sumo.negotiation.right_of_way_claims import NegotiationTerms, build_mcm_message
from mdrive_sumo.negotiation.rule_negotiator import apply_rule
from mdrive_sumo.v2x.messages import MAX_NAMES, TEXT, Intention, Mcm, MessageError, decode, encode

OUTCOME = "negotiation"
"""Kind of the note about the outcome of a round."""


@dataclass(frozen=True, slots=True)
class LlmNegotiationParameters:
    """Parameters of `LlmNegotiator`."""

    rounds: int = 3
    """Protocol 10.4."""
    cool_down_ticks: int = 20
    """The same group does not negotiate again earlier (protocol 10.4)."""
    max_agreement_ticks: int = 100
    """No agreement holds for longer: 4 s of prediction and the aftermath."""
    stale_ticks: int = 99
    """A conversation without any utterance for this long is replaced by a new one."""
    max_note_chars: int = 150_000
    """Notes of one tick; the rest waits for the next one (a reply may carry 200 000)."""


LLM_NEGOTIATION = LlmNegotiationParameters()


def count_conflict_ticks(graph: ConflictGraph, group: Sequence[str]) -> int:
    """Return the ticks until the last conflict of a group, one planning step if there is none."""
    return graph.count_conflict_ticks(group) if graph.in_conflict.any() else STEP_TICKS


def build_decision(
    me: str,
    members: Sequence[NegotiationMember],
    actions: Mapping[str, Intention],
    group: tuple[str, ...],
    until: int,
) -> NegotiationDecision:
    """Return the own decision from the actions of all: the member with the faster action goes first."""
    mine = actions[me]
    graph = build_conflict_graph(members)
    opponents = (graph.find_opponents(me) if me in graph.ids else frozenset()) & set(group)
    action_by_id = {name: actions.get(name, Intention.KEEP) for name in opponents}
    first = frozenset(name for name, action in action_by_id.items() if action > mine)
    after = frozenset(name for name, action in action_by_id.items() if action < mine)
    return NegotiationDecision(mine, first, after, until, tuple(group))


def format_outcome(
    conversation: Conversation,
    actions: Mapping[str, Intention],
    critique: Critique,
    consensus: float | None,
    decided_by: str,
) -> str:
    """Return the outcome of a round as JSON; the total is the original's, with a missing consensus counted as 0."""
    outcome = {
        "group": conversation.group,
        "round": conversation.round,
        "by": decided_by,
        "actions": {name: action.name for name, action in actions.items()},
        "safety": round(critique.safety, 3),
        "efficiency": round(critique.efficiency, 3),
        "consensus": consensus,
        "total": round(3 * (consensus or 0.0) + 5 * critique.safety + 2 * critique.efficiency, 3),
        "feedback": critique.feedback,
    }
    return json.dumps(outcome, sort_keys=True, separators=(",", ":"))


class LlmNegotiator:
    """Speaks for one CAV. In every round each member in turn sends one message over the channel, in its own ticks.

    instant: a compatibility switch: the most central member speaks for all, completes all rounds within one tick, and
    announces the outcome. Where the model gives nothing usable the rule decides, and that is noted. rate: see
    `Briefing.v2x_rate`.
    """

    def __init__(
        self,
        model: LanguageModel,
        instant: bool = False,
        parameters: LlmNegotiationParameters = LLM_NEGOTIATION,
        rate: V2xRate = "fixed",
    ) -> None:
        self._model, self._instant, self._parameters = model, instant, parameters
        self._sending = McmSending(rate)
        self.peers = PeerTable(self._sending.memory_ticks)
        self._conversation: Conversation | None = None
        self._recent: list[tuple[int, Message, Utterance]] = []
        """Utterances of the last ticks: those of a conversation may arrive before the own conflict is detected."""
        self._finished_tick: dict[tuple[str, ...], int] = {}
        self._decision: NegotiationDecision | None = None
        self._terms = NegotiationTerms()
        self._source = ""
        """The station whose actions the decision follows."""
        self._has_new_terms = False
        self._notes: deque[Note] = deque()
        self._due_tick = 0

    def is_due(self, tick: int) -> bool:  # noqa: ARG002
        """Implement `Negotiator.is_due`: it may have the turn in any tick."""
        return True

    def step(self, tick: int, me: NegotiationMember, heard: Sequence[Message]) -> NegotiationStep:
        """Implement `Negotiator.step`."""
        self._recent = [entry for entry in self._recent if tick - entry[0] < self._parameters.cool_down_ticks]
        for message in heard:
            self._receive(tick, message)
        members = self.peers.predict_members(tick)
        messages: list[Message] = []
        self._has_new_terms = False
        is_due = tick >= self._due_tick
        if is_due:
            self._due_tick = find_next_planning_tick(tick)
            self._begin_conversation(tick, me.id, members)
        if not self._obey_request(tick, me.id, members):
            messages += self._speak(tick, me.id, members)
        if is_due or self._has_new_terms:
            mcm = build_mcm_message(me, tick, self._get_valid_terms(tick))
            if self._sending.is_due(tick, mcm):
                messages.append(mcm)
                self.peers.receive(mcm)
        self._collect_model_notes()
        return NegotiationStep(self.get_valid_decision(tick), tuple(messages), self._take_due_notes())

    def _collect_model_notes(self) -> None:
        """Move the notes of the model to the own ones."""
        self._notes += self._model.notes
        self._model.notes.clear()

    def _take_due_notes(self) -> tuple[Note, ...]:
        """Return as many notes as fit into one tick."""
        due: list[Note] = []
        size = 0
        while self._notes and size + len(self._notes[0].text) <= self._parameters.max_note_chars:
            due.append(self._notes.popleft())
            size += len(due[-1].text)
        return tuple(due)

    def get_valid_decision(self, tick: int) -> NegotiationDecision | None:
        """Implement `Negotiator.get_valid_decision`."""
        return self._decision if self._decision is not None and tick <= self._decision.until_tick else None

    def _get_valid_terms(self, tick: int) -> NegotiationTerms:
        """Return the terms that are still in force."""
        return self._terms if tick <= self._terms.until_tick else NegotiationTerms()

    def _receive(self, tick: int, message: Message) -> None:
        """Store an MCM or an utterance; ignore everything else."""
        if message.type != TEXT:
            self.peers.receive(message)
            return
        try:
            utterance = parse_utterance(str(decode(message)))
        except MessageError:
            return
        if utterance is None:
            return
        if self._conversation is not None:
            self._conversation.receive(tick, message, utterance)
        self._recent.append((tick, message, utterance))

    def _begin_conversation(self, tick: int, me: str, members: Sequence[NegotiationMember]) -> None:
        """Begin a conversation if the own CAV is in a group that has not just finished one."""
        graph = build_conflict_graph(members, use_planned=self.get_valid_decision(tick) is not None)
        group = graph.find_group(me) if me in graph.ids else ()
        if not group or self._is_conversing(tick):
            return
        cool_down_ticks = self._parameters.cool_down_ticks
        if tick - self._finished_tick.get(group, -cool_down_ticks) < cool_down_ticks:
            return
        order = compute_speaking_order([member for member in members if member.id in group])
        self._conversation = Conversation(group, order, tick)
        for received_tick, message, utterance in self._recent:
            self._conversation.receive(received_tick, message, utterance)
        self._conversation.last_activity_tick = tick

    def _is_conversing(self, tick: int) -> bool:
        """Return whether a conversation is going on."""
        conversation = self._conversation
        if conversation is None or conversation.is_done:
            return False
        return tick - conversation.last_activity_tick < self._parameters.stale_ticks

    def _obey_request(self, tick: int, me: str, members: Sequence[NegotiationMember]) -> bool:
        """Adopt the request of the most central member of the own group; return whether there is a new one.

        Of several requests that of the smaller station id counts.
        """
        for name, mcm in self.peers.get_latest_mcms(tick).items():
            action = mcm.requests.get(me)
            if name == me or action is None or mcm.until_tick < tick or not {me, name} <= set(mcm.group):
                continue
            held = self.get_valid_decision(tick)
            if held is not None and self._source not in ("", name) and self._source < name:
                continue
            is_known = held is not None and self._source == name and held.until_tick == mcm.until_tick
            if is_known and held is not None and held.intention == action:
                continue
            self._adopt(tick, me, members, mcm, name)
            return True
        return False

    def _adopt(self, tick: int, me: str, members: Sequence[NegotiationMember], mcm: Mcm, source: str) -> None:
        """Make the actions in the MCM of `source` the own decision."""
        until = min(mcm.until_tick, tick + self._parameters.max_agreement_ticks)
        self._decision = build_decision(me, members, mcm.requests, mcm.group, until)
        self._terms = NegotiationTerms(answers={source: True}, group=mcm.group, until_tick=until)
        self._source = source
        self._finished_tick[mcm.group] = tick
        conversation = self._conversation
        is_own = conversation is not None and conversation.group == mcm.group
        if conversation is not None and is_own and mcm.pose.tick > conversation.round_opened_tick:
            conversation.is_done = True

    def _speak(self, tick: int, me: str, members: Sequence[NegotiationMember]) -> list[Message]:
        """Return the own utterance if the own CAV has the turn; the most central member ends the round."""
        conversation = self._conversation
        if conversation is None or conversation.is_done:
            return []
        present = {member.id: member for member in members if member.id in conversation.group}
        if set(present) != set(conversation.group):  # a member has left: those still in conflict begin anew
            conversation.is_done = True
            return []
        is_central = conversation.order[0] == me
        if self._instant:
            if is_central:
                self._complete_all_rounds(tick, me, present, conversation)
            return []
        speaker = conversation.find_next_speaker(tick)
        if speaker == me:
            text = self._compose_text(conversation, present[me], present)
            return [self._say(conversation, Utterance(conversation.id, conversation.round, False, text), me, tick)]
        if speaker is None and is_central:
            return self._conclude_round(tick, me, present, conversation)
        return []

    def _say(self, conversation: Conversation, utterance: Utterance, me: str, tick: int) -> Message:
        """Store an own utterance and return it as a message."""
        encoded = encode(utterance.to_text())
        message = Message(encoded.type, encoded.payload, me, tick)
        conversation.receive(tick, message, utterance)
        return message

    def _compose_text(
        self, conversation: Conversation, speaker: NegotiationMember, present: dict[str, NegotiationMember]
    ) -> str:
        """Return a member's next message; if the model gives none, what the rule would have it say."""
        others = [present[name] for name in conversation.order if name != speaker.id]
        chat = build_speaker_chat(speaker, others, conversation.get_utterances(), conversation.feedback)
        text = self._model.ask(chat, MESSAGE_TOKENS, clean_message)
        if text is not None:
            return text
        members = tuple(present.values())
        action = apply_rule(members, build_conflict_graph(members), conversation.group)[speaker.id]
        return f"I will do what the rule says: {action.name}."

    def _conclude_round(
        self, tick: int, me: str, present: dict[str, NegotiationMember], conversation: Conversation
    ) -> list[Message]:
        """Announce the actions agreed on; open another round if the critic objects."""
        critique = self._agree(tick, me, present, conversation)
        if not critique.feedback or conversation.round >= self._parameters.rounds:
            self._finish(tick, conversation)
            return []
        next_round = Utterance(conversation.id, conversation.round + 1, True, critique.feedback)
        return [self._say(conversation, next_round, me, tick)]

    def _complete_all_rounds(
        self, tick: int, me: str, present: dict[str, NegotiationMember], conversation: Conversation
    ) -> None:
        """Complete all rounds within this tick, with one model speaking for all members."""
        for number in range(1, self._parameters.rounds + 1):
            conversation.round = number
            for name in conversation.order:
                text = self._compose_text(conversation, present[name], present)
                conversation.text_by_turn[number, name] = text
            critique = self._agree(tick, me, present, conversation)
            conversation.feedback = critique.feedback
            if not critique.feedback:
                break
        self._finish(tick, conversation)

    def _finish(self, tick: int, conversation: Conversation) -> None:
        """End the conversation."""
        self._finished_tick[conversation.group] = tick
        conversation.is_done = True

    def _agree(self, tick: int, me: str, present: dict[str, NegotiationMember], conversation: Conversation) -> Critique:
        """Make the actions of this round the own decision and request; return their critique."""
        members, group = tuple(present.values()), conversation.group
        graph = build_conflict_graph(members)
        chat = build_action_chat(members, conversation.get_utterances(rounds=1))
        answer = self._model.ask(chat, ACTION_TOKENS, partial(parse_actions, group=group))
        actions, consensus = answer or (apply_rule(members, graph, group), None)
        actions = avoid_slow_keeping(actions, members)
        until = tick + count_conflict_ticks(graph, group) + CONFLICT.aftermath_ticks
        self._decision = build_decision(me, members, actions, group, until)
        self._terms = NegotiationTerms(dict(list(actions.items())[:MAX_NAMES]), {}, group[:MAX_NAMES], until)
        self._source, self._has_new_terms = me, True
        critique = evaluate_actions(members, actions)
        self._collect_model_notes()  # the outcome follows the exchanges that led to it
        outcome = format_outcome(conversation, actions, critique, consensus, "model" if answer else "rule")
        self._notes.append(Note(OUTCOME, outcome))
        return critique
