"""Prompts of the language model, and the parsing of its answers. Recorded transcripts depend on every word."""

import json
import math
from collections.abc import Mapping, Sequence

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import wrap_angle
from mdrive_sumo.negotiation.negotiator import NegotiationMember
from mdrive_sumo.v2x.messages import Direction, Intention

Chat = list[dict[str, str]]

MAX_TEXT_BYTES = 1024
"""Of one utterance with its header; the channel would carry 8192."""
MESSAGE_TOKENS, ACTION_TOKENS = 256, 256
"""Longest answers that are asked for: about 1000 characters."""

ACTIONS = {intention.name: intention for intention in Intention}
_DIRECTION_TEXTS = {
    Direction.FOLLOW: "follows its lane",
    Direction.LEFT: "turns left",
    Direction.RIGHT: "turns right",
    Direction.STRAIGHT: "goes straight on at the junction",
    Direction.CHANGE_LEFT: "changes to the lane on the left",
    Direction.CHANGE_RIGHT: "changes to the lane on the right",
}
SECTORS = ("ahead", "ahead left", "left", "behind left", "behind", "behind right", "right", "ahead right")
HEADINGS = {
    "same direction": "in the same direction",
    "from right to left": "from right to left",
    "towards": "towards you",
    "from left to right": "from left to right",
}
"""Four directions of motion by their short names, counter-clockwise."""

_RULES = """Traffic rules:
- Who merges or changes lane gives way to who goes straight on.
- Who turns left gives way to who goes straight on or turns right.
- Who is given way to goes faster, so that both lose little time.
- In an emergency the cars behind slow down for those in front.
- Somebody must go: if all stop nothing is gained."""

_SPEAKER_PROMPT = (
    "You drive one of several connected cars whose planned ways come dangerously close to each other. Agree with the"
    " others by short messages who goes first and who gives way. Every car can STOP, go SLOWER, KEEP its speed or go"
    f" FASTER.\n{_RULES}\nAnswer with nothing but your message to the others: one to three sentences, in which you name"
    " cars by their ids and say what you will do and what you ask of them."
)
_ACTION_PROMPT = (
    "Several connected cars have negotiated who goes first. Read their messages and say which action every car takes:"
    f" STOP, SLOWER, KEEP or FASTER.\n{_RULES}\nAnswer with nothing but one JSON object that has every car's id as key"
    ' and its action as value. You may add the key "consensus" with a number from 0 (they disagree) to 100 (they all'
    " agree)."
)


def build_speaker_chat(
    me: NegotiationMember, others: Sequence[NegotiationMember], said: Sequence[tuple[str, str]], feedback: str
) -> Chat:
    """Return the request for the next message of `me`; said: (id, text) so far, oldest first."""
    lines = [
        f"You are car {me.id}: {me.speed:.1f} m/s, your car {_DIRECTION_TEXTS[me.direction]}"
        f" and means to {me.intention.name}.",
        "The others:",
        *(f"- {_describe_car(me, other)}" for other in others),
        *_format_utterances(said),
    ]
    if feedback:
        lines.append(f"What an observer says of the agreement so far: {feedback}")
    return _build_chat(_SPEAKER_PROMPT, lines)


def build_action_chat(members: Sequence[NegotiationMember], said: Sequence[tuple[str, str]]) -> Chat:
    """Return the request for the actions that follow from the last utterances."""
    cars = [
        f"- car {m.id}: {m.speed:.1f} m/s, {_DIRECTION_TEXTS[m.direction]}, means to {m.intention.name}"
        for m in members
    ]
    return _build_chat(_ACTION_PROMPT, ["The cars:", *cars, *_format_utterances(said)])


def _build_chat(system: str, lines: Sequence[str]) -> Chat:
    return [{"role": "system", "content": system}, {"role": "user", "content": "\n".join(lines)}]


def _format_utterances(said: Sequence[tuple[str, str]]) -> list[str]:
    if not said:
        return ["Nobody has said anything yet."]
    return ["Said so far:", *(f"{name}: {text}" for name, text in said)]


def _describe_car(me: NegotiationMember, other: NegotiationMember) -> str:
    """Return a description of another car relative to the own one."""
    distance = portable.hypot(other.x - me.x, other.y - me.y)
    sector, heading = find_sector(me, other.x, other.y), HEADINGS[find_heading(me, other.yaw)]
    return (
        f"car {other.id}: {distance:.1f} m {sector}, moving {heading}, {other.speed:.1f} m/s,"
        f" {_DIRECTION_TEXTS[other.direction]}, means to {other.intention.name}"
    )


def find_sector(me: NegotiationMember, x: float, y: float) -> str:
    """Return where a point [m] is, seen from a car: one of eight sectors."""
    bearing = wrap_angle(portable.atan2(y - me.y, x - me.x) - me.yaw)
    return SECTORS[round(bearing / (math.pi / 4)) % 8]


def find_heading(me: NegotiationMember, yaw: float) -> str:
    """Return the direction of motion of another car with that heading [rad], seen from a car: a key of `HEADINGS`."""
    return tuple(HEADINGS)[round(wrap_angle(yaw - me.yaw) / (math.pi / 2)) % 4]


def clean_message(text: str) -> str:
    """Return a message as one line of valid UTF-8 of limited length. Raises ValueError if nothing is left."""
    line = " ".join(text.split())
    line = line.encode("utf-8", "replace")[: MAX_TEXT_BYTES - 64].decode("utf-8", "ignore")
    if not line:
        raise ValueError("the message is empty")
    return line


def parse_actions(text: str, group: Sequence[str]) -> tuple[dict[str, Intention], float | None]:
    """Return the action by id and the consensus in [0, 1] (if stated); raise ValueError with the defect."""
    start, end = text.find("{"), text.rfind("}")
    if start < 0 or end < start:
        raise ValueError("there is no JSON object in it")
    try:
        found = json.loads(text[start : end + 1])
    except RecursionError:
        raise ValueError("it is nested too deeply") from None
    if not isinstance(found, dict):
        raise ValueError("there is no JSON object in it")
    content: Mapping[str, object] = found
    agreed = None if "consensus" in group else content.get("consensus")
    keys = set(content) - ({"consensus"} - set(group))
    if keys != set(group):
        raise ValueError(f"expected exactly the ids {', '.join(group)}")
    actions = {name: _parse_action(name, content[name]) for name in group}
    if isinstance(agreed, int | float) and not isinstance(agreed, bool) and 0 <= agreed <= 100:
        return actions, agreed / 100
    return actions, None


def _parse_action(name: str, value: object) -> Intention:
    action = ACTIONS.get(value.strip().upper()) if isinstance(value, str) else None
    if action is None:
        raise ValueError(f"car {name}: expected one of {', '.join(ACTIONS)}")
    return action
