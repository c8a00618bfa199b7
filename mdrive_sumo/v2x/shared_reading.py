"""Messages decoded once for all receivers in a process.

A message reaches many CAVs with the same bytes, and its content depends on nothing else. So the functions of
`v2x.messages` are cached here by type and payload; the arrays of the results are read-only, because receivers share
them. The caches forget what has not been used for long; no result depends on them.
"""

from functools import lru_cache

from mdrive_sumo.contract import Message
from mdrive_sumo.core.frozen import build_frozen
from mdrive_sumo.core.state import MOTION_AND_SIZE
from mdrive_sumo.v2x import messages
from mdrive_sumo.v2x.content import Cam, Content, Cpm, Feature, Mcm

CACHED_PAYLOADS = 1024
"""Two seconds of 12 CAVs at the most: each sends 10 CAMs and CPMs and 5 MCMs a second."""


def find_shared_problem(message: Message) -> str | None:
    """Return what `messages.find_problem` returns."""
    return _find_problem(message.type, message.payload)


def decode_shared(message: Message) -> Content:
    """Return what `messages.decode` returns, with read-only arrays. Raises MessageError."""
    problem = _find_problem(message.type, message.payload)
    if problem is not None or message.type not in messages.TYPES:
        return messages.decode(message)  # which raises the error
    return decode_payload(message.type, message.payload)


@lru_cache(maxsize=CACHED_PAYLOADS)
def _find_problem(type_: str, payload: bytes) -> str | None:
    return messages.find_problem(build_frozen(Message, type_, payload, "", 0))


@lru_cache(maxsize=CACHED_PAYLOADS)
def decode_payload(type_: str, payload: bytes) -> Content:
    """Return the content of a payload, with read-only arrays. Raises MessageError."""
    content = messages.decode(build_frozen(Message, type_, payload, "", 0))
    if isinstance(content, Cpm):
        objects = content.objects
        columns = [getattr(objects, name) for name in ("kind", *MOTION_AND_SIZE, "free_m")]
        for array in (*columns, content.age, content.sigmas):
            array.setflags(write=False)
    elif isinstance(content, Mcm):
        for points in (content.planned, content.desired):
            points.setflags(write=False)
    elif isinstance(content, Cam) and content.path_history is not None:
        content.path_history.setflags(write=False)
    elif isinstance(content, Feature):
        for array in (content.steps, content.tiles, content.confidence, content.places, content.levels):
            array.setflags(write=False)
    return content
