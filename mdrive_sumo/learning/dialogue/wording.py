"""How members put it: clauses with alternatives, from which messages are drawn, and patterns that training never sees.

A clause is written `I [let|leave] {first} [go|pass] first`: one of each bracket is drawn, braces are filled in. A
pattern is a message with everything drawn and nothing filled in. Which tenth of the patterns is held out for
validation and test depends on the pattern alone.
"""

import hashlib
import random
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

HELD_OUT = 10
"""One pattern of so many is in no training data."""
MAX_DRAWS = 200
"""Draws until a pattern is one of the wanted kind: of 200 all are of the other kind once in 10^9."""
_SLOT = re.compile(r"{(\w+)}")
_CHOICE = re.compile(r"\[([^\[\]]*)\]")

_AREA = "the [crossing|junction|shared area|common part|meeting point|conflict zone]"
CLAUSES: Mapping[str, tuple[str, ...]] = {
    "other-first": (
        "{first} is [nearest|closest|nearer|closer|the nearest of us|the closest of us]",
        f"{{first}} [enters|reaches|gets to|arrives at|comes to] {_AREA} [first|earliest|before the others|before me]",
        f"{{first}} [will be|is] [at|in] {_AREA} [first|before anyone else|before me|sooner than I am]",
        "{first} [is|comes|drives] ahead [of me|of us|of the others]",
        "{first} [can|could|will] [pass|go|clear it|drive through] [without waiting|without braking|before the rest]",
        "{first} [needs|has|takes] the [least|shortest] [time|way] to [it|the conflict|the crossing|the junction]",
        "[it costs least|we lose least|least time is lost] if {first} [goes|passes|drives] first",
        "{first} [first|goes first], [that is quickest|that is shortest|then all flow|then we all get through]",
    ),
    "me-first": (
        "I am [nearest|closest|nearer|closer|the nearest of us|the closest of us]",
        f"I [enter|reach|get to|arrive at|come to] {_AREA} [first|earliest|before you|in {{entry}} s]",
        f"I [will be|am] [at|in] {_AREA} [first|before you|in {{entry}} s|before the others]",
        "I [can|could|will] [pass|go|clear it|drive through] [without waiting|before you|first|before the rest]",
        "I [am out|have left|am gone|am through] [before you come|when you arrive|in {leave} s|by {leave} s]",
        "[it costs least|we lose least|least time is lost] if I [go|pass|drive] first",
        "my way is [free|clear], [so I go first|I pass first|I take the lead|let me go first]",
    ),
    "rule": (
        "{second} [yields to|gives way to|must wait for|has to wait for] {first} [here|by the rules|by the signs|]",
        "{first} has [the right of way|priority|precedence] [here|over {second}|by the rules|by the signs]",
        "[the rules|the signs|priority] [put|say|let] {first} [first|go first|ahead of {second}|before {second}]",
    ),
    "fact": (
        "{hold} [holds me up|stops me|blocks me|is in my way|keeps me|makes me wait]",
        "I am [held up|stopped|blocked|kept|delayed] by {hold}",
        "I [must|have to|need to|will] [wait for|brake for|stop for|yield to] {hold}",
        "I [cannot|can not|will not] [go|pass|drive|move on] [yet|now], [there is|I have|I see] {hold}",
        "[wait|careful|note|mind], [there is|I have|I see] {hold} [before me|on my way|in front of me]",
    ),
    "fact-time": (
        "[for|about|some] {seconds} s",
        "[I need|it takes|that takes|give me] {seconds} s",
        "[free|on my way|ready|moving] [again |]in {seconds} s",
    ),
    "other-held": (
        "{held} is [held up|stopped|blocked|delayed|not free]",
        "{held} [must|has to] wait [anyway|for now|there]",
        "{held} [cannot|can not] [go|pass|move] [yet|now]",
        "[as|since|because] {held} [waits|stands|is held up], [the others go|we go first|it goes last]",
    ),
    "keep": (
        "I [keep|hold|stay at] my [speed|pace]",
        "I [drive on|go on|carry on|just go on|continue]",
        "I [do not slow down|keep going|stay as I am|go through as I am]",
    ),
    "faster": (
        "I [speed up|go faster|accelerate|hurry|pick up speed]",
        "I [clear it|get through|move off] [quickly|at once|now]",
        "I [start|set off|pull away] [now|at once|right away]",
    ),
    "slower": (
        "I [slow down|ease off|brake a little|reduce my speed|go slower|lift off]",
        "I [pass|go|drive] [behind|after] {before}",
        "I [let|leave] {before} [go|pass|through] [first|before me]",
        "I [leave|make|give] {before} [room|space|a gap]",
    ),
    "stop": (
        "I [stop|halt|wait|stand] [until {before} has passed|for {before}|before the line|till {before} is through]",
        "I [will wait|wait] [here|at the line|in front of it] [for {before}|until it is free|]",
        "I [stay|remain] [where I am|behind the line|here] [until {before} is gone|for now|]",
    ),
    "request": (
        "[please |]{next} [after me|behind me|follow me|pass after me]",
        "{next}, [please |][slow down|wait|let me through|leave me room|yield to me]",
        "{last} [last|goes last|at the end|comes last], please",
        "[please |][keep to that|hold that order|all agree|say so if not|confirm]",
        "{first}, [please |][go|go ahead|pass|keep your speed|do not brake]",
    ),
    "accept": (
        "[agreed|yes|fine|good|all right|right|ok|understood|as you say|so be it]",
        "[I agree|I accept|that suits me|fine with me|good for me|I am in|I do so]",
        "[same for me|I see it so|that is my view|I think so too|no objection|nothing against it]",
        "[yes|fine|good|agreed], {said} [is right|says it well|has it right|sees it right]",
    ),
    "object": (
        "[no|not so|better not|wait|sorry|careful]",
        "[I disagree|I object|I see it otherwise|that does not work|that is not safe|that costs too much]",
        "[no|sorry|wait], {said} [is wrong|has it wrong|cannot know|does not see it]",
        "[not {said}'s order|another order|other way round], please",
    ),
    "seen": (
        "I see [a|one] {object} {metres} m {sector}",
        "[there is|I have|I know of|I track] [a|one] {object} {metres} m {sector} of me",
        "[mind|watch|note] [a|the] {object} {metres} m {sector} of me",
    ),
}  # fmt: skip
_JOINTS = (", ", ", ", "; ", ". ", ", and ")


