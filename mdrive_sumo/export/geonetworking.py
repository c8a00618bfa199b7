"""Frames of ETSI ITS: Ethernet, GeoNetworking single-hop broadcast, BTP-B.

Sources: ETSI EN 302 636-4-1 V1.4.1 (GeoNetworking), EN 302 636-5-1 V2.2.1 (BTP), TS 103 248 (ports).
"""

import struct
from dataclasses import dataclass

from mdrive_sumo.export.etsi_values import ROADSIDE_UNIT, EarthPlace

ETHER_TYPE = 0x8947
BROADCAST = b"\xff" * 6
PORTS = {"denm": 2002, "cam": 2001, "cpm": 2009}
"""BTP destination port by message type (TS 103 248, table 1)."""
TRAFFIC_CLASSES = {"denm": 1, "cam": 2, "cpm": 2}
"""DCC profiles: DP1 for DENMs, DP2 for CAMs (TS 102 636-4-2, EN 302 637-2); for CPMs as for CAMs."""
LIFETIME = 6 << 2 | 2
"""6 x 10 s, the default itsGnDefaultPacketLifetime (EN 302 636-4-1, annex H)."""
ACCURATE_M = 40.0
"""The position is called accurate if its semi-axis is below itsGnPaiInterval / 2 = 40 m."""


@dataclass(frozen=True, slots=True)
class FrameSender:
    """A station as the header of its frame describes it, at the tick of its position."""

    station: int
    """ETSI station id, 32 bits; the last four bytes of its addresses."""
    station_type: int
    place: EarthPlace
    time_ms: int
    speed: float
    """[m/s], negative backwards; 0 where its message does not say it."""
    heading: int
    """[0.1 deg] clockwise from north."""
    axis_m: float
    """Semi-axis of the 95 % ellipse of its position [m]."""


def build_frame(message_type: str, payload: bytes, sender: FrameSender) -> bytes:
    """Return the frame of an ETSI message of a type in `PORTS`."""
    address = make_mac(sender.station)
    btp = struct.pack(">HH", PORTS[message_type], 0)
    is_mobile = sender.station_type != ROADSIDE_UNIT
    basic = struct.pack(">BBBB", 1 << 4 | 1, 0, LIFETIME, 1)  # version 1, a common header follows; one hop
    common = struct.pack(
        ">BBBBHBB",
        2 << 4,  # BTP-B follows
        5 << 4,  # topologically scoped broadcast, single hop
        TRAFFIC_CLASSES[message_type],
        is_mobile << 7,
        len(btp) + len(payload),
        1,
        0,
    )
    return BROADCAST + address + struct.pack(">H", ETHER_TYPE) + basic + common + _pack_position(sender) + btp + payload


def make_mac(station: int) -> bytes:
    """Return the locally administered MAC address of a station."""
    return b"\x02\x00" + struct.pack(">I", station)


def _pack_position(sender: FrameSender) -> bytes:
    """Return the long position vector and the media-dependent data of a single-hop broadcast (28 bytes)."""
    speed = min(max(round(sender.speed * 100), -16_384), 16_383)
    motion = (sender.axis_m < ACCURATE_M) << 15 | speed & 0x7FFF
    return (
        struct.pack(">H", sender.station_type << 10)
        + make_mac(sender.station)
        + struct.pack(
            ">IiiHH", sender.time_ms % 2**32, sender.place.latitude, sender.place.longitude, motion, sender.heading
        )
        + bytes(4)
    )
