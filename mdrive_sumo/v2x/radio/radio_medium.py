"""RadioMedium: sends the messages of a tick over the radio, and says for each receiver what becomes of them."""

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Final, NamedTuple

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Int
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
from mdrive_sumo.v2x.radio.packet_error import CURVE_BYTES, PacketErrorModel
from mdrive_sumo.v2x.radio.path_loss import (
    DECORRELATION_M,
    SHADOWING_DB,
    SOURCE_SIGMA_DB,
    LinkClass,
    RadioEnvironment,
    compute_blockage_mean,
    compute_path_loss,
    find_blockage_sigma,
)
from mdrive_sumo.v2x.radio.radio_scene import RadioScene
from mdrive_sumo.v2x.radio.radio_settings import RadioSettings
from mdrive_sumo.v2x.radio.shadowing import ShadowingField
from mdrive_sumo.v2x.radio.transmit_gate import OpenGate, TransmitGate

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


@dataclass(frozen=True, slots=True)
class Reception:
    """What becomes of a transmission."""

    arrival_s: float
    """When its last packet is on air [s since tick 0]; infinite if it expired."""
    losses: Mapping[str, RadioLoss]
    """The receivers that do not get it."""
    links: Mapping[str, AirLink]


@dataclass(slots=True)
class _StationRadio:
    """Queue and memory of one station."""

    gate: TransmitGate
    free_s: float = 0.0
    """When the packet before is on air."""
    opening_s: float = 0.0
    """When congestion control lets the next packet go."""
    sent: deque[tuple[int, int, float]] = field(default_factory=deque[tuple[int, int, float]])
    """(tick, packets or blocks, their airtime [s] or sub-channels) of the last second."""

    def measure_traffic(self, tick: int) -> tuple[float, float]:
        """Return packets per second and their mean size, of the last second or since the first message."""
        while self.sent and self.sent[0][0] <= tick - TICKS_PER_SECOND:
            self.sent.popleft()
        count = sum(packets for _, packets, _ in self.sent)
        span_s = min(max(tick, 1), TICKS_PER_SECOND) * DT
        return (count / span_s, math.fsum(size for *_, size in self.sent) / count) if count else (0.0, 0.0)


