"""CPMs in UPER as ETSI TR 103 562 V2.1.1 defines them, the version that Wireshark 4.0 decodes.

pycrate 0.8 ships no ASN.1 types of collective perception: the fields are written here, with the ranges of that report.
"""

import math
from collections.abc import Iterator
from typing import NamedTuple

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import TAU
from mdrive_sumo.core.state import Kind
from mdrive_sumo.export.etsi_values import (
    MS_PER_TICK,
    PASSENGER_CAR,
    ROADSIDE_UNIT,
    UNAVAILABLE_ALTITUDE,
    clamp,
    place_front,
    place_on_earth,
    to_confidence,
    to_delta_time,
    to_ellipse_axis,
    to_heading,
)
from mdrive_sumo.export.uper_writer import UperWriter
from mdrive_sumo.v2x.messages import Cpm

PROTOCOL_VERSION, MESSAGE_ID = 1, 14
OBJECTS_PER_SEGMENT = 50
"""An object takes at most 210 bits and all else at most 52 bytes: with BTP's 4 bytes, 1 369 of the 1 398 that a
GeoNetworking packet may carry (EN 302 636-4-1, itsGnMaxSduSize)."""
FULL_CIRCLE = 3600
"""[0.1 deg]"""
UNKNOWN_CONFIDENCE = 101
"""ObjectConfidence: not available."""
PEDESTRIAN, CYCLIST = 1, 3
"""Types of persons; vehicles have type 0, unknown: a detection does not tell a car from a truck."""
STATIC_STATUS = 2
"""DynamicStatus: static."""


class CpmSender(NamedTuple):
    """What a CPM's own content does not say of its sender."""

    station: int
    """ETSI station id, 32 bits."""
    length_m: float
    width_m: float
    object_ids: tuple[int, ...]
    """ETSI's id of each object, 8 bits."""


def encode_etsi_cpm(cpm: Cpm, sender: CpmSender) -> Iterator[bytes]:
    """Yield the segments of a CPM; one for at most `OBJECTS_PER_SEGMENT` objects."""
    count = len(cpm.objects.ids)
    starts = range(0, count, OBJECTS_PER_SEGMENT) or range(1)
    for number, start in enumerate(starts, 1):
        rows = range(start, min(start + OBJECTS_PER_SEGMENT, count))
        yield _encode_segment(cpm, sender, rows, (len(starts), number))


def _encode_segment(cpm: Cpm, sender: CpmSender, rows: range, segment: tuple[int, int]) -> bytes:
    """Return a segment; rows: its objects; segment: the number of segments, and which this is."""
    bits = UperWriter()
    bits.add_bits(PROTOCOL_VERSION, 8)
    bits.add_bits(MESSAGE_ID, 8)
    bits.add_bits(sender.station, 32)
    bits.add_bits(to_delta_time(cpm.pose.tick), 16)
    has_vehicle, has_objects = not cpm.roadside, len(rows) > 0
    bits.add_flags(False, has_vehicle, True, has_objects, False)  # no extension, no free space
    _add_management(bits, cpm, sender, segment)
    if has_vehicle:
        _add_vehicle(bits, cpm, sender)
    _add_sensor(bits, cpm, sender)
    if has_objects:
        bits.add_flags(False)
        bits.add_integer(len(rows), 1, 128)
        for row in rows:
            _add_object(bits, cpm, sender, row)
    bits.add_integer(len(cpm.objects.ids), 0, 255)
    return bits.to_bytes()


def _add_management(bits: UperWriter, cpm: Cpm, sender: CpmSender, segment: tuple[int, int]) -> None:
    bits.add_flags(False, segment[0] > 1)
    bits.add_bits(ROADSIDE_UNIT if cpm.roadside else PASSENGER_CAR, 8)
    if segment[0] > 1:
        bits.add_integer(segment[0], 1, 127)
        bits.add_integer(segment[1], 1, 127)
    place = place_on_earth(*_find_reference(cpm, sender))
    bits.add_integer(place.latitude, -900_000_000, 900_000_001)
    bits.add_integer(place.longitude, -1_800_000_000, 1_800_000_001)
    axis = to_ellipse_axis(cpm.pose.position_sigma)
    for value in (axis, axis):
        bits.add_integer(value, 0, 4095)
    bits.add_integer(0, 0, 3601)  # the ellipse is a circle
    bits.add_integer(UNAVAILABLE_ALTITUDE, -100_000, 800_001)
    bits.add_choice(15, 16)  # its confidence is unavailable


def _find_reference(cpm: Cpm, sender: CpmSender) -> tuple[float, float]:
    """Return the point [m] that places of objects are relative to: the middle of the front, or the road-side unit."""
    return place_front(cpm.pose, 0.0 if cpm.roadside else sender.length_m)


