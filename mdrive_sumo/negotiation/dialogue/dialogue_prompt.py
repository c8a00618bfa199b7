"""The prompt of the negotiator's network: what a member knows and what was said, as lines of text.

Numbers are rounded: speeds to 0.5 m/s, distances to 1 m, times to 0.1 s. A prompt that is too long loses its least
important lines first, never a member, the rules or the heads of the last round.
"""

from collections.abc import Callable
from dataclasses import dataclass

from mdrive_sumo.negotiation.dialogue.answer_grammar import MAX_ANSWER_ENTRIES
from mdrive_sumo.negotiation.dialogue.answers import ACTION_WORDS
from mdrive_sumo.negotiation.dialogue.decoder_shape import NEGOTIATOR
from mdrive_sumo.negotiation.dialogue.dialogue_view import STANDING_SPEED, DialogueView, Hold, MemberView, ToldObject
from mdrive_sumo.negotiation.dialogue.vocabulary import SAY, DialogueVocabulary
from mdrive_sumo.v2x.messages import Direction

MAX_PROMPT_ENTRIES = NEGOTIATOR.context - MAX_ANSWER_ENTRIES
WAYS = {
    Direction.FOLLOW: "straight",
    Direction.STRAIGHT: "straight",
    Direction.LEFT: "turns left",
    Direction.RIGHT: "turns right",
    Direction.CHANGE_LEFT: "changes left",
    Direction.CHANGE_RIGHT: "changes right",
}
TELLING_SIGMA_M = 0.5
"""Smaller standard deviations of positions are not told."""
FASTER_FEEDBACK = "faster"
"""Feedback of the critic if all are too slow."""


@dataclass(frozen=True, slots=True)
class SaidLine:
    """A message of a conversation, in letters."""

    round: int
    """From 1."""
    letter: str
    text: str


@dataclass(frozen=True, slots=True)
class Talk:
    """What has happened in a conversation so far."""

    said: tuple[SaidLine, ...] = ()
    """Oldest first."""
    feedback: str = ""
    """`format_close_pair` or `FASTER_FEEDBACK`; "" in the first round."""
    round: int = 1


def format_close_pair(first: str, second: str) -> str:
    """Return the feedback that two members, by letter, would come too close."""
    return f"{first} and {second} too close"


def format_prompt(task: int, view: DialogueView, talk: Talk, vocabulary: DialogueVocabulary) -> list[str]:
    """Return the lines of a prompt of at most `MAX_PROMPT_ENTRIES` entries.

    task: SAY: the viewer's next message. AGREE: what was agreed in this round, by its messages alone: without what only
    the viewer knows.
    """
    lines = _Lines(task, view, talk)
    for cut in lines.list_cuts():
        if len(vocabulary.encode_prompt(task, lines.build())) <= MAX_PROMPT_ENTRIES:
            break
        cut()
    return lines.build()


_Cut = Callable[[], object]
"""A step that shortens a prompt; its result means nothing."""


