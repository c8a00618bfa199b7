"""Load of the channel: busy ratio at each station, and what it costs a packet in collisions and busy receivers.

ITS-G5: Sepulcre, Gonzalez-Martin, Gozalvez, Molina-Masegosa, Coll-Perales, "Analytical Models of the Performance of
IEEE 802.11p Vehicle to Vehicle Communications", IEEE Trans. Veh. Technol. 71(1), 2022; numbers in brackets are its
equations. LTE-V2X: Gonzalez-Martin, Sepulcre, Molina-Masegosa, Gozalvez, "Analytical Models of the Performance of
C-V2X Mode 4 Vehicular Communications", IEEE Trans. Veh. Technol. 68(2), 2019, its step 2.

The papers sum over vehicles at equal distances of a straight road; here the sums run over the stations that are there,
with the power that each is received with. Probabilities p of many interferers are joined as exp(-sum p) where the
papers have the product of 1 - p, so that they follow from sums for a packet of any length.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.compiled import twin
from mdrive_sumo.core.geometry import Bool, Float
from mdrive_sumo.v2x.radio.air_interface import SLOT_S, SUBCHANNELS, SUBFRAME_S
from mdrive_sumo.v2x.radio.packet_error import BLUR_FIRST_DB, PacketErrorModel, interpolate
from mdrive_sumo.v2x.radio.path_loss import SHADOWING_DB, Classes, from_db, log10

MAX_BUSY_RATIO: Final = 0.84
"""Where the polynomial of equation 35 has its maximum: more load does not make the channel busier."""
_BUSY_SQUARE, _BUSY_LINEAR, _BUSY_CONSTANT = -0.2481, 0.913, 0.003844
"""Equation 35: busy ratio over offered load, fitted by its authors to their simulations."""
_PERIOD_S = 0.1
"""Reservation period of mode 4 (10 Hz)."""
_TAU = 10.0
"""Packets of an interferer, one of which it sends without having heard ours: equation 24 of the second paper."""


@dataclass(frozen=True, slots=True)
class RadioPicture:
    """What n stations hear of K >= n senders, of which the first n are themselves. All arrays (n, K)."""

    power_dbm: Float
    """Received power: of each other without what is random, if `is_known` is False."""
    classes: Classes
    is_known: Bool
    """(K,) whether the power contains the shadowing of the pair."""


@dataclass(frozen=True, slots=True)
class OfferedTraffic:
    """What K stations send."""

    rate: Float
    """(K,) packets (LTE-V2X: transport blocks) per second."""
    size: Float
    """(K,) mean airtime [s] of one; LTE-V2X: its sub-channels."""


@dataclass(frozen=True, slots=True)
class ChannelLoad:
    """Busy ratio (n,) and risks (n, n) of a packet from station i (row) at station k (column)."""

    busy_ratio: Float
    collision_per_packet: Float
    """-log of the probability that no collision is due to another's begin; LTE-V2X: for each sub-channel of a block."""
    collision_per_second: Float
    """The same, for each second of airtime."""
    busy_per_packet: Float
    """-log of the probability that the receiver is not receiving another packet."""
    half_duplex_per_packet: Float
    """-log of the probability that the receiver does not send."""
    half_duplex_per_second: Float


def find_no_load(count: int) -> ChannelLoad:
    """Return the load of a silent channel."""
    zeros = np.zeros((count, count))
    return ChannelLoad(np.zeros(count), zeros, zeros, zeros, zeros, zeros)


def compute_detection(picture: RadioPicture, sensing_dbm: float) -> Float:
    """Return the probability (n, K) that a station notices a sender: equation 13, or 0 and 1 where power is known."""
    margin = picture.power_dbm - sensing_dbm
    spread = margin / SHADOWING_DB[picture.classes]
    detected = np.where(picture.is_known, np.where(margin >= 0.0, 1.0, 0.0), compute_normal_cdf(spread))
    return _clear_diagonal(detected)


