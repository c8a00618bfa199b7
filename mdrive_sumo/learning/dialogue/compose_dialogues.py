"""Conversations about situations: what members say, what they agree on, and the requests to the model that come of it.

Facts come from the simulation, except *made-up holds*: in some conversations something that only one member knows of
holds it up, so that it has to pass later. There the words decide the order, and no message tells it but the words.
"""

import math
import random
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise

from mdrive_sumo.learning.dialogue.dialogue_samples import Dialogue
from mdrive_sumo.learning.dialogue.situations import SAME_SCORE, Situation, rename_members
from mdrive_sumo.learning.dialogue.wording import Clause, draw_words
from mdrive_sumo.negotiation.conversation import Utterance
from mdrive_sumo.negotiation.dialogue.answer_grammar import MAX_WORD_ENTRIES
from mdrive_sumo.negotiation.dialogue.answers import (
    ACTION_WORDS,
    MAX_MESSAGE_BYTES,
    Agreement,
    OrderProposal,
    format_agreement,
    format_proposal,
    replace_letters,
)
from mdrive_sumo.negotiation.dialogue.dialogue_prompt import (
    FASTER_FEEDBACK,
    SaidLine,
    Talk,
    describe_hold,
    format_close_pair,
    format_metres,
    format_prompt,
    format_seconds,
)
from mdrive_sumo.negotiation.dialogue.dialogue_view import DialogueView, Hold
from mdrive_sumo.negotiation.dialogue.vocabulary import AGREE, SAY, DialogueVocabulary
from mdrive_sumo.negotiation.intention import replace_slow_keep
from mdrive_sumo.v2x.messages import Intention

STATION = "00000000"
"""Stands for a station id when bytes are counted: pseudonyms have eight digits."""
HEADER = Utterance(STATION, 1, False, "").to_text()
"""Is sent before the text; conversations have ids of eight digits, too."""
MOST_TRAINED_MEMBERS = 4
"""Larger groups are in validation and test only."""
STOPPING_DELAY_S = 3.0
"""A member that has to wait longer for its areas stops, the others slow down. Chosen."""
HELD_STOP_M = 10.0
"""A member whose hold is nearer stops. Chosen."""
NATURAL_HOLD_SHARE = 0.5
"""How often a member says what holds it up in the simulation, which need not matter. Chosen."""
HOLDS = ("pedestrian", "crossing pedestrian", "cyclist", "crossing cyclist", "car", "lorry", "obstacle", "red light")
"""Names of made-up holds."""


@dataclass(frozen=True, slots=True)
class DialogueShares:
    """How often things happen in a conversation. All chosen."""

    made_up: float = 0.45
    """A member is held up by something made up."""
    second_made_up: float = 0.25
    """Of these: two members are."""
    modest: float = 0.4
    """A member that is held up says so in words only and leaves the order to others; that message is not learned."""
    silent: float = 0.05
    """A member's message is lost."""
    mistaken: float = 0.1
    """A member proposes a wrong order, which is not learned."""
    second_round: float = 0.15
    """The first round ends with a wrong order, and the critic objects."""
    faster: float = 0.05
    """The critic wants more speed after the first round."""


SHARES = DialogueShares()


@dataclass
class DialogueDraft:
    """A conversation while it is made."""

    situation: Situation
    place: str
    draw: random.Random
    vocabulary: DialogueVocabulary
    is_held_out: bool
    """Whether its words have patterns that training never sees."""
    base: str
    """Order that is right without made-up holds."""
    holds: Mapping[str, Hold]
    """Made-up ones, by letter."""
    said: list[SaidLine] = field(default_factory=list[SaidLine])
    known_holds: dict[str, Hold] = field(default_factory=dict[str, Hold])
    """Of which the words have told."""
    feedback: str = ""
    round: int = 1
    dialogues: list[Dialogue] = field(default_factory=list[Dialogue])

    @property
    def talk(self) -> Talk:
        """What has been said."""
        return Talk(tuple(self.said), self.feedback, self.round)

    def get_view(self, letter: str) -> DialogueView:
        """Return what a member knows, its made-up hold too."""
        view = self.situation.get_view(letter)
        return replace(view, hold=self.holds[letter]) if letter in self.holds else view

    def find_order(self, letter: str) -> str:
        """Return the order that is right by what a member knows now."""
        known = self.known_holds | {name: hold for name, hold in self.holds.items() if name == letter}
        return move_back(self.base, known)


