"""Packet errors, packets of a message, airtime and sub-channels."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mdrive_sumo.v2x.radio.air_interface import INTERFACES, list_blocks, split_message
from mdrive_sumo.v2x.radio.packet_error import BLUR_FIRST_DB, PacketErrorModel, interpolate
from mdrive_sumo.v2x.radio.path_loss import LinkClass, RadioEnvironment
from mdrive_sumo.v2x.radio.radio_settings import RadioProfile

G5, LTE = RadioProfile.ITS_G5, RadioProfile.LTE_V2X
MODELS = {
    (profile, environment): PacketErrorModel(profile, environment)
    for profile in RadioProfile
    for environment in RadioEnvironment
}
ANY_MODEL = st.sampled_from(sorted(MODELS))
SINR_DB = st.floats(-40.0, 60.0)


def error_rate(profile: RadioProfile, environment: str, kind: LinkClass, sinr_db: float, size: int = 350) -> float:
    model = MODELS[profile, RadioEnvironment(environment)]
    return float(model.compute(np.array([sinr_db]), np.array([kind], dtype=np.uint8), size)[0])


@pytest.mark.parametrize(
    ("profile", "environment", "kind", "sinr_db", "expected"),
    [
        (G5, "urban", LinkClass.LOS, 2.0, 0.4598),
        (G5, "urban", LinkClass.LOS, 2.5, (0.4598 + 0.22) / 2),
        (G5, "urban", LinkClass.NLOSB, 4.0, 0.5012),
        (G5, "urban", LinkClass.NLOSV, 5.0, 0.4328),
        (G5, "highway", LinkClass.LOS, 1.0, 0.5076),
        (LTE, "urban", LinkClass.LOS, 3.0, 0.4532),
        (LTE, "highway", LinkClass.LOS, 2.25, (0.5016 + 0.376) / 2),
        (LTE, "urban", LinkClass.NLOSB, 5.0, 0.5342),
        (LTE, "highway", LinkClass.NLOSV, 5.5, 0.5694),
        (G5, "urban", LinkClass.LOS, -2.01, 1.0),
        (G5, "urban", LinkClass.LOS, 12.0, 0.0),
        (LTE, "highway", LinkClass.NLOSV, 40.0, 0.0),
    ],
)
def test_the_published_curves(
    profile: RadioProfile, environment: str, kind: LinkClass, sinr_db: float, expected: float
) -> None:
    assert error_rate(profile, environment, kind, sinr_db) == pytest.approx(expected, abs=1e-12)


def test_bytes_fail_independently() -> None:
    once = error_rate(G5, "urban", LinkClass.LOS, 3.0)
    assert error_rate(G5, "urban", LinkClass.LOS, 3.0, 700) == pytest.approx(1 - (1 - once) ** 2)
    assert error_rate(G5, "urban", LinkClass.LOS, 3.0, 35) == pytest.approx(1 - (1 - once) ** 0.1)


@given(ANY_MODEL, st.sampled_from(LinkClass), SINR_DB, st.floats(0.0, 30.0), st.integers(1, 1600), st.integers(0, 500))
def test_a_stronger_signal_or_a_smaller_packet_is_never_lost_more(
    model: tuple[RadioProfile, RadioEnvironment],
    kind: LinkClass,
    sinr_db: float,
    more_db: float,
    size: int,
    bytes_more: int,
) -> None:
    profile, environment = model
    rate = error_rate(profile, environment, kind, sinr_db, size)
    assert 0.0 <= rate <= 1.0
    assert error_rate(profile, environment, kind, sinr_db + more_db, size) <= rate + 1e-12
    assert error_rate(profile, environment, kind, sinr_db, size + bytes_more) >= rate - 1e-12


def test_the_blurred_curve_is_the_mean_over_the_shadowing_of_an_interferer() -> None:
    kinds = np.zeros(20_001, dtype=np.uint8)
    offsets = np.random.default_rng(1).normal(0.0, 3.0, len(kinds))
    model = MODELS[G5, RadioEnvironment.URBAN]
    for sinr_db in (-5.0, 1.75, 6.0):
        expected = model.compute(sinr_db + offsets, kinds, 350).mean()
        blurred = interpolate(model.blurred, BLUR_FIRST_DB, np.array([sinr_db]), kinds[:1])[0]
        assert blurred == pytest.approx(expected, abs=0.012)


@pytest.mark.parametrize(
    ("payload", "packets"),
    [(0, (177,)), (1, (178,)), (1398, (1575,)), (1399, (1575, 178)), (20_000, (*[1575] * 14, 605))],
)
def test_a_message_is_cut_into_packets_of_1398_bytes(payload: int, packets: tuple[int, ...]) -> None:
    assert split_message(payload, INTERFACES[G5].header_bytes) == packets


@pytest.mark.parametrize(
    ("size", "microseconds"),
    [(350, 512), (206, 320), (1575, 2144)],  # 40 + 8 x ceil((22 + 8 size) / 48)
)
def test_airtime_at_6_mbit_s(size: int, microseconds: int) -> None:
    assert INTERFACES[G5].measure_airtime(size) == pytest.approx(microseconds * 1e-6)


def test_access_waits_for_the_idle_share_of_the_channel() -> None:
    assert INTERFACES[G5].measure_access(0.0) == pytest.approx(32e-6 + 6 * 13e-6 + 7.5 * 13e-6)
    assert INTERFACES[G5].measure_access(0.75) == pytest.approx(4 * INTERFACES[G5].measure_access(0.0))


@pytest.mark.parametrize(
    ("size", "blocks"),
    [(121, (1,)), (122, (2,)), (277, (2,)), (421, (3,)), (749, (5,)), (750, (5, 1)), (1544, (5, 5, 1))],
)
def test_transport_blocks_of_lte_v2x(size: int, blocks: tuple[int, ...]) -> None:
    assert list_blocks(size) == blocks
    assert INTERFACES[LTE].measure_airtime(size) == pytest.approx(1e-3 * len(blocks))
