"""Load of the channel: closed forms, one interferer by hand, and reservations."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mdrive_sumo.v2x.radio.air_interface import INTERFACES
from mdrive_sumo.v2x.radio.channel_load import (
    ChannelLoad,
    OfferedTraffic,
    RadioPicture,
    compress_load,
    compute_itsg5_load,
    compute_normal_cdf,
    compute_sidelink_load,
    spread_reservations,
)
from mdrive_sumo.v2x.radio.packet_error import BLUR_FIRST_DB, PacketErrorModel, interpolate
from mdrive_sumo.v2x.radio.path_loss import RadioEnvironment
from mdrive_sumo.v2x.radio.radio_settings import RadioProfile

ERRORS = PacketErrorModel(RadioProfile.ITS_G5, RadioEnvironment.URBAN)
SIDELINK_ERRORS = PacketErrorModel(RadioProfile.LTE_V2X, RadioEnvironment.URBAN)
NOISE, SENSING = INTERFACES[RadioProfile.ITS_G5].noise_dbm, INTERFACES[RadioProfile.ITS_G5].sensing_dbm


def measure(
    power_dbm: list[list[float]], rate: list[float], size: list[float], *, sidelink: bool = False
) -> ChannelLoad:
    """The load of n stations that hear K with known powers."""
    power = np.array(power_dbm)
    picture = RadioPicture(power, np.zeros(power.shape, dtype=np.uint8), np.full(power.shape[1], True))
    compute, errors = (compute_sidelink_load, SIDELINK_ERRORS) if sidelink else (compute_itsg5_load, ERRORS)
    return compute(picture, OfferedTraffic(np.array(rate), np.array(size)), errors, NOISE, SENSING)


def test_the_normal_distribution() -> None:
    x = np.linspace(-5.0, 5.0, 41)
    assert compute_normal_cdf(x) == pytest.approx([0.5 * (1 + math.erf(v / math.sqrt(2))) for v in x], abs=1e-7)


@pytest.mark.parametrize(
    ("offered", "busy"), [(0.0, 0.0), (0.02, 0.02), (0.5, 0.398319), (1.0, 0.668744), (1.84, 0.84), (9.0, 0.84)]
)
def test_equation_35(offered: float, busy: float) -> None:
    """-0.2481 u² + 0.913 u + 0.003844, never more than u."""
    assert compress_load(np.array([offered]))[0] == pytest.approx(busy, abs=4e-4)


@pytest.mark.parametrize("share", [0.05, 0.3, 0.8, 1.3, 1.7])
def test_reserved_resources_are_equation_29_for_many(share: float) -> None:
    """Ne = S/2 + sum over k to S/2 of max(1 - k / (N - S/2), 0), with N resources and S senders in reach."""
    resources = 200_000
    half = round(share * resources / 2)
    k = np.arange(1, half + 1)
    excluded = half + np.maximum(1 - k / (resources - half), 0).sum()
    assert spread_reservations(np.array([share]))[0] == pytest.approx(excluded / resources, abs=1e-4)


def test_a_hidden_station_spoils_and_occupies() -> None:
    """Stations 0 and 1 hear each other and 1 hears 2 (-70 dBm), 0 does not (-120 dBm): all by hand."""
    power = [[0.0, -75.0, -120.0], [-75.0, 0.0, -70.0], [-120.0, -70.0, 0.0]]
    load = measure(power, [10.0, 10.0, 25.0], [4e-4, 4e-4, 6e-4])
    assert load.busy_ratio == pytest.approx(compress_load(np.array([0.004, 0.004 + 0.015, 0.004])))
    lost = interpolate(ERRORS.blurred, BLUR_FIRST_DB, np.array([-75.0 + 70.0 - 1e-2]), np.zeros(1, dtype=np.uint8))[
        0
    ]  # SINR -5 dB
    assert load.collision_per_second[0, 1] == pytest.approx(25.0 * lost, rel=0.01)
    assert load.collision_per_packet[0, 1] == 0.0  # station 1 notices what has begun before
    assert load.busy_per_packet[0, 1] == pytest.approx(25.0 * 6e-4, rel=0.01)
    assert load.half_duplex_per_packet[0, 1] == pytest.approx(13e-6 * 10.0, rel=0.02)  # only in the same slot
    assert load.half_duplex_per_second[0, 2] == pytest.approx(25.0)  # they do not hear each other


def test_a_station_that_all_hear_waits() -> None:
    power = [[0.0, -75.0, -75.0], [-75.0, 0.0, -75.0], [-75.0, -75.0, 0.0]]
    load = measure(power, [10.0] * 3, [4e-4] * 3)
    assert load.collision_per_second.max() == load.busy_per_packet.max() == 0.0
    assert 0.0 < load.collision_per_packet[0, 1] <= 13e-6 * 10.0 * 1.01


def test_reservations_of_lte_v2x_collide_as_in_step_2() -> None:
    """All hear all: p = (1 / 10) Ca / Na² per resource of the interferer, with Ca = Na = N (1 - e)."""
    power = [[0.0, -70.0, -70.0], [-70.0, 0.0, -70.0], [-70.0, -70.0, 0.0]]
    load = measure(power, [10.0] * 3, [1.0] * 3, sidelink=True)
    resources, excluded = 500, 2 / 500
    assert load.busy_ratio == pytest.approx([spread_reservations(np.array([excluded]))[0]] * 3)
    lost = interpolate(SIDELINK_ERRORS.blurred, BLUR_FIRST_DB, np.array([0.0]), np.zeros(1, dtype=np.uint8))[0]
    assert load.collision_per_packet[0, 1] == pytest.approx(0.1 / resources * lost, rel=0.02)
    assert load.half_duplex_per_packet[0, 1] == pytest.approx(0.01)  # one of a hundred subframes


LEVELS = st.lists(st.floats(-120.0, -40.0), min_size=15, max_size=15)


@given(LEVELS, st.booleans(), st.integers(0, 4))
def test_silence_costs_nothing_and_more_traffic_never_less(levels: list[float], sidelink: bool, louder: int) -> None:
    power = np.zeros((3, 5))
    power[np.triu_indices(3, 1)] = levels[:3]
    power[:, :3] += power[:, :3].T
    power[:, 3:] = np.array(levels[3:9]).reshape(3, 2)
    silent = measure(power.tolist(), [0.0] * 5, [0.0] * 5, sidelink=sidelink)
    rate = [10.0] * 5
    some = measure(power.tolist(), rate, [1.0 if sidelink else 1e-3] * 5, sidelink=sidelink)
    rate[louder] += 10.0
    more = measure(power.tolist(), rate, [1.0 if sidelink else 1e-3] * 5, sidelink=sidelink)
    for name in ChannelLoad.__slots__:
        least, middle, most = (getattr(load, name) for load in (silent, some, more))
        assert (least == 0.0).all(), name
        if not (sidelink and name.startswith("collision")):  # there, what is reserved is also what others leave out
            assert (most >= middle - 1e-15).all(), name
