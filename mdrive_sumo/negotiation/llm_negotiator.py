"""Negotiation by a language model: the cars talk, the most central one reads off who does what (protocol 10.4)."""

import json
from collections import deque
from collections.abc import Mapping, Sequence
from functools import partial

from mdrive_sumo.contract import Message, Note
from mdrive_sumo.negotiation.conflict_graph import (
    AFTERMATH_TICKS,
    STEP_TICKS,
    ConflictGraph,
    build_conflict_graph,
    find_next_planning_tick,
)
from mdrive_sumo.negotiation.conversation import Conversation, Utterance, compute_speaking_order, parse_utterance
from mdrive_sumo.negotiation.critic import Critique, avoid_slow_keeping, evaluate_actions
from mdrive_sumo.negotiation.language_model import LanguageModel
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

ROUNDS = 3
COOL_DOWN_TICKS = 20
"""Exactly the same group does not negotiate again before."""
LONGEST_TICKS = 100
"""No agreement holds longer: 4 s of prediction and the aftermath."""
OUTCOME = "negotiation"
"""The kind of note that tells what came of a round."""
NOTED_CHARS = 150_000
"""Notes of one tick; what is more waits for the next one (a reply may carry 200 000)."""


class LlmNegotiator:
    """One CAV's voice. In every round each member in turn says something, over the channel, in its own ticks.

    `instant`: a compatibility switch: the most central member speaks for all, settles all rounds within one tick, and
    announces the outcome. Where the model gives nothing usable the rule decides, and that is noted.
    """

    def __init__(self, model: LanguageModel, instant: bool = False) -> None:
        self._model, self._instant = model, instant
        self.peers = PeerTable()
        self._talk: Conversation | None = None
        self._early: list[tuple[int, Message, Utterance]] = []
        self._finished: dict[tuple[str, ...], int] = {}
        self._decision: NegotiationDecision | None = None
        self._terms = NegotiationTerms()
        self._source = ""
        self._news = False
        self._notes: deque[Note] = deque()
        self._due_tick = 0

    def step(self, tick: int, me: NegotiationMember, heard: Sequence[Message]) -> NegotiationStep:
        """See Negotiator."""
        self._early = [entry for entry in self._early if tick - entry[0] < COOL_DOWN_TICKS]
        for message in heard:
            self._hear(tick, message)
        members = self.peers.predict_members(tick)
        messages: list[Message] = []
        self._news = False
        due = tick >= self._due_tick
        if due:
            self._due_tick = find_next_planning_tick(tick)
            self._look(tick, me.id, members)
        if self._obeyed(tick, me.id, members) is None:
            messages += self._talked(tick, me.id, members)
        if due or self._news:
            messages.append(build_mcm_message(me, tick, self._current(tick)))
            self.peers.receive(messages[-1])
        self._notes += self._model.notes
        self._model.notes.clear()
        return NegotiationStep(self._valid(tick), tuple(messages), self._due_notes())

    def _due_notes(self) -> tuple[Note, ...]:
        due: list[Note] = []
        size = 0
        while self._notes and size + len(self._notes[0].text) <= NOTED_CHARS:
            due.append(self._notes.popleft())
            size += len(due[-1].text)
        return tuple(due)

    def _valid(self, tick: int) -> NegotiationDecision | None:
        return self._decision if self._decision is not None and tick <= self._decision.until_tick else None

    def _current(self, tick: int) -> NegotiationTerms:
        return self._terms if tick <= self._terms.until_tick else NegotiationTerms()

    def _hear(self, tick: int, message: Message) -> None:
        if message.type != TEXT:
            self.peers.receive(message)
            return
        try:
            line = parse_utterance(str(decode(message)))
        except MessageError:
            return
        if line is None:
            return
        if self._talk is not None:
            self._talk.receive(tick, message, line)
        self._early.append((tick, message, line))

    def _look(self, tick: int, me: str, members: Sequence[NegotiationMember]) -> None:
        """Begins a conversation if I am in a group that has not just had one."""
        decision = self._valid(tick)
        graph = build_conflict_graph(members, use_planned=decision is not None)
        group = graph.find_group(me) if me in graph.ids else ()
        if not group or (
            self._talk is not None and not self._talk.is_done and tick - self._talk.last_activity_tick < 99
        ):
            return
        if tick - self._finished.get(group, -COOL_DOWN_TICKS) < COOL_DOWN_TICKS:
            return
        order = compute_speaking_order([m for m in members if m.id in group])
        self._talk = Conversation(group, order, tick)
        for heard_tick, message, line in self._early:
            self._talk.receive(heard_tick, message, line)
        self._talk.last_activity_tick = tick

    def _obeyed(self, tick: int, me: str, members: Sequence[NegotiationMember]) -> NegotiationDecision | None:
        """Takes over what the most central member of my group asks of me, if anybody does; ties to the smaller id."""
        for name, mcm in self.peers.get_latest_mcms(tick).items():
            asked = mcm.requests.get(me)
            if name == me or asked is None or mcm.until_tick < tick or not {me, name} <= set(mcm.group):
                continue
            held = self._valid(tick)
            if held is not None and self._source not in ("", name) and self._source < name:
                continue
            known = self._source == name and held is not None and held.until_tick == mcm.until_tick
            if known and held is not None and held.intention == asked:
                continue
            self._take(tick, me, members, mcm, name)
            return self._decision
        return None

    def _take(self, tick: int, me: str, members: Sequence[NegotiationMember], mcm: Mcm, source: str) -> None:
        until = min(mcm.until_tick, tick + LONGEST_TICKS)
        self._decision = _decision(me, members, mcm.requests, mcm.group, until)
        self._terms = NegotiationTerms(answers={source: True}, group=mcm.group, until_tick=until)
        self._source = source
        self._finished[mcm.group] = tick
        if self._talk is not None and self._talk.group == mcm.group and mcm.pose.tick > self._talk.round_opened_tick:
            self._talk.is_done = True

    def _close(self, tick: int, group: tuple[str, ...]) -> None:
        self._finished[group] = tick
        if self._talk is not None and self._talk.group == group:
            self._talk.is_done = True

    def _talked(self, tick: int, me: str, members: Sequence[NegotiationMember]) -> list[Message]:
        """What I say now, if it is my turn; the most central one ends the round."""
        talk = self._talk
        if talk is None or talk.is_done:
            return []
        present = {m.id: m for m in members if m.id in talk.group}
        if set(present) != set(talk.group):  # somebody has left: who is still in conflict starts anew
            talk.is_done = True
            return []
        if self._instant:
            return self._settled_at_once(tick, me, present) if talk.order[0] == me else []
        turn = talk.find_next_speaker(tick)
        if turn == me:
            text = self._spoken(talk, present[me], present)
            message = _sent(line := Utterance(talk.id, talk.round, False, text), me, tick)
            talk.receive(tick, message, line)
            return [message]
        return self._concluded(tick, me, present) if turn is None and talk.order[0] == me else []

    def _spoken(self, talk: Conversation, speaker: NegotiationMember, present: dict[str, NegotiationMember]) -> str:
        """A member's next message; if the model has none, what the rule would have it say."""
        others = [present[name] for name in talk.order if name != speaker.id]
        chat = build_speaker_chat(speaker, others, talk.get_utterances(), talk.feedback)
        said = self._model.ask(chat, MESSAGE_TOKENS, clean_message)
        if said is not None:
            return said
        members = tuple(present.values())
        action = apply_rule(members, build_conflict_graph(members), talk.group)[speaker.id]
        return f"I will do what the rule says: {action.name}."

    def _concluded(self, tick: int, me: str, present: dict[str, NegotiationMember]) -> list[Message]:
        """Reads off the actions, announces them, and opens another round if they are not good enough."""
        talk = self._talk
        assert talk is not None, "somebody has talked"
        opinion = self._agreed(tick, me, present)
        if not opinion.feedback or talk.round >= ROUNDS:
            self._close(tick, talk.group)
            return []
        message = _sent(line := Utterance(talk.id, talk.round + 1, True, opinion.feedback), me, tick)
        talk.receive(tick, message, line)
        return [message]

    def _agreed(self, tick: int, me: str, present: dict[str, NegotiationMember]) -> Critique:
        """The actions that follow from this round become my decision and what I ask of the others."""
        talk = self._talk
        assert talk is not None, "somebody has talked"
        members = tuple(present.values())
        graph = build_conflict_graph(members)
        chat = build_action_chat(members, talk.get_utterances(rounds=1))
        found = self._model.ask(chat, ACTION_TOKENS, partial(parse_actions, group=talk.group))
        actions, consensus = found or (apply_rule(members, graph, talk.group), None)
        actions = avoid_slow_keeping(actions, members)
        until = tick + _conflict_ticks(graph, talk.group) + AFTERMATH_TICKS
        self._decision = _decision(me, members, actions, talk.group, until)
        self._terms = NegotiationTerms(dict(list(actions.items())[:MAX_NAMES]), {}, talk.group[:MAX_NAMES], until)
        self._source, self._news = me, True
        opinion = evaluate_actions(members, actions)
        self._notes += self._model.notes  # so that the outcome stands behind the exchanges that led to it
        self._model.notes.clear()
        self._notes.append(Note(OUTCOME, _outcome(talk, actions, opinion, consensus, "model" if found else "rule")))
        return opinion

    def _settled_at_once(self, tick: int, me: str, present: dict[str, NegotiationMember]) -> list[Message]:
        """All rounds within this tick, with one mind speaking for all."""
        talk = self._talk
        assert talk is not None, "a conversation was begun"
        for number in range(1, ROUNDS + 1):
            talk.round = number
            for name in talk.order:
                talk.text_by_turn[number, name] = self._spoken(talk, present[name], present)
            opinion = self._agreed(tick, me, present)
            talk.feedback = opinion.feedback
            if not opinion.feedback:
                break
        self._close(tick, talk.group)
        return []


