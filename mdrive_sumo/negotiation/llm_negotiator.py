"""Negotiation by a language model: CAVs exchange messages, the most central one states the outcome (protocol 10.4)."""

import json
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from mdrive_sumo.contract import Message, Note
from mdrive_sumo.contract.briefing import V2xRate
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.negotiation.agreement import (
    OwnAgreement,
    Request,
    build_decision,
    find_exits,
    is_possible,
    move_forward,
    read_agreement,
    release_passed,
)
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
from mdrive_sumo.negotiation.mcm_sending import McmSending
from mdrive_sumo.negotiation.negotiator import NegotiationDecision, NegotiationMember, NegotiationStep
from mdrive_sumo.negotiation.outcome_note import OUTCOME, format_outcome
from mdrive_sumo.negotiation.peer_table import PeerTable
from mdrive_sumo.negotiation.right_of_way_claims import NegotiationTerms, build_mcm_message
from mdrive_sumo.negotiation.rule_negotiator import apply_rule
from mdrive_sumo.negotiation.speaker import GroupAgreement, Speaker
from mdrive_sumo.v2x.messages import MAX_NAMES, TEXT, Mcm, MessageError, decode, encode


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


class LlmNegotiator:
    """Speaks for one CAV. In every round each member in turn sends one message over the channel, in its own ticks.

    instant: a compatibility switch: the most central member speaks for all, completes all rounds within one tick, and
    announces the outcome. Where the model gives nothing usable the rule decides, and that is noted. rate: see
    `Briefing.v2x_rate`.
    """

    def __init__(
        self,
        speaker: Speaker,
        instant: bool = False,
        parameters: LlmNegotiationParameters = LLM_NEGOTIATION,
        rate: V2xRate = "fixed",
    ) -> None:
        self._speaker, self._instant, self._parameters = speaker, instant, parameters
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
        self._answered: dict[str, Request] = {}
        """The last request of each station that was adopted or refused."""
        self._own_agreement: OwnAgreement | None = None
        self._exits: Mapping[str, Float] = {}
        """Where those that go first leave the areas that they share with the own car."""
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
            self._release(tick, me.id, members)
            self._begin_conversation(tick, me.id, members)
        self._revise_refused(tick, me.id, members)
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
        """Move the notes of the speaker to the own ones."""
        self._notes += self._speaker.notes
        self._speaker.notes.clear()

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
        if not group or self._is_conversing(tick) or set(group) <= set(self._get_held_order(tick, me)):
            return
        cool_down_ticks = self._parameters.cool_down_ticks
        if tick - self._finished_tick.get(group, -cool_down_ticks) < cool_down_ticks:
            return
        order = compute_speaking_order([member for member in members if member.id in group])
        self._conversation = Conversation(group, order, tick)
        for received_tick, message, utterance in self._recent:
            self._conversation.receive(received_tick, message, utterance)
        self._conversation.last_activity_tick = tick

    def _get_held_order(self, tick: int, me: str) -> tuple[str, ...]:
        """Return the order of passing in force, (): none. A conflict is settled once."""
        if self.get_valid_decision(tick) is None:
            return ()
        if self._source == me:
            return self._own_agreement.agreement.order if self._own_agreement is not None else ()
        return self._answered[self._source].order

    def _is_conversing(self, tick: int) -> bool:
        """Return whether a conversation is going on."""
        conversation = self._conversation
        if conversation is None or conversation.is_done:
            return False
        return tick - conversation.last_activity_tick < self._parameters.stale_ticks

    def _decide(
        self,
        me: str,
        members: Sequence[NegotiationMember],
        agreement: GroupAgreement,
        group: tuple[str, ...],
        until: int,
    ) -> None:
        self._decision = build_decision(me, members, agreement, group, until)
        self._exits = find_exits(me, members, self._decision.yield_to)

    def _release(self, tick: int, me: str, members: Sequence[NegotiationMember]) -> None:
        """End what is done of the decision: it no longer waits for those that have passed."""
        held = self.get_valid_decision(tick)
        decision = held and release_passed(held, me, members, self._exits)
        if decision is held:
            return
        self._decision = decision
        if decision is not None and me in self._terms.requests:
            self._terms = replace(self._terms, requests={**self._terms.requests, me: decision.intention})

    def _revise_refused(self, tick: int, me: str, members: Sequence[NegotiationMember]) -> None:
        """Ask all again, once, if members cannot carry out the own agreement: they then go first.

        An agreement that is refused again, or asks too much of this car then, is dropped.
        """
        own = self._own_agreement
        if own is None or tick > own.until_tick or self._source != me:
            return
        order, present = own.agreement.order, {member.id for member in members}
        refusing = [
            name
            for name, mcm in self.peers.get_latest_mcms(tick).items()
            if name in order and mcm.answers.get(me) is False and mcm.pose.tick > own.tick
        ]
        if not refusing or not present >= set(order):
            return
        if self._conversation is not None and self._conversation.group == tuple(sorted(order)):
            self._finish(tick, self._conversation)
        changed = move_forward(refusing, own.agreement, members)
        outcome: dict[str, object] = {"group": sorted(order), "by": "refusal", "refused": refusing}
        if own.is_revised or not is_possible(me, members, changed):
            self._own_agreement = self._decision = None
            self._terms, self._has_new_terms = NegotiationTerms(), True
        else:
            self._own_agreement = OwnAgreement(changed, tick, own.until_tick, is_revised=True)
            self._request(me, members, changed, own.until_tick)
            outcome["order"] = changed.order
        self._notes.append(Note(OUTCOME, json.dumps(outcome, sort_keys=True, separators=(",", ":"))))

    def _obey_request(self, tick: int, me: str, members: Sequence[NegotiationMember]) -> bool:
        """Adopt or refuse the request of the most central member of the own group; return whether there is a new one.

        Of several requests that of the smaller station id counts.
        """
        for name, mcm in self.peers.get_latest_mcms(tick).items():
            action = mcm.requests.get(me)
            if name == me or action is None or mcm.until_tick < tick or not {me, name} <= set(mcm.group):
                continue
            held = self.get_valid_decision(tick)
            if held is not None and self._source not in ("", name) and self._source < name:
                continue
            agreement = read_agreement(name, mcm)
            request = Request(action, agreement.order, mcm.until_tick)
            has_refused = self._terms.answers.get(name) is False
            if self._answered.get(name) == request and (self._source == name or has_refused):
                continue
            self._answered[name] = request
            if is_possible(me, members, agreement):
                self._adopt(tick, me, members, mcm, name)
            else:
                self._refuse(tick, mcm, name)
            return True
        return False

    def _refuse(self, tick: int, mcm: Mcm, source: str) -> None:
        """Answer that the own car cannot do what the MCM of `source` asks; what it has agreed on before stays."""
        terms = self._get_valid_terms(tick)
        until = terms.until_tick if terms.requests else mcm.until_tick
        self._terms = replace(terms, answers={**terms.answers, source: False}, until_tick=until)
        self._has_new_terms = True

    def _adopt(self, tick: int, me: str, members: Sequence[NegotiationMember], mcm: Mcm, source: str) -> None:
        """Make the agreement in the MCM of `source` the own decision."""
        until = min(mcm.until_tick, tick + self._parameters.max_agreement_ticks)
        group = tuple(sorted(mcm.group))
        self._decide(me, members, read_agreement(source, mcm), group, until)
        self._terms = NegotiationTerms(answers={source: True}, group=mcm.group, until_tick=until)
        self._source = source
        self._finished_tick[group] = tick
        conversation = self._conversation
        is_own = conversation is not None and conversation.group == group
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
        text = self._speaker.say(conversation, speaker.id, present)
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
        answer = self._speaker.conclude(conversation, me, present)
        agreement = answer or GroupAgreement(apply_rule(members, graph, group))
        agreement = replace(agreement, actions=avoid_slow_keeping(agreement.actions, members))
        until = tick + count_conflict_ticks(graph, group) + CONFLICT.aftermath_ticks
        self._own_agreement = OwnAgreement(agreement, tick, until)
        self._request(me, members, agreement, until)
        critique = evaluate_actions(members, agreement.actions, agreement.order)
        self._collect_model_notes()  # the outcome follows the exchanges that led to it
        outcome = format_outcome(conversation, agreement, critique, "model" if answer else "rule")
        self._notes.append(Note(OUTCOME, outcome))
        return critique

    def _request(self, me: str, members: Sequence[NegotiationMember], agreement: GroupAgreement, until: int) -> None:
        """Make an agreement the own decision, and ask all others to keep to it."""
        group = agreement.order or tuple(sorted(agreement.actions))
        self._decide(me, members, agreement, group, until)
        requests = dict(list(agreement.actions.items())[:MAX_NAMES])
        self._terms = NegotiationTerms(requests, {me: True} if agreement.order else {}, group[:MAX_NAMES], until)
        self._source, self._has_new_terms = me, True