class RadioMedium:
    """The air of one episode."""

    def __init__(
        self,
        settings: RadioSettings,
        environment: RadioEnvironment,
        seed: int,
        make_gate: Callable[[], TransmitGate] = OpenGate,
    ) -> None:
        self._settings, self._environment = settings, environment
        self._interface = INTERFACES[settings.profile]
        self._errors = PacketErrorModel(settings.profile, environment)
        decorrelation_m = DECORRELATION_M[environment]
        self._shadowing = ShadowingField(seed, "shadowing", decorrelation_m)
        self._blockage = ShadowingField(seed, "blockage", decorrelation_m)
        self._make_gate = make_gate
        self._radios: dict[str, _StationRadio] = {}
        self._load_tick: int | None = None
        self._load_stations: tuple[str, ...] = ()
        self._load = find_no_load(0)
        self._busy_ratios: list[BusyRatio] = []

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
        column = {station: i for i, station in enumerate(scene.stations)}
        rows = np.array([column[one.sender] for one in transmissions], dtype=np.intp)
        bills = [split_message(one.payload_bytes, self._interface.header_bytes) for one in transmissions]
        arrivals = [
            self._queue(tick, one.sender, sizes, row)
            for one, sizes, row in zip(transmissions, bills, rows.tolist(), strict=True)
        ]
        causes = self._find_causes(transmissions, bills, rows, column, picture)
        links = {
            sender: self._list_links(scene, picture, column[sender]) for sender in {one.sender for one in transmissions}
        }
        return [
            Reception(arrival_s, _name_losses(one, column, row) if math.isfinite(arrival_s) else {}, links[one.sender])
            for one, arrival_s, row in zip(transmissions, arrivals, causes, strict=True)
        ]

    def _hear(self, scene: RadioScene) -> RadioPicture:
        """Return the received powers: with shadowing among stations, medians from background vehicles."""
        n = len(scene.stations)
        apart, across = scene.xy[:n, None] - scene.xy[None], scene.height[:n, None] - scene.height[None]
        flat = apart[..., 0] * apart[..., 0] + apart[..., 1] * apart[..., 1]
        distance = np.sqrt(flat + across * across)
        low, high = (pick(scene.height[:n, None], scene.height[None]) for pick in (np.minimum, np.maximum))
        loss = compute_path_loss(self._environment, scene.classes, distance)
        corner = np.zeros((n, n), dtype=np.bool_)
        if scene.corner_db is not None:
            corner = (scene.classes[:, :n] == LinkClass.NLOSB) & np.isfinite(scene.corner_db)
            free = compute_path_loss(self._environment, np.zeros_like(scene.classes[:, :n]), distance[:, :n])
            loss[:, :n] = np.where(corner, np.maximum(scene.corner_db, free), loss[:, :n])
        blocked = scene.classes == LinkClass.NLOSV
        blockage = np.where(blocked, compute_blockage_mean(distance, low, high, scene.blocker), 0.0)
        first, second = np.triu_indices(n, 1)
        if len(first):
            places = scene.xy[first], scene.xy[second]
            sigma = np.where(corner[first, second], SOURCE_SIGMA_DB, SHADOWING_DB[scene.classes[first, second]])
            shadow = sigma * self._shadowing.evaluate(*places)
            blocker = scene.blocker[first, second]
            spread = find_blockage_sigma(low[first, second], high[first, second], blocker) * blocked[first, second]
            if spread.any():
                mean = blockage[first, second]
                blockage[first, second] = np.maximum(mean + spread * self._blockage.evaluate(*places), 0.0)
                blockage[second, first] = blockage[first, second]
            loss[first, second] = loss[first, second] + shadow
            loss[second, first] = loss[first, second]
        power = self._settings.power_dbm + 2.0 * self._settings.antenna_gain_dbi - loss - blockage
        return RadioPicture(power, scene.classes, np.arange(len(scene.xy)) < n)

    def _measure_load(self, tick: int, scene: RadioScene, picture: RadioPicture) -> None:
        """Compute busy ratios and risks from what was sent in the last second, and tell congestion control."""
        traffic = self._measure_traffic(tick, scene)
        compute = compute_sidelink_load if isinstance(self._interface, SidelinkInterface) else compute_itsg5_load
        self._load = compute(picture, traffic, self._errors, self._interface.noise_dbm, self._interface.sensing_dbm)
        self._load_tick, self._load_stations = tick, scene.stations
        ratios = dict(zip(scene.stations, self._load.busy_ratio.tolist(), strict=True))
        self._busy_ratios += [BusyRatio(tick, station, round(ratio, 3)) for station, ratio in ratios.items()]
        for station, ratio in ratios.items():
            self._find_radio(station).gate.update(ratio)

    def _measure_traffic(self, tick: int, scene: RadioScene) -> OfferedTraffic:
        own = [self._find_radio(station).measure_traffic(tick) for station in scene.stations]
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
        self._load_stations = stations

    def _find_radio(self, station: str) -> _StationRadio:
        if station not in self._radios:
            self._radios[station] = _StationRadio(self._make_gate())
        return self._radios[station]

    def _queue(self, tick: int, sender: str, sizes: Sequence[int], row: int) -> float:
        """Put a message into the queue of its sender; return when it is on air [s], infinite if it expires.

        Packets that end in time take the channel, even if a later one of the message does not; the others do not.
        """
        radio, interface = self._find_radio(sender), self._interface
        access_s = interface.measure_access(float(self._load.busy_ratio[row]))
        ready_s = tick * DT
        for size in sizes:
            airtime_s = interface.measure_airtime(size)
            end_s = max(ready_s, radio.free_s, radio.opening_s) + access_s + airtime_s
            if end_s + interface.wait_s > ready_s + LIFETIME_S:
                return math.inf
            radio.free_s, radio.opening_s = end_s, radio.gate.find_opening(end_s, airtime_s)
            radio.sent.append((tick, *self._measure_packet(size)))
        return radio.free_s + interface.wait_s

    def _find_causes(
        self,
        transmissions: Sequence[Transmission],
        bills: Sequence[Sequence[int]],
        rows: Int,
        column: Mapping[str, int],
        picture: RadioPicture,
    ) -> list[list[int]]:
        """Return for each message and station the index of its `RadioLoss`, or their number if it arrives.

        A packet of s bytes survives path loss with (1 - PER)^(s / 350), so a message with the sum of its bytes; the
        other causes add up likewise. -log(1 - luck) of a luck is compared with the sums of -log of what survives.
        """
        n = len(column)
        measured = [[self._measure_packet(size) for size in sizes] for sizes in bills]
        share = np.array([sum(sizes) / CURVE_BYTES for sizes in bills])[:, None]
        packets = np.array([float(sum(count for count, _ in one)) for one in measured])[:, None]
        size = np.array([math.fsum(length for _, length in one) for one in measured])[:, None]
        error = self._errors.compute(
            picture.power_dbm[:, :n].T - self._interface.noise_dbm, picture.classes[:, :n].T, CURVE_BYTES
        )
        fades = -portable.log(np.maximum(1.0 - error, 1e-300))
        load = self._load
        collisions = size if isinstance(self._interface, SidelinkInterface) else packets
        risks = (
            share * fades[rows],
            packets * load.busy_per_packet[rows],
            packets * load.half_duplex_per_packet[rows] + size * load.half_duplex_per_second[rows],
            collisions * load.collision_per_packet[rows] + size * load.collision_per_second[rows],
        )
        lucks = np.zeros((len(transmissions), n))
        for luck, one in zip(lucks, transmissions, strict=True):
            luck[[column[receiver] for receiver in one.receivers]] = one.lucks
        threshold, total, causes = (
            -portable.log(1.0 - lucks),
            np.zeros_like(lucks),
            np.zeros(lucks.shape, dtype=np.intp),
        )
        for risk in risks:
            total = total + risk
            causes += threshold >= total
        return causes.tolist()

    def _list_links(self, scene: RadioScene, picture: RadioPicture, row: int) -> dict[str, AirLink]:
        n = len(scene.stations)
        kinds, levels = picture.classes[:n, row].tolist(), np.rint(picture.power_dbm[:n, row]).astype(np.int64).tolist()
        return {
            station: AirLink(_CLASSES[kind], level)
            for i, (station, kind, level) in enumerate(zip(scene.stations, kinds, levels, strict=True))
            if i != row
        }


_CLASSES = tuple(LinkClass)


def _name_losses(one: Transmission, column: Mapping[str, int], causes: list[int]) -> dict[str, RadioLoss]:
    """Return the receivers that do not get a message."""
    found = ((receiver, causes[column[receiver]]) for receiver in one.receivers)
    return {receiver: _LOSSES[cause] for receiver, cause in found if cause < len(_LOSSES)}
