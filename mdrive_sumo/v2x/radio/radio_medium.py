"""RadioMedium: sends the messages of a tick over the radio, and says for each receiver what becomes of them."""

import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Final, NamedTuple

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.compiled import twin
from mdrive_sumo.core.frozen import build_frozen
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import DT, TICKS_PER_SECOND
from mdrive_sumo.v2x.radio.air_interface import INTERFACES, SidelinkInterface, list_blocks, split_message
from mdrive_sumo.v2x.radio.channel_load import (
    ChannelLoad,
    OfferedTraffic,
    RadioPicture,
    compute_itsg5_load,
    compute_sidelink_load,
    find_no_load,
)
from mdrive_sumo.v2x.radio.packet_error import CURVE_BYTES, FIRST_DB, PacketErrorModel, interpolate
from mdrive_sumo.v2x.radio.path_loss import DECORRELATION_M, LOSS_FORMULAS, Classes, LinkClass, RadioEnvironment
from mdrive_sumo.v2x.radio.radio_scene import RadioScene
from mdrive_sumo.v2x.radio.radio_settings import RadioSettings
from mdrive_sumo.v2x.radio.received_power import compute_received_power
from mdrive_sumo.v2x.radio.shadowing import draw_waves
from mdrive_sumo.v2x.radio.transmit_gate import TransmitGate

LOAD_TICKS: Final = 4
"""Ticks between two measurements of the load: 200 ms, the interval of TS 102 687's adaptive approach."""
LIFETIME_S: Final = 1.0
"""A message that is not on air by then is dropped: most that EN 302 637-2 grants a CAM in GeoNetworking."""
BACKGROUND_BYTES: Final = 212
"""CAM of a background vehicle with all headers: mean of TR 36.885, table A.1.5-2 (190 bytes four times, 300 once)."""
CAM_DISTANCE_M, SLOWEST_CAM_HZ, FASTEST_CAM_HZ = 4.0, 1.0, 10.0
"""EN 302 637-2: a CAM every 4 m, at least once and at most ten times a second. Turns and braking are left out."""


class RadioLoss(StrEnum):
    """Why a receiver does not get a message; in this order they share the interval [0, 1) of its random number."""

    PATH_LOSS = "lost-path-loss"
    BUSY = "lost-busy-receiver"
    HALF_DUPLEX = "lost-half-duplex"
    COLLISION = "lost-collision"


_LOSSES = tuple(RadioLoss)


class Transmission(NamedTuple):
    """A message that a station gives to its radio."""

    sender: str
    payload_bytes: int
    receivers: tuple[str, ...]
    lucks: tuple[float, ...]
    """Random numbers in [0, 1) of the receivers. Each stands for one fate, so that better odds never lose more."""
    is_gated: bool = True
    """Whether congestion control holds it back; a station that floods the channel has none."""


class AirLink(NamedTuple):
    """The link of a message to one receiver, in the tick of sending."""

    link_class: LinkClass
    power_dbm: int
    """Received power, rounded."""


class BusyRatio(NamedTuple):
    """Share of the time that the channel was busy at a station."""

    tick: int
    station: str
    ratio: float
    """In [0, 1], in steps of 0.001."""


class Reception(NamedTuple):
    """What becomes of a transmission."""

    arrival_s: float
    """When its last packet is on air [s since tick 0]; infinite if it expired."""
    losses: Mapping[str, RadioLoss]
    """The receivers that do not get it."""


@dataclass(slots=True)
class _StationRadio:
    """Queue and memory of one station."""

    gate: TransmitGate = field(default_factory=TransmitGate)
    free_s: float = 0.0
    """When the packet before is on air."""
    opening_s: float = 0.0
    """When congestion control lets the next packet go."""
    sent: deque[tuple[int, int, int]] = field(default_factory=deque[tuple[int, int, int]])
    """(tick, packets or blocks, their airtime [s] or sub-channels, times `EXACT`) of the last second."""
    count: int = 0
    """Packets or blocks in `sent`."""
    size: int = 0
    """Airtime or sub-channels in `sent`, times `EXACT`."""

    def measure_traffic(self, tick: int) -> tuple[float, float]:
        """Return packets per second and their mean size, of the last second or since the first message."""
        while self.sent and self.sent[0][0] <= tick - TICKS_PER_SECOND:
            _, count, size = self.sent.popleft()
            self.count, self.size = self.count - count, self.size - size
        span_s = min(max(tick, 1), TICKS_PER_SECOND) * DT
        return (self.count / span_s, self.size / EXACT / self.count) if self.count else (0.0, 0.0)


