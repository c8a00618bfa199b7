"""Made-up dialogues with a rule that can be learned from little: for tests, the smoke test and speed measurements.

Nothing here is simulated: times are drawn, and the first to enter the shared area passes first. The form of prompts
is that of driving, so their lengths are too.
"""

import random

from mdrive_sumo.core.seeding import derive_seed
from mdrive_sumo.learning.dialogue.dialogue_samples import Dialogue, DialoguePairs, DialogueSamples, encode_dialogues
from mdrive_sumo.negotiation.dialogue.answers import (
    LETTERS,
    Agreement,
    OrderProposal,
    format_agreement,
    format_proposal,
)
from mdrive_sumo.negotiation.dialogue.vocabulary import AGREE, SAY, DialogueVocabulary
from mdrive_sumo.v2x.messages import Intention

_WAYS = ("straight", "turns left", "turns right", "changes left", "changes right")
_SECTORS = ("ahead", "ahead left", "left", "behind left", "behind", "behind right", "right", "ahead right")
_HEADINGS = ("same direction", "from right to left", "towards", "from left to right")
_OBJECTS = ("car", "pedestrian", "cyclist", "parked car", "lorry")
_REASONS = (
    "{first} is nearest, I pass behind", "I let {first} go first", "{first} enters first, the others wait",
    "I see no reason to change that", "I slow down so that {first} can pass", "the way is free for {first}",
)  # fmt: skip


def draw_dialogue(seed: int, index: int, split: str = "train", most_members: int = 4) -> Dialogue:
    """Return a made-up dialogue; half of them are requests to say what was agreed."""
    draw = random.Random(derive_seed(seed, "synthetic-dialogue", split, str(index)))
    letters = LETTERS[: draw.randint(2, most_members)]
    times = dict(zip(letters, draw.sample(range(5, 60), len(letters)), strict=True))
    order = tuple(sorted(letters, key=lambda letter: times[letter]))
    action_by_member = {letter: Intention.KEEP if letter == order[0] else Intention.SLOWER for letter in letters}
    task, me = draw.choice((SAY, AGREE)), draw.choice(letters)
    lines = ["rules lights none", *(_describe_member(draw, letter, times[letter], letter == me) for letter in letters)]
    lines += [_describe_object(draw, letters) for _ in range(draw.randint(0, 4))]
    lines.append(f"traffic {draw.randint(0, 84)}")
    words = draw.choice(_REASONS).format(first=order[0])
    proposal = format_proposal(OrderProposal("propose", order, action_by_member[me], words))
    if task == SAY:
        answer = proposal
    else:
        lines += [f"said {letter} accept {'>'.join(order)} keep" for letter in letters[:2]]
        answer = format_agreement(Agreement(order, action_by_member, 0.9))
    return Dialogue(task, tuple(lines), letters, me, answer, f"made-up-{split}-{index % 7}")


def _describe_member(draw: random.Random, letter: str, entry_ds: int, is_me: bool) -> str:
    entry = f"zone {entry_ds // 10}.{entry_ds % 10} to {entry_ds // 10 + 2}.{entry_ds % 10} s"
    speed = f"{draw.randint(1, 9)}.{draw.choice((0, 5))} m/s keep"
    if is_me:
        return f"me {letter} {draw.choice(_WAYS)} {speed}, {entry}"
    place = f"{draw.randint(3, 60)} m {draw.choice(_SECTORS)}, {draw.choice(_HEADINGS)}"
    return f"{letter} {draw.choice(_WAYS)} {speed}, {place}, {entry}, conflict"


def _describe_object(draw: random.Random, letters: str) -> str:
    what = f"{draw.choice(_OBJECTS)} {draw.randint(3, 60)} m {draw.choice(_SECTORS)} {draw.randint(0, 9)}.0 m/s"
    return f"own {what}" if draw.random() < 0.5 else f"{draw.choice(letters)} says {what} sigma 1 m"


def build_synthetic_dialogues(
    vocabulary: DialogueVocabulary, count: int, seed: int, split: str = "train", most_members: int = 4
) -> DialogueSamples:
    """Return made-up dialogues as arrays."""
    return encode_dialogues(vocabulary, [draw_dialogue(seed, i, split, most_members) for i in range(count)])


def build_synthetic_pairs(vocabulary: DialogueVocabulary, count: int, seed: int) -> DialoguePairs:
    """Return pairs whose worse answers have the order of passing reversed."""
    better = [draw_dialogue(seed, i) for i in range(count)]
    worse = [_reverse_order(dialogue) for dialogue in better]
    return DialoguePairs(encode_dialogues(vocabulary, better), encode_dialogues(vocabulary, worse))


def _reverse_order(dialogue: Dialogue) -> Dialogue:
    words = dialogue.answer.split(" ")
    place = 1 if dialogue.task == SAY else 0
    words[place] = ">".join(reversed(words[place].split(">")))
    return Dialogue(dialogue.task, dialogue.lines, dialogue.letters, dialogue.me, " ".join(words), dialogue.place)
