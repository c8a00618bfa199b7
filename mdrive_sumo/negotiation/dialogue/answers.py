"""What a member says and what a group agrees on, as text: a head that always has the same form, and words.

Inside a conversation the members are called by letters, in the order of their station ids, so that a message is short
and a model does not have to copy ids.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from mdrive_sumo.v2x.messages import Intention

MAX_MEMBERS = 8
"""A larger group has no letters; more than 5 CAVs have no scenario of the suites in conflict at once."""
LETTERS = "ABCDEFGH"
MAX_MESSAGE_BYTES = 200
"""Of a message with station ids in place of letters; a CAM has about as many with its security header."""
STANCES = ("propose", "accept", "object")
"""What a member says of the order in its message: it is its own, that of an earlier message, or instead of one."""
ACTION_WORDS: Mapping[Intention, str] = {intention: intention.name.lower() for intention in Intention}
CONSENSUS_STEPS = range(0, 101, 10)
"""Percent."""
_ACTIONS: Mapping[str, Intention] = {word: intention for intention, word in ACTION_WORDS.items()}
_PROPOSAL = re.compile(r"(\w+) ([A-H](?:>[A-H])*) (\w+)(?:: ?(.*))?")
_AGREEMENT = re.compile(r"([A-H](?:>[A-H])*)((?: [a-z]+)+) (\d+)")
_LETTER = re.compile(rf"(?<![A-Za-z])[{LETTERS}](?![A-Za-z])")


@dataclass(frozen=True, slots=True)
class OrderProposal:
    """One message of a member, in letters."""

    stance: str
    """One of `STANCES`."""
    order: tuple[str, ...]
    """All members in the order in which they pass."""
    action: Intention
    """What the sender does."""
    words: str = ""
    """Why, what it sees, what it asks for."""


@dataclass(frozen=True, slots=True)
class Agreement:
    """What a group has agreed on, in letters or in station ids."""

    order: tuple[str, ...]
    """All members in the order in which they pass."""
    action_by_member: Mapping[str, Intention]
    consensus: float
    """In [0, 1]."""


def assign_letters(group: Sequence[str]) -> dict[str, str]:
    """Return the letter of each station, the same for all members. Raises ValueError for more than `MAX_MEMBERS`."""
    if len(group) > MAX_MEMBERS:
        raise ValueError(f"expected at most {MAX_MEMBERS} members, found {len(group)}")
    return dict(zip(sorted(group), LETTERS, strict=False))


def format_proposal(proposal: OrderProposal) -> str:
    """Return the text that `parse_proposal` reads."""
    head = f"{proposal.stance} {'>'.join(proposal.order)} {ACTION_WORDS[proposal.action]}"
    return f"{head}: {proposal.words}" if proposal.words else head


def parse_proposal(text: str, letters: str) -> OrderProposal:
    """Return the proposal of a member of the group with these letters. Raises ValueError with what is wrong."""
    match = _PROPOSAL.fullmatch(text)
    if match is None:
        raise ValueError("expected a stance, an order such as B>A and an action")
    stance, order, action, words = match.groups(default="")
    if stance not in STANCES:
        raise ValueError(f"stance: expected one of {', '.join(STANCES)}, found {stance!r:.40}")
    return OrderProposal(stance, _parse_order(order, letters), _parse_action(action), words.strip())


def format_agreement(agreement: Agreement) -> str:
    """Return the text that `parse_agreement` reads; the actions are in the order of passing."""
    actions = " ".join(ACTION_WORDS[agreement.action_by_member[member]] for member in agreement.order)
    return f"{'>'.join(agreement.order)} {actions} {round(10 * agreement.consensus) * 10}"


def parse_agreement(text: str, letters: str) -> Agreement:
    """Return the agreement of the group with these letters. Raises ValueError with what is wrong."""
    match = _AGREEMENT.fullmatch(text)
    if match is None:
        raise ValueError("expected an order such as B>A, an action for each of its members and a consensus")
    order = _parse_order(match[1], letters)
    actions = [_parse_action(word) for word in match[2].split()]
    if len(actions) != len(order):
        raise ValueError(f"actions: expected {len(order)}, found {len(actions)}")
    consensus = int(match[3][:4])
    if consensus not in CONSENSUS_STEPS:
        raise ValueError(f"consensus: expected 0, 10, ... or 100, found {match[3]:.4}")
    return Agreement(order, dict(zip(order, actions, strict=True)), consensus / 100)


def _parse_order(text: str, letters: str) -> tuple[str, ...]:
    order = tuple(text.split(">"))
    if sorted(order) != sorted(letters):
        raise ValueError(f"order: expected each of {', '.join(letters)} once, found {text}")
    return order


def _parse_action(word: str) -> Intention:
    action = _ACTIONS.get(word)
    if action is None:
        raise ValueError(f"action: expected one of {', '.join(_ACTIONS)}, found {word!r:.40}")
    return action


def replace_letters(text: str, station_by_letter: Mapping[str, str]) -> str:
    """Return the text with station ids in place of letters, as it is sent; unknown letters stay."""
    return _LETTER.sub(lambda match: station_by_letter.get(match[0], match[0]), text)


def restore_letters(text: str, letter_by_station: Mapping[str, str]) -> str:
    """Invert `replace_letters`."""
    if not letter_by_station:
        return text
    stations = sorted(letter_by_station, key=lambda station: (-len(station), station))
    pattern = rf"(?<!\w)(?:{'|'.join(map(re.escape, stations))})(?!\w)"
    return re.sub(pattern, lambda match: letter_by_station[match[0]], text)