def compute_normal_cdf(x: Float) -> Float:
    """Return the standard normal distribution function, within 1e-7 (Abramowitz and Stegun, 26.2.17)."""
    distance = np.abs(x)
    t = 1.0 / (1.0 + 0.2316419 * distance)
    series = t * (0.319381530 + t * (-0.356563782 + t * (1.781477937 + t * (-1.821255978 + t * 1.330274429))))
    tail = portable.exp(-0.5 * distance * distance) * 0.3989422804014327 * series
    return np.where(x < 0.0, tail, 1.0 - tail)


def compute_itsg5_load(
    picture: RadioPicture, traffic: OfferedTraffic, errors: PacketErrorModel, noise_dbm: float, sensing_dbm: float
) -> ChannelLoad:
    """Return busy ratios and risks with CSMA/CA."""
    heard = picture.power_dbm, picture.classes, picture.is_known
    curves = errors.blurred, BLUR_FIRST_DB
    return ChannelLoad(*sum_itsg5_risks(*heard, traffic.rate, traffic.size, *curves, noise_dbm, sensing_dbm))


def compute_sidelink_load(
    picture: RadioPicture, traffic: OfferedTraffic, errors: PacketErrorModel, noise_dbm: float, sensing_dbm: float
) -> ChannelLoad:
    """Return busy ratios and risks with the sensing-based reservation of LTE-V2X mode 4."""
    heard = picture.power_dbm, picture.classes, picture.is_known
    curves = errors.blurred, BLUR_FIRST_DB
    return ChannelLoad(*sum_sidelink_risks(*heard, traffic.rate, traffic.size, *curves, noise_dbm, sensing_dbm))


@twin
def sum_itsg5_risks(
    power_dbm: Float,
    classes: Classes,
    is_known: Bool,
    rate: Float,
    size: Float,
    blurred: Float,
    first_db: float,
    noise_dbm: float,
    sensing_dbm: float,
    /,
) -> tuple[Float, Float, Float, Float, Float, Float]:
    """Return the fields of a `ChannelLoad`, from those of `RadioPicture` and `OfferedTraffic`.

    blurred: error curves as `PacketErrorModel`, from `first_db`.
    """
    picture, count = RadioPicture(power_dbm, classes, is_known), len(power_dbm)
    detected = compute_detection(picture, sensing_dbm)
    busy_ratio = compress_load(add_up(detected * (rate * size)))
    chance = rate / (1.0 - busy_ratio[:, None] * _compute_overlap(picture, sensing_dbm))
    """(n, K): packets per second of an interferer that could begin while the sender does."""
    hidden, heard = chance * (1.0 - detected), chance * detected * SLOT_S
    spoils = _compute_spoiling(picture, blurred, first_db, noise_dbm)
    is_nearer = power_dbm[None] > power_dbm[:, :count].T[:, :, None]
    """(n, n, K): whether the receiver hears the interferer louder than the sender."""
    late = np.where(is_nearer, 0.0, heard[:, None, :]) * spoils  # 32
    deaf = hidden[:, None, :] * spoils  # 28: begins while the packet lasts ...
    before = deaf * (1.0 - detected)[None] * size  # ... or has begun, and the receiver has not noticed
    busy = hidden[:, None, :] * detected[None] * size  # 16
    busy = busy + np.where(is_nearer, heard[:, None, :] * detected[None], 0.0)  # 21
    return (
        busy_ratio,
        _leave_out_pair(late + before),
        _leave_out_pair(deaf),
        _leave_out_pair(busy),
        _clear_diagonal(heard[:, :count] + hidden[:, :count] * size[:count]),
        _clear_diagonal(hidden[:, :count]),
    )