def _add_vehicle(bits: UperWriter, cpm: Cpm, sender: CpmSender) -> None:
    """Add the originating vehicle: heading and size; a CPM of ours has no speed of its sender."""
    bits.add_flags(False)
    bits.add_choice(0, 2)
    optional = [False] * 12
    optional[8] = optional[9] = True  # length and width
    bits.add_flags(False, *optional)
    bits.add_integer(to_heading(cpm.pose.yaw), 0, 3601)
    bits.add_integer(to_confidence(math.degrees(cpm.pose.yaw_sigma), 0.1), 1, 127)
    bits.add_integer(16_383, 0, 16_383)  # speed: unavailable
    bits.add_integer(127, 1, 127)
    bits.add_integer(clamp(sender.length_m * 10, 1, 1022), 1, 1023)
    bits.add_choice(0, 5)  # no trailer
    bits.add_integer(clamp(sender.width_m * 10, 1, 61), 1, 62)


def _add_sensor(bits: UperWriter, cpm: Cpm, sender: CpmSender) -> None:
    """Add one sensor that looks all around, with its range."""
    bits.add_flags(False)
    bits.add_integer(1, 1, 128)
    bits.add_flags(False, False)
    bits.add_bits(0, 8)
    bits.add_integer(0, 0, 15)  # of undefined type
    bits.add_flags(False)
    bits.add_choice(1 if cpm.roadside else 0, 6)
    range_dm = clamp(cpm.range_m * 10, 0, 10_000)
    if cpm.roadside:
        bits.add_flags(False, False, False, False, False)
        bits.add_integer(range_dm, 0, 10_000)
    else:
        bits.add_flags(False, False, False)
        bits.add_integer(clamp(-sender.length_m * 50, -5000, 0), -5000, 0)  # [cm] from the front to the box centre
        bits.add_integer(0, -1000, 1000)
        bits.add_integer(1, 1, 10)
        bits.add_flags(False, False, False)
        bits.add_integer(range_dm, 0, 10_000)
    bits.add_integer(0, 0, 3601)
    bits.add_integer(FULL_CIRCLE, 0, 3601)


def _add_object(bits: UperWriter, cpm: Cpm, sender: CpmSender, row: int) -> None:
    """Add an object; the axes are ahead and left of a vehicle, east and north of a road-side unit."""
    objects, yaw = cpm.objects, 0.0 if cpm.roadside else cpm.pose.yaw
    sigmas = cpm.sigmas[row].tolist() if len(cpm.sigmas) else (0.0, 0.0, 0.0)
    kind = Kind(int(objects.kind[row]))
    optional = [False] * 16
    optional[8] = optional[9] = optional[10] = True  # yaw, length and width
    optional[13], optional[14] = kind is Kind.STATIC, True  # dynamic status, class
    bits.add_flags(False, *optional)
    bits.add_bits(sender.object_ids[row], 8)
    bits.add_integer(clamp(int(cpm.age[row]) * MS_PER_TICK, 0, 1500), -1500, 1500)
    x, y = _find_reference(cpm, sender)
    for metres in _rotate(float(objects.x[row]) - x, float(objects.y[row]) - y, -yaw):
        bits.add_integer(clamp(metres * 100, -132_768, 132_767), -132_768, 132_767)
        bits.add_integer(to_confidence(sigmas[0], 0.01, 100), 0, 102)
    turn = float(objects.yaw[row]) - yaw
    for speed in _rotate(float(objects.speed[row]), 0.0, turn):
        bits.add_integer(clamp(speed * 100, -16_382, 16_382), -16_383, 16_383)
        bits.add_integer(to_confidence(sigmas[2], 0.01), 1, 127)
    bits.add_integer(round(math.degrees(turn % TAU) * 10) % FULL_CIRCLE, 0, 3601)
    bits.add_integer(to_confidence(math.degrees(sigmas[1]), 0.1), 1, 127)
    for size in (objects.length[row], objects.width[row]):
        bits.add_integer(clamp(float(size) * 10, 0, 1023), 0, 1023)
        bits.add_integer(102, 0, 102)  # unavailable
    if kind is Kind.STATIC:
        bits.add_integer(STATIC_STATUS, 0, 2)
    _add_class(bits, kind)


def _add_class(bits: UperWriter, kind: Kind) -> None:
    """Add what the object is; its confidence is unavailable."""
    bits.add_integer(1, 1, 8)
    bits.add_integer(UNKNOWN_CONFIDENCE, 0, 101)
    type_ = {Kind.PEDESTRIAN: PEDESTRIAN, Kind.CYCLIST: CYCLIST}.get(kind, 0)
    bits.add_choice({Kind.VEHICLE: 0, Kind.STATIC: 3}.get(kind, 1), 4)
    bits.add_flags(type_ > 0, False)
    if type_:
        bits.add_bits(type_, 8)


def _rotate(x: float, y: float, angle: float) -> tuple[float, float]:
    cos, sin = portable.cos_sin(angle)
    return cos * x - sin * y, sin * x + cos * y
