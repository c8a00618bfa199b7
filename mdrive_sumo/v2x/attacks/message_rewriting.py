"""Reads what an attacker's agent sent, and writes what its station sends instead."""

from mdrive_sumo.contract import Message
from mdrive_sumo.v2x.content import Cam, Content, Cpm, Denm, Feature, Mcm, MessageError
from mdrive_sumo.v2x.messages import TEXT, TYPES, decode, encode, find_problem


def read_content(message: Message) -> Cam | Cpm | Mcm | Denm | Feature | None:
    """Return the content of a message with a pose; None for all others and for invalid bytes."""
    if message.type not in TYPES or message.type == TEXT or find_problem(message) is not None:
        return None
    content = decode(message)
    assert not isinstance(content, str), "texts have no pose"
    return content


def rewrite(message: Message, content: Content) -> Message:
    """Return a message with that content; the message as it was if none can carry it, as after a tick of 2**32 - 1."""
    try:
        return encode(content)
    except MessageError:
        return message