def compose_conversation(
    situation: Situation,
    draw: random.Random,
    vocabulary: DialogueVocabulary,
    is_held_out: bool,
    shares: DialogueShares = SHARES,
) -> list[Dialogue]:
    """Return the requests of one conversation about a situation, with the answers that are taught."""
    talk = begin_conversation(situation, draw, vocabulary, is_held_out, shares)
    if draw.random() < shares.second_round:
        _fail_round(talk)
    elif draw.random() < shares.faster:
        _speak_all(talk, shares, is_learned=False)
        talk.feedback, talk.round = FASTER_FEEDBACK, 2
    _speak_all(talk, shares, is_learned=True)
    _conclude(talk)
    return talk.dialogues


def begin_conversation(
    situation: Situation,
    draw: random.Random,
    vocabulary: DialogueVocabulary,
    is_held_out: bool,
    shares: DialogueShares,
) -> DialogueDraft:
    """Return a conversation in which no member has spoken; the letters of the members are drawn."""
    letters = situation.letters
    named = rename_members(situation, dict(zip(letters, draw.sample(letters, len(letters)), strict=True)))
    base = settle_ties(named, named.choose_order())
    holds = draw_holds(named, base, draw, shares) if draw.random() < shares.made_up else {}
    return DialogueDraft(named, situation.place, draw, vocabulary, is_held_out, base, holds)


def settle_ties(situation: Situation, order: str) -> str:
    """Return an order in which members that enter their areas at the same time pass by letter, so that all know it.

    The teachers let the smaller station id pass, which prompts do not show. Leaders stay first, and an order that the
    simulation found worse is not taken.
    """
    view = situation.views[0]
    is_worse = set(situation.find_worse(SAME_SCORE))

    def are_equal(first: str, second: str) -> bool:
        a, b = view.get_member(first), view.get_member(second)
        starts = [one.zone_s[0] if one.zone_s else math.inf for one in (a, b)]
        return starts[0] == starts[1] and second != a.follows and first != b.follows

    for _ in order:
        for i in range(len(order) - 1):
            swapped = order[:i] + order[i + 1] + order[i] + order[i + 2 :]
            if order[i] > order[i + 1] and are_equal(order[i], order[i + 1]) and swapped not in is_worse:
                order = swapped
    return order


def draw_holds(situation: Situation, base: str, draw: random.Random, shares: DialogueShares) -> dict[str, Hold]:
    """Return made-up holds of members that do not pass last anyway and lead no other one."""
    leaders = {member.follows for view in situation.views for member in view.members}
    usable = [letter for letter in base[:-1] if letter not in leaders and situation.get_view(letter).hold is None]
    count = min(len(usable), 2 if draw.random() < shares.second_made_up else 1)
    seconds = draw.sample(range(30, 100), count)
    return {
        letter: Hold(draw.choice(HOLDS), float(draw.randint(3, 25)), tenths / 10)
        for letter, tenths in zip(draw.sample(usable, count), seconds, strict=True)
    }


def move_back(order: str, holds: Mapping[str, Hold]) -> str:
    """Return an order in which members that are held up pass after all others, the first to be free before the rest."""
    late = sorted((hold.seconds or 0.0, order.index(letter), letter) for letter, hold in holds.items())
    return "".join(letter for letter in order if letter not in holds) + "".join(letter for *_, letter in late)


def choose_action(view: DialogueView, order: str, letter: str, hold: Hold | None) -> Intention:
    """Return what a member does in an order: it enters its areas when those before it have left them.

    hold: of that member, as far as it is known.
    """
    member, free_from = view.get_member(letter), 0.0
    if hold is not None:
        is_near = hold.distance_m is not None and hold.distance_m < HELD_STOP_M
        return Intention.STOP if is_near else Intention.SLOWER
    for earlier in order[: order.index(letter)]:
        zone = view.get_member(earlier).zone_s
        if zone is not None:
            free_from = max(free_from, zone[0]) + zone[1] - zone[0]
    delay = free_from - member.zone_s[0] if member.zone_s is not None else 0.0
    if delay <= 0.0:
        return replace_slow_keep(Intention.KEEP, member.speed)
    return Intention.SLOWER if delay <= STOPPING_DELAY_S else Intention.STOP


