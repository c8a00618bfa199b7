"""Reception over distance on the highway of Sepulcre et al. (IEEE TVT 71(1), 2022), by their equations and by ours.

Their set-up: 60 and 120 vehicles/km at equal distances, 10 Hz, 23 dBm, 190 bytes and 30 of headers, 6 Mbit/s,
WINNER+ B1 with 3 dB of shadowing, sensing at -85 dBm, which also ends reception, noise -95 dBm. Their figures are no
text, so their equations are evaluated here as they stand, as products over interferers with integrals over both
shadowings. Their error curve (Goubet et al. 2015) ends at 36 dB and ours at 12 dB: both sides have ours.
"""

import math

import numpy as np
import pytest

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.v2x.radio.air_interface import SLOT_S
from mdrive_sumo.v2x.radio.channel_load import OfferedTraffic, RadioPicture, compute_itsg5_load, compute_normal_cdf
from mdrive_sumo.v2x.radio.packet_error import PacketErrorModel
from mdrive_sumo.v2x.radio.path_loss import RadioEnvironment
from mdrive_sumo.v2x.radio.radio_settings import RadioProfile

pytestmark = pytest.mark.slow

ERRORS = PacketErrorModel(RadioProfile.ITS_G5, RadioEnvironment.HIGHWAY)
POWER, SENSING, NOISE, SIGMA, RATE = 23.0, -85.0, -95.0, 3.0, 10.0
AIRTIME = 40e-6 + 220 * 8 / 6e6
NODES, _SUMS = np.polynomial.hermite_e.hermegauss(24)
WEIGHTS = _SUMS / _SUMS.sum()


def receive(distance: Float) -> Float:
    """Median power [dBm] by WINNER+ B1 at 5.89 GHz with antennas at 1.5 m: broken at 78.5 m, at most free space."""
    d = np.maximum(np.abs(distance), 3.0)
    far_m = 4 * 5.89e9 / 3e8
    near = 22.7 * np.log10(d) + 27 + 20 * np.log10(5.89)
    loss = np.where(d < far_m, near, 40 * np.log10(d) + 7.56 + 2.7 * np.log10(5.89))
    return POWER - np.maximum(loss, 20 * np.log10(d) + 46.4 + 20 * np.log10(5.89 / 5))


def error(sinr: Float) -> Float:
    return ERRORS.compute(sinr, np.zeros(sinr.shape, dtype=np.uint8), 350)


def notice(distance: Float) -> Float:
    return compute_normal_cdf((receive(distance) - SENSING) / SIGMA)


def signals(distance: float) -> tuple[Float, Float]:
    """Levels [dBm] of a signal that is noticed, and their weights."""
    levels = receive(np.array([distance])) + SIGMA * np.linspace(-4, 4, 81)
    weights = np.where(levels >= SENSING, np.exp(-0.5 * np.linspace(-4, 4, 81) ** 2), 0.0)
    return levels, weights / max(weights.sum(), 1e-300)


def place_interferers(density: float, distance: float) -> tuple[Float, Float]:
    """Distances [m] of all vehicles within 1 km of the receiver, to it and to the sender; without these two."""
    k = np.arange(1, round(1000 * density) + 1) / density
    to_receiver = np.concatenate((-k[::-1], k))
    to_sender = to_receiver + distance
    others = np.abs(to_sender) > 0.5 / density
    return to_receiver[others], to_sender[others]


def evaluate_paper(density: float, distance: float) -> float:
    """Packet delivery ratio: equations 1 to 35."""
    reach = np.arange(-1500.0, 1501.0)
    sensed = notice(reach)
    offered = density * RATE * AIRTIME * sensed.sum()
    busy = -0.2481 * offered**2 + 0.913 * offered + 0.003844  # 34, 35
    overlap = np.correlate(sensed, sensed, "full")[3000:] / (sensed**2).sum()  # 20
    levels, weights = signals(distance)
    unsensed = 1 - notice(np.array([distance]))[0]  # 12
    unheard = float(weights @ error(levels - NOISE))  # 24
    to_receiver, to_sender = place_interferers(density, distance)
    levels_in = receive(to_receiver)[:, None] + SIGMA * NODES
    floor = 10 * np.log10(10 ** (NOISE / 10) + 10 ** (levels_in / 10))
    spoiled = np.einsum("s,isk,k->i", weights, error(levels[None, :, None] - floor[:, None, :]), WEIGHTS)
    harm = (spoiled - unheard) / (1 - unheard)  # 30, 31
    at_receiver, at_sender = notice(to_receiver), notice(to_sender)
    free = 1 - busy * overlap[np.abs(to_sender).round().astype(int)]
    together, hidden = SLOT_S * RATE * at_sender / free, AIRTIME * RATE * (1 - at_sender) / free  # 22, 18
    is_nearer = np.abs(to_receiver) < distance
    taken = np.where(is_nearer, together * at_receiver, 0.0) + hidden * at_receiver  # 21, 16
    collide = np.where(is_nearer, 0.0, harm * together) + harm * hidden * (2 - at_receiver)  # 32, 28
    return float((1 - unsensed) * np.prod(1 - taken) * (1 - unheard) * np.prod(1 - collide))


def evaluate_ours(density: float, distance: float) -> float:
    """The same link and vehicles in our sums, with the mean over the shadowing of the link."""
    to_receiver, to_sender = place_interferers(density, distance)
    levels, weights = signals(distance)
    total = 0.0
    for level, weight in zip(levels[::4], weights[::4] / weights[::4].sum(), strict=True):
        power = np.stack(
            (np.concatenate(([0.0, level], receive(to_sender))), np.concatenate(([level, 0.0], receive(to_receiver))))
        )
        known = np.arange(power.shape[1]) < 2
        picture = RadioPicture(power, np.zeros(power.shape, dtype=np.uint8), known)
        traffic = OfferedTraffic(np.full(len(known), RATE), np.full(len(known), AIRTIME))
        load = compute_itsg5_load(picture, traffic, ERRORS, NOISE, SENSING)
        risk = load.busy_per_packet[0, 1] + load.collision_per_packet[0, 1] + AIRTIME * load.collision_per_second[0, 1]
        total += weight * (1 - error(np.array([level - NOISE]))[0]) * math.exp(-risk)
    return total * notice(np.array([distance]))[0]


@pytest.mark.parametrize("density", [0.06, 0.12])
def test_reception_over_distance_is_that_of_the_published_model_to_one_point(density: float) -> None:
    distances = (25.0, 50.0, 100.0, 150.0, 200.0, 250.0, 300.0, 350.0, 400.0, 500.0)
    paper = np.array([evaluate_paper(density, d) for d in distances])
    ours = np.array([evaluate_ours(density, d) for d in distances])
    assert paper[0] > 0.9 > 0.1 > paper[-1]
    assert np.abs(ours - paper).max() < 0.01
