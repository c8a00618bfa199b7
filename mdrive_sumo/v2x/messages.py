"""CAM, CPM, MCM, DENM, features and text: the messages of V2X stations and their encoding.

The meaning follows ETSI: CAM (EN 302 637-2) has the sender's own state, CPM (TS 103 324) its detections and free sight,
MCM (TS 103 561) its plan, desired trajectory, requests and answers, DENM (EN 302 637-3) an event. The bytes are our
own, not ASN.1: little-endian, positions in steps of 1 cm, angles of 0.01 degrees, speeds of 1 cm/s. As in ETSI's
messages everything is relative to the sender's reference pose, which alone is in the world frame: an error of the
sender's pose shifts and rotates the whole content. Arguments and results here are in the world frame, SI units, box
centres.

Poses are the sender's estimates; they and detections carry standard deviations, as ETSI's confidences.

Features (no standard has them) are tiles of a bird's-eye map that a network made of the sender's sensors.

Sizes: header 18 bytes; CAM + 11, with its low-frequency container + 1 + 4 a point; CPM + 5 + 21 an object + 1 a sector
of free sight; MCM + 14 + 4 a point + (2 + its UTF-8 bytes) a name; DENM + 21. docs/v2x.md has the tables.
"""

import struct
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

from mdrive_sumo.contract import Message
from mdrive_sumo.core.frozen import build_frozen
from mdrive_sumo.v2x import denm_encoding, encoding, feature_encoding, mcm_encoding
from mdrive_sumo.v2x.content import (
    CAM,
    CPM,
    DENM,
    FEATURE,
    FLOOD,
    MAX_NAME_BYTES,
    MAX_NAMES,
    MAX_OBJECTS,
    MAX_PAYLOAD_BYTES,
    MAX_POINTS,
    MAX_SECTORS,
    MAX_TEXT_BYTES,
    MCM,
    MESSAGE_REACH_M,
    TEXT,
    TYPES,
    Cam,
    Content,
    Cpm,
    Denm,
    Direction,
    EventCause,
    Feature,
    FeatureGrid,
    Intention,
    Mcm,
    MessageError,
    ReferencePose,
    Termination,
    format_track_name,
    parse_track_name,
)

__all__ = [
    "CAM", "CPM", "DENM", "FEATURE", "MCM", "TEXT", "FLOOD", "TYPES",
    "MAX_NAME_BYTES", "MAX_NAMES", "MAX_OBJECTS", "MAX_PAYLOAD_BYTES", "MAX_POINTS", "MAX_SECTORS", "MAX_TEXT_BYTES",
    "MESSAGE_REACH_M",
    "Cam", "Content", "Cpm", "Denm", "Direction", "EventCause", "Feature", "FeatureGrid", "Intention", "Mcm",
    "MessageError", "ReferencePose", "Termination",
    "decode", "encode", "displace_message", "find_problem", "format_track_name", "parse_track_name",
]  # fmt: skip


class _Codec(NamedTuple):
    kind: int
    body: Callable[[Any, ReferencePose], bytes]
    parts: Callable[[bytes], Any]
    content: Callable[[ReferencePose, Any], Content]


# Kinds 1 to 3 were the same messages without standard deviations; recordings with them cannot be decoded any more.
_CODECS: Mapping[str, _Codec] = {
    CAM: _Codec(4, encoding.encode_cam, encoding.parse_cam, encoding.build_cam),
    CPM: _Codec(5, encoding.encode_cpm, encoding.parse_cpm, encoding.build_cpm),
    MCM: _Codec(6, mcm_encoding.encode_mcm, mcm_encoding.parse_mcm, mcm_encoding.build_mcm),
    DENM: _Codec(7, denm_encoding.encode_denm, denm_encoding.parse_denm, denm_encoding.build_denm),
    FEATURE: _Codec(8, feature_encoding.encode_feature, feature_encoding.parse_feature, feature_encoding.build_feature),
}
_NAMES: Mapping[type, str] = {Cam: CAM, Cpm: CPM, Mcm: MCM, Denm: DENM, Feature: FEATURE}


def encode(content: Content) -> Message:
    """Return a message ready to send.

    Raises MessageError if the content has more parts than a message can carry, numbers that are not finite, or places
    more than `MESSAGE_REACH_M` from the sender; speeds and sizes too large for their field are clamped.
    """
    name = TEXT if isinstance(content, str) else _NAMES[type(content)]
    try:
        return build_frozen(Message, name, _payload(content), "", 0)
    except (struct.error, ValueError) as error:
        raise MessageError(f"{name}: {error}") from None


def _payload(content: Content) -> bytes:
    if isinstance(content, str):
        data = content.encode()
        if len(data) > MAX_TEXT_BYTES:
            raise MessageError(f"expected at most {MAX_TEXT_BYTES} bytes, found {len(data)}")
        return data
    codec = _CODECS[_NAMES[type(content)]]
    head = encoding.encode_header(codec.kind, content.pose)
    # Relative values refer to the rounded pose, which the receiver reads, so they have no part in its rounding error.
    return head + codec.body(content, encoding.decode_pose(head))


def decode(message: Message) -> Content:
    """Return the content of a message of a type in `TYPES`. Raises MessageError only, for any bytes."""
    if message.type not in TYPES:
        raise MessageError(f"expected a type of {', '.join(TYPES)}, found {message.type!r:.40}")
    try:
        parts = _parse_fields(message)
    except ValueError as error:
        raise MessageError(f"{message.type}: {error}") from None
    if message.type == TEXT:
        return parts
    return _CODECS[message.type].content(encoding.decode_pose(message.payload), parts)


def find_problem(message: Message) -> str | None:
    """Return why a message cannot be decoded, or None. Agents' own types have only a size limit."""
    if message.type not in TYPES:
        fits = len(message.payload) <= MAX_PAYLOAD_BYTES
        return None if fits else f"expected at most {MAX_PAYLOAD_BYTES} bytes, found {len(message.payload)}"
    try:
        _parse_fields(message)
    except ValueError as error:
        return str(error)
    return None


def _parse_fields(message: Message) -> Any:
    """Return the fields of the body, or the text. Raises ValueError if anything is invalid."""
    payload, codec = message.payload, _CODECS.get(message.type)
    if codec is None:
        if len(payload) > MAX_TEXT_BYTES:
            raise MessageError(f"expected at most {MAX_TEXT_BYTES} bytes, found {len(payload)}")
        return payload.decode()
    if len(payload) < encoding.HEADER_BYTES:
        raise MessageError(f"expected at least {encoding.HEADER_BYTES} bytes, found {len(payload)}")
    if payload[0] != codec.kind:
        raise MessageError(f"expected kind {codec.kind}, found {payload[0]}")
    encoding.check_place(payload)
    return codec.parts(payload[encoding.HEADER_BYTES :])


def displace_message(message: Message, dx: float, dy: float, dyaw: float) -> Message:
    """Return the message with its reference pose shifted [m] and rotated [rad]; types without a pose stay the same.

    The stated standard deviations stay: neither sender nor receiver knows of this error.

    The message must be valid for `decode`.
    """
    if message.type not in _CODECS:
        return message
    pose = encoding.decode_pose(message.payload)
    displaced = replace(pose, x=pose.x + dx, y=pose.y + dy, yaw=pose.yaw + dyaw)
    head = encoding.encode_header(_CODECS[message.type].kind, displaced)
    return Message(message.type, head + message.payload[encoding.HEADER_BYTES :], message.sender, message.tick)