def _speak_all(talk: DialogueDraft, shares: DialogueShares, is_learned: bool) -> None:
    """Let all members speak once, in their order."""
    for letter in talk.situation.speakers:
        kind = talk.draw.random()
        if kind < shares.silent:
            continue
        if kind < shares.silent + shares.mistaken:
            _say(talk, letter, _draw_other_order(talk), is_learned=False)
        elif letter in talk.holds and letter not in talk.known_holds and talk.draw.random() < shares.modest:
            head = _find_last_order(talk) or talk.base
            _say(talk, letter, head, is_learned=False, tells_hold=True)
        else:
            _say(talk, letter, talk.find_order(letter), is_learned)


def _fail_round(talk: DialogueDraft) -> None:
    """Let a first round end with a wrong order, of which the critic names a pair."""
    wrong = _draw_other_order(talk)
    for letter in talk.situation.speakers:
        _say(talk, letter, wrong, is_learned=False, tells_hold=False)
    right = talk.base
    first, second = next((a, b) for a, b in pairwise(wrong) if right.index(a) > right.index(b))
    talk.feedback, talk.round = format_close_pair(*sorted((first, second))), 2


def _draw_other_order(talk: DialogueDraft) -> str:
    order = talk.base
    i = talk.draw.randrange(len(order) - 1)
    return order[:i] + order[i + 1] + order[i] + order[i + 2 :]


def _find_last_order(talk: DialogueDraft) -> str:
    """Return the order in the last message of this round; "" if there is none."""
    lines = [line for line in talk.said if line.round == talk.round]
    return lines[-1].text.split(" ")[1].replace(">", "") if lines else ""


def _say(talk: DialogueDraft, letter: str, order: str, is_learned: bool, tells_hold: bool = True) -> None:
    """Let a member say an order; keep the request if the answer is to be learned."""
    view, last = talk.get_view(letter), _find_last_order(talk)
    stance = "propose" if not last else "accept" if order == last else "object"
    is_told = tells_hold and (letter in talk.holds or talk.draw.random() < NATURAL_HOLD_SHARE)
    hold = view.hold if is_told else None
    action = choose_action(view, order, letter, talk.holds.get(letter) if tells_hold else None)
    if talk.feedback == FASTER_FEEDBACK and letter == order[0] and action == Intention.KEEP:
        action = Intention.FASTER
    head = OrderProposal(stance, tuple(order), action)
    words = draw_message(talk, head, letter, hold)
    text = format_proposal(replace(head, words=words))
    if is_learned:
        lines = tuple(format_prompt(SAY, view, talk.talk, talk.vocabulary))
        talk.dialogues.append(Dialogue(SAY, lines, view.letters, letter, text, talk.place))
    talk.said.append(SaidLine(talk.round, letter, text))
    if letter in talk.holds and talk.holds[letter].name in words and tells_hold:
        talk.known_holds[letter] = talk.holds[letter]


def _conclude(talk: DialogueDraft) -> None:
    """Keep the request to say what was agreed."""
    situation = talk.situation
    view = situation.get_view(situation.speakers[0])
    order = move_back(talk.base, talk.known_holds)
    heads = [line.text.split(" ")[1].replace(">", "") for line in talk.said if line.round == talk.round]
    agreed = sum(head == order for head in heads) / len(order)
    actions = {letter: choose_action(view, order, letter, talk.known_holds.get(letter)) for letter in order}
    answer = format_agreement(Agreement(tuple(order), actions, agreed))
    lines = tuple(format_prompt(AGREE, view, talk.talk, talk.vocabulary))
    talk.dialogues.append(Dialogue(AGREE, lines, view.letters, view.me, answer, talk.place))


def draw_message(talk: DialogueDraft, head: OrderProposal, letter: str, hold: Hold | None) -> str:
    """Return the words of a message that fit into it; "" if none do.

    hold: what the speaker tells of itself.
    """
    view, slots = talk.get_view(letter), _fill_slots(talk, head, letter, hold)
    reason = "me-first" if head.order[0] == letter else "other-first"
    clauses = [Clause(head.stance, 0.9)] if head.stance != "propose" else []
    if hold is not None:
        clauses += [Clause("fact"), Clause("fact-time", 0.9)]
    elif "held" in slots and talk.draw.random() < 0.6:
        clauses.append(Clause("other-held"))
    elif view.yields and talk.draw.random() < 0.4:
        clauses.append(Clause("rule"))
    else:
        clauses.append(Clause(reason, 0.4 if head.stance == "accept" else 1.0))
    clauses.append(Clause(ACTION_WORDS[head.action], 0.45))
    more = [Clause("request", 0.25), Clause("seen", 0.3)]
    for some in ([*clauses, *more], clauses, clauses[:2], clauses[:1]):
        words = draw_words(some, slots, talk.draw, talk.is_held_out)
        if words and _fits(talk, replace(head, words=words)):
            return words
    return ""


