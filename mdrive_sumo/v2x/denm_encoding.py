"""Bytes of DENM; decoding has two steps as in `encoding`."""

import struct

import numpy as np

from mdrive_sumo.v2x.content import Denm, EventCause, MessageError, ReferencePose, Termination
from mdrive_sumo.v2x.encoding import LAST_TICK, decode_points, encode_points, round_and_clamp

_DENM = struct.Struct("<HIBBB4sHhHH")
"""Sequence, detection tick, cause, sub cause, termination, place, validity [0.1 s], speed, length, width [cm, cm/s]."""
_CENTI = 100.0
_DECI = 10.0
LAST_SEQUENCE = 2**16 - 1

DenmParts = tuple[int, int, int, int, int, bytes, int, int, int, int]
"""The fields of a DENM body."""


def encode_denm(denm: Denm, pose: ReferencePose) -> bytes:
    """Return the body of a DENM, without header; `pose` is the rounded pose that the receiver reads."""
    if not 0 <= denm.sequence <= LAST_SEQUENCE:
        raise MessageError(f"expected a sequence from 0 to {LAST_SEQUENCE}, found {denm.sequence}")
    if not 0 <= denm.detection_tick <= LAST_TICK:
        raise MessageError(f"expected a detection_tick from 0 to {LAST_TICK}, found {denm.detection_tick}")
    if not 0 <= denm.sub_cause <= 255:
        raise MessageError(f"expected a sub_cause from 0 to 255, found {denm.sub_cause}")
    return _DENM.pack(
        denm.sequence,
        denm.detection_tick,
        EventCause(denm.cause),
        denm.sub_cause,
        Termination(denm.termination),
        encode_points(pose, np.array(((denm.x, denm.y),))),
        max(round_and_clamp(denm.validity_s * _DECI, 16), 0),
        round_and_clamp(denm.speed * _CENTI, 15),
        max(round_and_clamp(denm.length * _CENTI, 16), 0),
        max(round_and_clamp(denm.width * _CENTI, 16), 0),
    )


def parse_denm(body: bytes) -> DenmParts:
    """Return the fields of a DENM body. Raises MessageError."""
    if len(body) != _DENM.size:
        raise MessageError(f"expected {_DENM.size} bytes after the header, found {len(body)}")
    parts: DenmParts = _DENM.unpack(body)
    if parts[2] not in list(EventCause):
        known = ", ".join(str(int(cause)) for cause in EventCause)
        raise MessageError(f"expected a cause of {known}, found {parts[2]}")
    if parts[4] not in list(Termination):
        raise MessageError(f"expected a termination from 0 to {max(Termination)}, found {parts[4]}")
    return parts


def build_denm(pose: ReferencePose, parts: DenmParts) -> Denm:
    """Return the DENM of these fields."""
    sequence, detection_tick, cause, sub_cause, termination, place, validity, speed, length, width = parts
    x, y = decode_points(pose, place)[0].tolist()
    return Denm(
        pose=pose,
        sequence=sequence,
        cause=EventCause(cause),
        sub_cause=sub_cause,
        x=x,
        y=y,
        detection_tick=detection_tick,
        validity_s=validity / _DECI,
        speed=speed / _CENTI,
        length=length / _CENTI,
        width=width / _CENTI,
        termination=Termination(termination),
    )
