"""Packets of a message, and what a packet takes of the channel: airtime in ITS-G5, sub-channels in LTE-V2X."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

from mdrive_sumo.v2x.radio.radio_settings import RadioProfile

PACKET_BYTES: Final = 1398
"""Most payload of one GeoNetworking packet: itsGnMaxSduSize of ETSI EN 302 636-4-1."""
SLOT_S: Final = 13e-6
"""Slot of IEEE 802.11 in a channel of 10 MHz; also how long two stations do not hear each other begin."""
_SIFS_S, _AIFSN, _CONTENTION_WINDOW = 32e-6, 6, 15
"""IEEE 802.11-2016, OFDM at 10 MHz; AIFSN of AC_BE outside a BSS, and its least contention window. Broadcasts are
never repeated, so the window does not grow."""
_PREAMBLE_S, _SYMBOL_S, _BITS_PER_SYMBOL = 40e-6, 8e-6, 48
"""IEEE 802.11-2016, clause 17, 10 MHz: training and SIGNAL field, symbol, and data bits of a symbol at 6 Mbit/s."""
_SERVICE_AND_TAIL_BITS = 16 + 6
SUBFRAME_S: Final = 1e-3
SUBCHANNELS: Final = 5
"""Of 10 resource blocks each in 10 MHz, of which the control information takes two (3GPP TS 36.213, 14.1)."""
_TRANSPORT_BYTES = 121, 277, 421, 573, 749
"""Bytes of a transport block in 1 to 5 sub-channels: 8, 18, 28, 38, 48 blocks at I_TBS 7 (TS 36.213, table
7.1.7.2.1-1: 968, 2216, 3368, 4584, 5992 bits)."""
_SELECTION_S = (4e-3 + 100e-3) / 2
"""Middle of the window from T1 to T2 in which a station has a resource (TS 36.213, 14.1.1.6: T1 at most 4 ms, T2 at
most 100 ms): the mean wait of a message."""


@dataclass(frozen=True, slots=True)
class AirInterface:
    """What a profile fixes. Levels in dBm."""

    header_bytes: int
    """Added to the payload of every packet."""
    noise_dbm: float
    sensing_dbm: float
    """A station notices a transmission that it receives at this level or above."""
    wait_s: float = 0.0
    """Mean time [s] between a message and its first packet, whatever the queue."""

    def measure_airtime(self, size: int) -> float:
        """Return the time [s] that a packet of `size` bytes, headers included, occupies the channel."""
        bits = _SERVICE_AND_TAIL_BITS + 8 * size
        return _PREAMBLE_S + _SYMBOL_S * -(-bits // _BITS_PER_SYMBOL)

    def measure_access(self, busy_ratio: float) -> float:
        """Return the mean time [s] between a packet at the head of the queue and its begin: AIFS and backoff.

        The countdown stops while the channel is busy, which divides it by the idle share. A mean, not a draw.
        """
        return (_SIFS_S + _AIFSN * SLOT_S + SLOT_S * _CONTENTION_WINDOW / 2) / (1.0 - busy_ratio)


@dataclass(frozen=True, slots=True)
class SidelinkInterface(AirInterface):
    """LTE-V2X mode 4: a packet is cut into transport blocks, each in a subframe of its own.

    `measure_airtime` is the time until its last block ends; its share of the channel follows from `list_blocks`.
    """

    def measure_airtime(self, size: int) -> float:
        """Return the time [s] from the first subframe of a packet to the end of its last."""
        return SUBFRAME_S * len(list_blocks(size))

    def measure_access(self, busy_ratio: float) -> float:  # noqa: ARG002 - as its base
        """Return 0: a block has a resource that was reserved, whatever the load."""
        return 0.0


def list_blocks(size: int) -> tuple[int, ...]:
    """Return the sub-channels of each transport block of a packet of `size` bytes: the last as few as possible."""
    full, rest = divmod(size, _TRANSPORT_BYTES[-1])
    last = [next(n for n, most in enumerate(_TRANSPORT_BYTES, 1) if rest <= most)] if rest else []
    return (*[SUBCHANNELS] * full, *last)


def split_message(payload_bytes: int, header_bytes: int) -> tuple[int, ...]:
    """Return the sizes of the packets of a message, headers included; an empty message has one."""
    full, rest = divmod(payload_bytes, PACKET_BYTES)
    sizes = [PACKET_BYTES] * full + ([rest] if rest or not full else [])
    return tuple(size + header_bytes for size in sizes)


NOISE_DBM: Final = -104.0 + 9.0
"""Thermal noise of 10 MHz at 290 K, and the noise figure of 9 dB of 3GPP TR 36.885 and TR 37.885."""
_UPPER_BYTES = 40 + 4 + 95
"""GeoNetworking single-hop broadcast, BTP-B and signed envelope: counted in docs/v2x.md for the preset `realistic`."""
INTERFACES: Mapping[RadioProfile, AirInterface] = MappingProxyType(
    {
        # 802.11 QoS header and checksum 30, LLC and SNAP 8. Sensing: a valid preamble of 10 MHz is noticed from -85 dBm
        # on (IEEE 802.11-2016, 17.3.10.6, and ETSI TS 102 687, which counts samples above -85 dBm as busy).
        RadioProfile.ITS_G5: AirInterface(_UPPER_BYTES + 38, NOISE_DBM, -85.0),
        # PDCP 1 + RLC UM 1 + MAC SL-SCH 5: the shortest headers of 3GPP TS 36.323, 36.322, 36.321. Sensing: -90.5 dBm,
        # as in the analytical model of mode 4 (IEEE TVT 68(2), 2019).
        RadioProfile.LTE_V2X: SidelinkInterface(_UPPER_BYTES + 7, NOISE_DBM, -90.5, _SELECTION_S),
    }
)