@dataclass(frozen=True, slots=True)
class Clause:
    """One clause of a message."""

    kind: str
    """Key of `CLAUSES`."""
    share: float = 1.0
    """How often it is said."""


def draw_words(
    clauses: Sequence[Clause], slots: Mapping[str, str], draw: random.Random, is_held_out: bool = False
) -> str:
    """Return a message of some of the clauses; those that need a slot that is not there are left out.

    is_held_out: draw the patterns that training never sees, instead of the others. "" if no clause can be said.
    """
    for _ in range(MAX_DRAWS):
        pattern = draw_pattern(clauses, slots, draw)
        if is_pattern_held_out(pattern) == is_held_out:
            return pattern.format(**slots)
    return ""


def draw_pattern(clauses: Sequence[Clause], slots: Mapping[str, str], draw: random.Random) -> str:
    """Return a pattern of some of the clauses; "" if none of them can be said."""
    parts: list[str] = []
    for clause in clauses:
        usable = [one for one in CLAUSES[clause.kind] if get_slots(one) <= set(slots)]
        if usable and draw.random() < clause.share:
            parts.append(_CHOICE.sub(lambda match: draw.choice(match[1].split("|")), draw.choice(usable)).strip())
    text = ""
    for part in parts:
        text += (draw.choice(_JOINTS) if text else "") + part
    return text


def get_slots(clause: str) -> set[str]:
    """Return the names in braces."""
    return set(_SLOT.findall(clause))


def is_pattern_held_out(pattern: str) -> bool:
    """Return whether a pattern is in no training data."""
    return hashlib.blake2b(pattern.encode(), digest_size=4).digest()[0] % HELD_OUT == 0


def count_patterns(kind: str) -> int:
    """Return how many patterns one kind of clause has."""
    total = 0
    for clause in CLAUSES[kind]:
        number = 1
        for match in _CHOICE.finditer(clause):
            number *= len(match[1].split("|"))
        total += number
    return total


def list_words() -> list[str]:
    """Return all alternatives of all clauses, each as a text."""
    texts = [text for clauses in CLAUSES.values() for clause in clauses for text in re.split(r"[\[\]|]", clause)]
    return [" " + _SLOT.sub("", text).strip() for text in texts]