def _fits(talk: DialogueDraft, proposal: OrderProposal) -> bool:
    """Return whether a message has few enough entries and bytes."""
    sent = HEADER + replace_letters(format_proposal(proposal), dict.fromkeys(proposal.order, STATION))
    entries = len(talk.vocabulary.encode(f" {proposal.words}"))
    return len(sent.encode()) <= MAX_MESSAGE_BYTES and entries <= MAX_WORD_ENTRIES


def _fill_slots(talk: DialogueDraft, head: OrderProposal, letter: str, hold: Hold | None) -> dict[str, str]:
    """Return what can be filled into clauses."""
    view, order = talk.get_view(letter), "".join(head.order)
    place, me = order.index(letter), view.get_member(letter)
    slots: dict[str, str] = {}
    if place:
        slots |= {"first": order[0], "before": order[place - 1]}
    if place + 1 < len(order):
        slots |= {"next": order[place + 1], "last": order[-1]} if order[-1] != letter else {}
    if me.zone_s is not None:
        slots |= {"entry": format_seconds(me.zone_s[0]), "leave": format_seconds(me.zone_s[1])}
    if view.yields:
        second, first = talk.draw.choice(view.yields)
        slots |= {"second": second, "first": first} if order.index(first) < order.index(second) else {}
    if talk.said:
        slots["said"] = talk.said[-1].letter
    if hold is not None:
        article = "an" if hold.name[0] in "aeiou" else "a"
        slots["hold"] = f"{article} {describe_hold(replace(hold, seconds=None))}"
        slots |= {} if hold.seconds is None else {"seconds": format_seconds(hold.seconds)}
    held = [name for name in talk.known_holds if name != letter]
    slots |= {"held": talk.draw.choice(held)} if held else {}
    if view.objects:
        one = talk.draw.choice(view.objects)
        slots |= {"object": one.name, "metres": format_metres(one.distance_m), "sector": one.sector}
    return slots


def is_usable(situation: Situation, split: str) -> bool:
    """Return whether a situation may be in the data of a split."""
    return split != "train" or len(situation.letters) <= MOST_TRAINED_MEMBERS


def leave_out_objects(situation: Situation) -> Situation:
    """Return a situation without the other road users that members see or are told of, for a twin of the model."""
    return replace(situation, views=tuple(replace(view, objects=(), traffic=0) for view in situation.views))


PAIR_MARGIN = 0.05
"""Answers whose simulated scores differ by more are a pair."""


@dataclass(frozen=True, slots=True)
class DialoguePair:
    """Two answers to one request."""

    better: Dialogue
    worse: Dialogue


def compose_pairs(
    situation: Situation, draw: random.Random, vocabulary: DialogueVocabulary, is_held_out: bool
) -> list[DialoguePair]:
    """Return pairs of answers whose orders differ in the simulation: as first message, and as what was agreed."""
    if not situation.find_worse(PAIR_MARGIN):
        return []
    talk = begin_conversation(situation, draw, vocabulary, is_held_out, replace(SHARES, made_up=0.0))
    worse = draw.choice(talk.situation.find_worse(PAIR_MARGIN))
    pairs: list[DialoguePair] = []
    answers: dict[str, Dialogue] = {}
    for order in (talk.base, worse):
        _say(talk, talk.situation.speakers[0], order, is_learned=True)
        answers[order] = talk.dialogues.pop()
        talk.said.pop()
    pairs.append(DialoguePair(answers[talk.base], answers[worse]))
    for letter in talk.situation.speakers:
        _say(talk, letter, draw.choice((talk.base, worse)), is_learned=False)
    _conclude(talk)
    agreed = talk.dialogues.pop()
    view = talk.situation.get_view(talk.situation.speakers[0])
    actions = {letter: choose_action(view, worse, letter, None) for letter in worse}
    other = format_agreement(Agreement(tuple(worse), actions, 0.5))
    return [*pairs, DialoguePair(agreed, replace(agreed, answer=other))]