@twin
def sum_sidelink_risks(
    power_dbm: Float,
    classes: Classes,
    is_known: Bool,
    rate: Float,
    size: Float,
    blurred: Float,
    first_db: float,
    noise_dbm: float,
    sensing_dbm: float,
    /,
) -> tuple[Float, Float, Float, Float, Float, Float]:
    """Return the fields of a `ChannelLoad`: arguments as `sum_itsg5_risks`."""
    picture, count = RadioPicture(power_dbm, classes, is_known), len(power_dbm)
    detected = compute_detection(picture, sensing_dbm)
    resources = SUBCHANNELS * _PERIOD_S / SUBFRAME_S
    taken = rate * _PERIOD_S * size
    """(K,) resources of a period that each sender takes."""
    busy_ratio = spread_reservations(add_up(detected * (taken / resources)))
    busy = busy_ratio[:, None]
    overlap = _compute_overlap(picture, sensing_dbm)
    common = 1.0 - 2.0 * busy + overlap * (busy - busy * busy) + busy * busy  # 27, 30: as a share of all
    unheard = 1.0 - (1.0 - 1.0 / _TAU) * detected  # 24
    same = unheard * common / ((1.0 - busy) * (1.0 - busy)) * (taken / resources)  # 23, 26
    risk = same[:, None, :] * _compute_spoiling(picture, blurred, first_db, noise_dbm)
    silent = np.zeros((count, count))
    sends = np.broadcast_to(rate[:count] * SUBFRAME_S, (count, count))  # 7
    return busy_ratio, _leave_out_pair(risk), silent, silent.copy(), _clear_diagonal(sends), silent.copy()


def compress_load(offered: Float) -> Float:
    """Return the busy ratio (n,) of the offered load (n,), in seconds of airtime per second: equation 35.

    Never above the load itself (the polynomial has 0.004 at 0) nor above `MAX_BUSY_RATIO`.
    """
    load = np.minimum(offered, 1.84)
    fitted = (_BUSY_SQUARE * load + _BUSY_LINEAR) * load + _BUSY_CONSTANT
    return np.minimum(np.minimum(fitted, load), MAX_BUSY_RATIO)


def spread_reservations(offered: Float) -> Float:
    """Return the share (n,) of reserved resources: one half of the senders avoid each other, the other half take any.

    Equation 29 of the second paper for many resources, in closed form; at most 0.95, so that some are left to choose.
    """
    half = np.minimum(offered, 2.0) / 2.0
    one_by_one = np.minimum(half, 0.5)
    below = 2.0 * one_by_one - one_by_one * one_by_one / (2.0 * (1.0 - one_by_one))
    return np.minimum(np.where(half <= 0.5, below, 0.5 + half / 2.0), 0.95)


def add_up(values: Float) -> Float:
    """Return the sums over the last axis, from first to last."""
    return np.add.accumulate(values, axis=-1)[..., -1] if values.shape[-1] else np.zeros(values.shape[:-1])


def _compute_overlap(picture: RadioPicture, sensing_dbm: float) -> Float:
    """Return which share (n, K) of what a station notices the other notices, too: equations 20 and 30.2.

    The papers compute the autocorrelation of the sensing range along their road; a range with a sharp edge, as here,
    has 1 - distance / (2 range). The range is that of the loss exponent 2 through the pair's own power.
    """
    margin = np.minimum(np.maximum(picture.power_dbm - sensing_dbm, -60.0), 60.0)
    return np.maximum(1.0 - 0.5 * from_db(-0.5 * margin), 0.0)


def _compute_spoiling(picture: RadioPicture, blurred: Float, first_db: float, noise_dbm: float) -> Float:
    """Return the probability (n, n, K) that an interferer (last) spoils a packet that would arrive: equation 31."""
    count = len(picture.power_dbm)
    noise = float(from_db(np.array([noise_dbm]))[0])
    disturbed = 10.0 * log10(noise + from_db(picture.power_dbm))
    signal = picture.power_dbm[:, :count].T
    classes = picture.classes[:, :count].T
    alone = interpolate(blurred, first_db, signal - noise_dbm, classes)[:, :, None]
    sinr = signal[:, :, None] - disturbed[None]
    lost = interpolate(blurred, first_db, sinr, np.broadcast_to(classes[:, :, None], sinr.shape))
    return np.where(alone < 1.0, np.maximum(lost - alone, 0.0) / np.maximum(1.0 - alone, 1e-9), 0.0)


def _clear_diagonal(values: Float) -> Float:
    """Return the values without those of a station with itself."""
    cleared = values.copy()
    np.fill_diagonal(cleared, 0.0)
    return cleared


def _leave_out_pair(risk: Float) -> Float:
    """Return the sums (n, n) over interferers (n, n, K) that are neither sender nor receiver."""
    rows = np.arange(len(risk))
    risk[rows, :, rows] = 0.0
    risk[:, rows, rows] = 0.0
    return _clear_diagonal(add_up(risk))