EXACT: Final = 1 << 80
"""Times that, airtimes and sub-channels are integers, so that sums of what comes and goes have no error."""


class AirBill(NamedTuple):
    """What a message of some size takes of the air."""

    airtimes: tuple[float, ...]
    """Of its packets [s]."""
    counts: tuple[tuple[int, int], ...]
    """Of each packet: 1 and its airtime [s]; LTE-V2X: its transport blocks and their sub-channels; times `EXACT`."""
    share: float
    """Its bytes with all headers, in packets of the error curves."""
    packets: float
    """Packets or blocks."""
    size: float
    """Airtime [s] or sub-channels of all."""
    colliding: float
    """What can begin at the same time as another's: packets; LTE-V2X: sub-channels."""


class RadioMedium:
    """The air of one episode."""

    def __init__(self, settings: RadioSettings, environment: RadioEnvironment, seed: int) -> None:
        self._settings, self._environment = settings, environment
        self._interface = INTERFACES[settings.profile]
        self._errors = PacketErrorModel(settings.profile, environment)
        decorrelation_m = DECORRELATION_M[environment]
        self._shadowing = draw_waves(seed, "shadowing", decorrelation_m)
        self._blockage = draw_waves(seed, "blockage", decorrelation_m)
        self._radios: dict[str, _StationRadio] = {}
        self._load_tick: int | None = None
        self._load_stations: tuple[str, ...] = ()
        self._load = find_no_load(0)
        self._access_s: dict[str, float] = {}
        """Mean time [s] between a packet at the head of a station's queue and its begin."""
        self._busy_ratios: list[BusyRatio] = []
        self._bills: dict[int, AirBill] = {}
        self._links: dict[int, AirLink] = {}
        self._heard: dict[int, tuple[tuple[str, ...], Classes, Float]] = {}
        """By tick: the stations, and what they heard of each other (n, n): classes and levels [dBm]."""

    def list_busy_ratios(self) -> tuple[BusyRatio, ...]:
        """Return all measurements, in order of ticks and names."""
        return tuple(self._busy_ratios)

    def is_load_due(self, tick: int) -> bool:
        """Return whether the scene of this tick needs the connected background vehicles."""
        return self._load_tick is None or tick - self._load_tick >= LOAD_TICKS

    def transmit(self, tick: int, scene: RadioScene, transmissions: Sequence[Transmission]) -> list[Reception]:
        """Send the messages of a tick; call it in order of ticks. Senders and receivers are stations of the scene."""
        picture = self._hear(scene)
        if self.is_load_due(tick):
            self._measure_load(tick, scene, picture)
        elif scene.stations != self._load_stations:
            self._follow_stations(scene.stations)
        bills = [self._find_bill(one.payload_bytes) for one in transmissions]
        arrivals = [self._queue(tick, one, bill) for one, bill in zip(transmissions, bills, strict=True)]
        load, curves = self._load, (self._errors.curves, FIRST_DB)
        losses = find_losses(
            list(transmissions),
            bills,
            {station: i for i, station in enumerate(scene.stations)},
            _LOSSES,
            picture.power_dbm,
            picture.classes,
            *curves,
            self._interface.noise_dbm,
            load.collision_per_packet,
            load.collision_per_second,
            load.busy_per_packet,
            load.half_duplex_per_packet,
            load.half_duplex_per_second,
        )
        n = len(scene.stations)
        self._heard[tick] = scene.stations, scene.classes[:, :n].copy(), picture.power_dbm[:, :n].copy()
        return [
            Reception(arrival_s, lost if arrival_s < math.inf else {})
            for arrival_s, lost in zip(arrivals, losses, strict=True)
        ]

    def list_links(self, tick: int) -> Mapping[str, Mapping[str, AirLink]]:
        """Return the links of each station to all others in a tick in which something was sent."""
        return list_links(*self._heard[tick], self._links)

    def _find_bill(self, payload_bytes: int) -> AirBill:
        bill = self._bills.get(payload_bytes)
        if bill is None:
            interface = self._interface
            sizes = split_message(payload_bytes, interface.header_bytes)
            measured = [self._measure_packet(size) for size in sizes]
            packets, size = float(sum(count for count, _ in measured)), math.fsum(size for _, size in measured)
            bill = self._bills[payload_bytes] = AirBill(
                tuple(interface.measure_airtime(size) for size in sizes),
                tuple((count, int(size * EXACT)) for count, size in measured),
                sum(sizes) / CURVE_BYTES,
                packets,
                size,
                size if isinstance(interface, SidelinkInterface) else packets,
            )
        return bill

    def _hear(self, scene: RadioScene) -> RadioPicture:
        """Return the received powers: with shadowing among stations, medians from background vehicles."""
        power = compute_received_power(
            scene.xy,
            scene.height,
            scene.classes,
            scene.blocker,
            scene.corner_db,
            LOSS_FORMULAS[self._environment],
            self._shadowing,
            self._blockage,
            self._settings.power_dbm + 2.0 * self._settings.antenna_gain_dbi,
        )
        return build_frozen(RadioPicture, power, scene.classes, np.arange(len(scene.xy)) < len(scene.stations))

    def _measure_load(self, tick: int, scene: RadioScene, picture: RadioPicture) -> None:
        """Compute busy ratios and risks from what was sent in the last second, and tell congestion control."""
        traffic = self._measure_traffic(tick, scene)
        compute = compute_sidelink_load if isinstance(self._interface, SidelinkInterface) else compute_itsg5_load
        self._load = compute(picture, traffic, self._errors, self._interface.noise_dbm, self._interface.sensing_dbm)
        self._load_tick = tick
        ratios = self._take_stations(scene.stations)
        self._busy_ratios += [BusyRatio(tick, station, round(ratio, 3)) for station, ratio in ratios.items()]
        for station, ratio in ratios.items():
            self._radios[station].gate.update(tick, ratio)

    def _take_stations(self, stations: tuple[str, ...]) -> dict[str, float]:
        """Note whose load it is; return their busy ratios."""
        self._load_stations = stations
        ratios = dict(zip(stations, self._load.busy_ratio.tolist(), strict=True))
        self._access_s = {station: self._interface.measure_access(ratio) for station, ratio in ratios.items()}
        for station in stations:
            if station not in self._radios:
                self._radios[station] = _StationRadio()
        return ratios

    def _measure_traffic(self, tick: int, scene: RadioScene) -> OfferedTraffic:
        known = (self._radios.get(station) for station in scene.stations)
        own = [radio.measure_traffic(tick) if radio else (0.0, 0.0) for radio in known]
        rates = np.minimum(np.maximum(scene.speed / CAM_DISTANCE_M, SLOWEST_CAM_HZ), FASTEST_CAM_HZ)
        sizes = np.full(len(rates), self._measure_packet(BACKGROUND_BYTES)[1])
        return OfferedTraffic(
            np.concatenate(([rate for rate, _ in own], rates)), np.concatenate(([size for _, size in own], sizes))
        )

    def _measure_packet(self, size: int) -> tuple[int, float]:
        """Return the packets and their airtime [s]; LTE-V2X: the transport blocks and their sub-channels."""
        if isinstance(self._interface, SidelinkInterface):
            blocks = list_blocks(size)
            return len(blocks), float(sum(blocks))
        return 1, self._interface.measure_airtime(size)

    def _follow_stations(self, stations: tuple[str, ...]) -> None:
        """Keep the load of the stations that are still there; one that is new has none until the next measurement."""
        known = {station: i for i, station in enumerate(self._load_stations)}
        rows = np.array([known.get(station, len(known)) for station in stations], dtype=np.intp)
        load = self._load
        self._load = ChannelLoad(
            np.append(load.busy_ratio, 0.0)[rows],
            *(
                np.pad(risk, (0, 1))[rows[:, None], rows]
                for risk in (
                    load.collision_per_packet, load.collision_per_second, load.busy_per_packet,
                    load.half_duplex_per_packet, load.half_duplex_per_second,
                )
            ),
        )  # fmt: skip
        self._take_stations(stations)

    def _queue(self, tick: int, one: Transmission, bill: AirBill) -> float:
        """Put a message into the queue of its sender; return when it is on air [s], infinite if it expires.

        Packets that end in time take the channel, even if a later one of the message does not; the others do not.
        """
        radio, wait_s, is_gated = self._radios[one.sender], self._interface.wait_s, one.is_gated
        access_s, ready_s = self._access_s[one.sender], tick * DT
        for airtime_s, (count, size) in zip(bill.airtimes, bill.counts, strict=True):
            begin_s = radio.free_s if radio.free_s > ready_s else ready_s
            if is_gated and radio.opening_s > begin_s:
                begin_s = radio.opening_s
            end_s = begin_s + access_s + airtime_s
            if end_s + wait_s > ready_s + LIFETIME_S:
                return math.inf
            radio.free_s = end_s
            if is_gated:
                radio.opening_s = radio.gate.find_opening(end_s, airtime_s)
            radio.sent.append((tick, count, size))
            radio.count += count
            radio.size += size
        return radio.free_s + wait_s


