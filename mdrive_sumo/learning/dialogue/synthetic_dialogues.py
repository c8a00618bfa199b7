"""Made-up situations and dialogues about them: for tests, the smoke test, the vocabulary and speed measurements.

Nothing here is simulated: times are drawn, and the first to enter the shared area passes first. Form, words and
lengths are those of dialogues of real situations, for they are made in the same way.
"""

import random
from dataclasses import replace

from mdrive_sumo.core.seeding import derive_seed
from mdrive_sumo.learning.dialogue.compose_dialogues import HOLDS, SHARES, compose_conversation
from mdrive_sumo.learning.dialogue.dialogue_samples import Dialogue, DialoguePairs, DialogueSamples, encode_dialogues
from mdrive_sumo.learning.dialogue.situations import Situation
from mdrive_sumo.negotiation.dialogue.answers import LETTERS
from mdrive_sumo.negotiation.dialogue.dialogue_view import DialogueView, Hold, MemberView, ToldObject
from mdrive_sumo.negotiation.dialogue.vocabulary import SAY, DialogueVocabulary
from mdrive_sumo.negotiation.prompt import HEADINGS, SECTORS
from mdrive_sumo.v2x.messages import Direction, Intention

_OBJECTS = ("car", "pedestrian", "cyclist", "lorry", "obstacle")
PLACES = 7
"""Made-up places of a split."""


def draw_situation(draw: random.Random, place: str, members: int) -> Situation:
    """Return a made-up situation."""
    letters = LETTERS[:members]
    entries = dict(zip(letters, draw.sample(range(5, 60), members), strict=True))
    order = "".join(sorted(letters, key=lambda letter: entries[letter]))
    seen = [_draw_member(draw, letter, entries[letter]) for letter in letters]
    views = tuple(_draw_view(draw, letter, seen) for letter in letters)
    speakers = "".join(draw.sample(letters, members))
    return Situation(place, place, draw.randrange(2000), speakers, views, {"passing": order, "rule": order})


def _draw_member(draw: random.Random, letter: str, entry_ds: int) -> MemberView:
    return MemberView(
        letter,
        direction=draw.choice(list(Direction)),
        speed=draw.randint(0, 28) / 2,
        action=draw.choice(list(Intention)),
        zone_s=(entry_ds / 10, entry_ds / 10 + draw.choice((1.2, 2.0))),
        in_conflict=True,
    )


def _draw_view(draw: random.Random, me: str, seen: list[MemberView]) -> DialogueView:
    def look(one: MemberView) -> MemberView:
        if one.letter == me:
            return one
        sigma = draw.choice((0.0, 0.0, 1.0))
        sector, heading = draw.choice(SECTORS), draw.choice(tuple(HEADINGS))
        return replace(one, distance_m=draw.randint(3, 90), sector=sector, heading=heading, sigma_m=sigma)

    other = draw.choice([one.letter for one in seen if one.letter != me])
    hold = Hold(draw.choice((*HOLDS, "stop sign", "slow traffic", "oncoming car")), draw.randint(2, 60))
    objects = [_draw_object(draw, draw.choice(("", "", other, "other"))) for _ in range(draw.randint(0, 6))]
    return DialogueView(
        me,
        tuple(look(one) for one in seen),
        yields=draw.choice(((), ((me, other),), ((other, me),))),
        light=draw.choice(("", "", "green", "yellow", "red")),
        hold=hold if draw.random() < 0.2 else None,
        objects=tuple(sorted(objects, key=lambda one: bool(one.source))),
        traffic=draw.randint(0, 84),
    )


def _draw_object(draw: random.Random, source: str) -> ToldObject:
    sigma = draw.choice((0.0, 1.0, 2.0)) if source else 0.0
    name, sector = draw.choice(_OBJECTS), draw.choice(SECTORS)
    return ToldObject(source, name, draw.randint(3, 60), sector, draw.randint(0, 28) / 2, sigma)


def draw_dialogue(
    vocabulary: DialogueVocabulary, seed: int, index: int, split: str = "train", most_members: int = 4
) -> Dialogue:
    """Return a request of a conversation about a made-up situation."""
    draw = random.Random(derive_seed(seed, "synthetic-dialogue", split, str(index)))
    situation = draw_situation(draw, f"made-up-{split}-{index % PLACES}", draw.randint(2, most_members))
    return draw.choice(compose_conversation(situation, draw, vocabulary, split != "train", SHARES))


def build_synthetic_dialogues(
    vocabulary: DialogueVocabulary, count: int, seed: int, split: str = "train", most_members: int = 4
) -> DialogueSamples:
    """Return made-up dialogues as arrays."""
    dialogues = [draw_dialogue(vocabulary, seed, i, split, most_members) for i in range(count)]
    return encode_dialogues(vocabulary, dialogues)


def build_synthetic_pairs(vocabulary: DialogueVocabulary, count: int, seed: int) -> DialoguePairs:
    """Return pairs whose worse answers have the order of passing reversed."""
    better = [draw_dialogue(vocabulary, seed, i) for i in range(count)]
    worse = [_reverse_order(dialogue) for dialogue in better]
    return DialoguePairs(encode_dialogues(vocabulary, better), encode_dialogues(vocabulary, worse))


def _reverse_order(dialogue: Dialogue) -> Dialogue:
    words = dialogue.answer.split(" ")
    place = 1 if dialogue.task == SAY else 0
    words[place] = ">".join(reversed(words[place].split(">")))
    return replace(dialogue, answer=" ".join(words))