class _Lines:
    """The parts of a prompt, which become fewer."""

    def __init__(self, task: int, view: DialogueView, talk: Talk) -> None:
        is_speaker = task == SAY
        self._view, self._talk, self._is_speaker = view, talk, is_speaker
        self._traffic = is_speaker
        self._own = [one for one in view.objects if not one.source and is_speaker]
        self._shared = [one for one in view.objects if one.source and is_speaker]
        self._earlier = [line for line in talk.said if line.round < talk.round and is_speaker]
        self._last = [line for line in talk.said if line.round == talk.round]
        self._bare: set[str] = set()
        """Members whose details are left out."""

    def list_cuts(self) -> list[_Cut]:
        """Return the steps that shorten it, the first ones first; each may do nothing."""
        far = sorted((one for one in self._view.members if one.sector), key=lambda one: -one.distance_m)
        cuts: list[_Cut] = [lambda: setattr(self, "_traffic", False)]
        cuts += [lambda: self._shared and self._shared.pop()] * len(self._shared)
        cuts += [lambda: self._own and self._own.pop()] * len(self._own)
        cuts += [lambda: self._earlier and self._earlier.pop(0)] * len(self._earlier)
        cuts += [lambda name=one.letter: self._bare.add(name) for one in far]
        cuts += [lambda row=row: self._drop_words(row) for row in range(len(self._last))]
        return [*cuts, lambda: None]

    def _drop_words(self, row: int) -> None:
        line = self._last[row]
        self._last[row] = SaidLine(line.round, line.letter, line.text.split(":", 1)[0])

    def build(self) -> list[str]:
        """Return the lines."""
        view, talk = self._view, self._talk
        rules = [f"lights {view.light or 'none'}", *(f"{first} yields to {second}" for first, second in view.yields)]
        lines = [f"rules {', '.join(rules)}"]
        if self._is_speaker:
            lines.append(_describe_me(view))
        others = [one for one in view.members if one.sector or not self._is_speaker]
        lines += [_describe_member(one, one.letter in self._bare) for one in others]
        lines += [_describe_object(one) for one in (*self._own, *self._shared)]
        lines += [f"traffic {view.traffic}"] if self._traffic else []
        lines += [f"said {line.letter} {line.text}" for line in (*self._earlier, *self._last)]
        if talk.feedback and self._is_speaker:
            lines.append(f"critic {talk.feedback}")
        return [*lines, f"round {talk.round}"] if talk.round > 1 else lines


def _describe_me(view: DialogueView) -> str:
    me = view.get_member(view.me)
    hold = "" if view.hold is None else f", held by {describe_hold(view.hold)}"
    return f"me {_describe_motion(me)}{_describe_zone(me)}{hold}{_describe_leader(me)}"


def describe_hold(hold: Hold) -> str:
    """Return what holds a member up, as prompts and messages call it."""
    where = "" if hold.distance_m is None else f" {format_metres(hold.distance_m)} m ahead"
    return f"{hold.name}{where}{'' if hold.seconds is None else f' for {format_seconds(hold.seconds)} s'}"


def _describe_member(one: MemberView, is_bare: bool) -> str:
    if is_bare:
        return _describe_motion(one)
    place = f", {format_metres(one.distance_m)} m {one.sector}, {one.heading}" if one.sector else ""
    conflict = ", conflict" if one.in_conflict else ""
    sigma = f", sigma {format_metres(one.sigma_m)} m" if one.sigma_m >= TELLING_SIGMA_M else ""
    return f"{_describe_motion(one)}{place}{_describe_zone(one)}{conflict}{_describe_leader(one)}{sigma}"


def _describe_motion(one: MemberView) -> str:
    return f"{one.letter} {WAYS[one.direction]} {_format_speed(one.speed)} m/s {ACTION_WORDS[one.action]}"


def _describe_zone(one: MemberView) -> str:
    if one.zone_s is None:
        return ""
    return f", zone {format_seconds(one.zone_s[0])} to {format_seconds(one.zone_s[1])} s"


def _describe_leader(one: MemberView) -> str:
    return f", follows {one.follows}" if one.follows else ""


def _describe_object(one: ToldObject) -> str:
    source = f"{one.source} says" if one.source else "own"
    speed = "standing" if one.speed < STANDING_SPEED else f"{_format_speed(one.speed)} m/s"
    sigma = f" sigma {format_metres(one.sigma_m)} m" if one.sigma_m >= TELLING_SIGMA_M else ""
    return f"{source} {one.name} {format_metres(one.distance_m)} m {one.sector} {speed}{sigma}"


def _format_speed(speed: float) -> str:
    return f"{max(round(2 * speed), 0) / 2:.1f}"


def format_metres(metres: float) -> str:
    """Return a distance [m] as prompts have it."""
    return str(min(max(round(metres), 0), 999))


def format_seconds(seconds: float) -> str:
    """Return a time [s] as prompts have it."""
    return f"{min(max(seconds, 0.0), 99.9):.1f}"