@twin
def find_losses(
    transmissions: list[Transmission],
    bills: list[AirBill],
    columns: dict[str, int],
    losses: tuple[RadioLoss, ...],
    power_dbm: Float,
    classes: Classes,
    curves: Float,
    first_db: float,
    noise_dbm: float,
    collision_per_packet: Float,
    collision_per_second: Float,
    busy_per_packet: Float,
    half_duplex_per_packet: Float,
    half_duplex_per_second: Float,
    /,
) -> list[dict[str, RadioLoss]]:
    """Return for each message the receivers that do not get it, and why.

    columns: of the n stations, by name. losses: all, in their order. power_dbm, classes: (n, K) as `RadioPicture`.
    curves: as `PacketErrorModel`, from `first_db`. The others: (n, n) as `ChannelLoad`.

    A packet of s bytes survives path loss with (1 - PER)^(s / 350), so a message with the sum of its bytes; the
    other causes add up likewise. -log(1 - luck) of a luck is compared with the sums of -log of what survives.
    """
    n = len(power_dbm)
    error = interpolate(curves, first_db, power_dbm[:, :n].T - noise_dbm, classes[:, :n].T)
    fades = -portable.log(np.maximum(1.0 - error, 1e-300))
    found: list[dict[str, RadioLoss]] = []
    for one, bill in zip(transmissions, bills, strict=True):
        row, to = columns[one.sender], [columns[receiver] for receiver in one.receivers]
        risks = (
            bill.share * fades[row, to],
            bill.packets * busy_per_packet[row, to],
            bill.packets * half_duplex_per_packet[row, to] + bill.size * half_duplex_per_second[row, to],
            bill.colliding * collision_per_packet[row, to] + bill.size * collision_per_second[row, to],
        )
        threshold, total = -portable.log(1.0 - np.array(one.lucks)), np.zeros(len(to))
        causes = np.zeros(len(to), dtype=np.intp)
        for risk in risks:
            total = total + risk
            causes += threshold >= total
        reached = zip(one.receivers, causes.tolist(), strict=True)
        found.append({receiver: losses[cause] for receiver, cause in reached if cause < len(losses)})
    return found


@twin
def list_links(
    stations: tuple[str, ...], classes: Classes, power_dbm: Float, known: dict[int, AirLink], /
) -> dict[str, dict[str, AirLink]]:
    """Return the links of each station to all others.

    classes, power_dbm: (n, K) as `RadioPicture`. known: links that were needed before, by level times 4 plus class.
    """
    n, links = len(stations), dict[str, dict[str, AirLink]]()
    levels = np.rint(power_dbm[:, :n]).astype(np.int64).tolist()
    for i, station in enumerate(stations):
        others = links[station] = dict[str, AirLink]()
        for k, other in enumerate(stations):
            if k != i:
                key = levels[i][k] * 4 + int(classes[i, k])
                if key not in known:
                    known[key] = make_link(key)
                others[other] = known[key]
    return links


def make_link(key: int) -> AirLink:
    """Return the link of a level [dBm] times 4 plus a class."""
    return AirLink(LinkClass(key % 4), key // 4)