def _sent(line: Utterance, me: str, tick: int) -> Message:
    message = encode(line.to_text())
    return Message(message.type, message.payload, me, tick)


def _conflict_ticks(graph: ConflictGraph, group: Sequence[str]) -> int:
    return graph.count_conflict_ticks(group) if graph.in_conflict.any() else STEP_TICKS


def _decision(
    me: str, members: Sequence[NegotiationMember], actions: Mapping[str, Intention], group: tuple[str, ...], until: int
) -> NegotiationDecision:
    """What the actions of all mean for me: who has the faster one goes first where our ways meet."""
    mine = actions[me]
    graph = build_conflict_graph(members)
    foes = (graph.find_opponents(me) if me in graph.ids else frozenset()) & set(group)
    told = {foe: actions.get(foe, Intention.KEEP) for foe in foes}
    first = frozenset(foe for foe, action in told.items() if action > mine)
    after = frozenset(foe for foe, action in told.items() if action < mine)
    return NegotiationDecision(mine, first, after, until, tuple(group))


def _outcome(
    talk: Conversation, actions: Mapping[str, Intention], opinion: Critique, consensus: float | None, by: str
) -> str:
    """What a round came to; the total is the original's, where an untold consensus counts as none."""
    told = {
        "group": talk.group,
        "round": talk.round,
        "by": by,
        "actions": {name: action.name for name, action in actions.items()},
        "safety": round(opinion.safety, 3),
        "efficiency": round(opinion.efficiency, 3),
        "consensus": consensus,
        "total": round(3 * (consensus or 0.0) + 5 * opinion.safety + 2 * opinion.efficiency, 3),
        "feedback": opinion.feedback,
    }
    return json.dumps(told, sort_keys=True, separators=(",", ":"))
