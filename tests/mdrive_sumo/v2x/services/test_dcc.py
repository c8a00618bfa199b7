"""Congestion control against hand-computed steps, and its bounds for any load."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mdrive_sumo.v2x.services.dcc import DCC, AdaptiveDcc

CBR = st.floats(0.0, 1.0)


def test_two_steps_are_those_of_the_standard() -> None:
    dcc = AdaptiveDcc()
    dcc.update(0, 1.0, 1.0)
    # CBR = 0.25 * 2 = 0.5, offset = min(0.0012 * (0.68 - 0.5), 0.0005) = 0.000216
    assert dcc.delta == pytest.approx(0.984 * 0.03 + 0.000216)
    dcc.update(3, 1.0, 1.0)  # too early
    dcc.update(4, 1.0, 1.0)
    # CBR = 0.25 + 0.5 = 0.75, offset = max(0.0012 * (0.68 - 0.75), -0.00025) = -0.000084
    assert dcc.delta == pytest.approx(0.984 * (0.984 * 0.03 + 0.000216) - 0.000084)


def test_a_packet_closes_the_gate_for_its_share_of_the_air() -> None:
    dcc = AdaptiveDcc()
    assert dcc.is_open(0)
    dcc.record_packet(0, 0.003)  # 3 ms in 3 % of the time: 100 ms
    assert [dcc.is_open(tick) for tick in range(4)] == [False, False, True, True]
    assert (dcc.count_gap_ticks(1e-6), dcc.count_gap_ticks(1.0)) == (1, 20)


@given(st.lists(st.tuples(CBR, CBR), max_size=60))
def test_shares_stay_within_their_bounds(loads: list[tuple[float, float]]) -> None:
    dcc = AdaptiveDcc()
    for step, load in enumerate(loads):
        dcc.update(4 * step, *load)
        assert DCC.min_delta <= dcc.delta <= DCC.max_delta


@given(CBR, CBR, st.integers(1, 60))
def test_more_load_never_grants_more(first: float, second: float, steps: int) -> None:
    low, high = AdaptiveDcc(), AdaptiveDcc()
    for step in range(steps):
        low.update(4 * step, *(min(first, second),) * 2)
        high.update(4 * step, *(max(first, second),) * 2)
    assert high.delta <= low.delta
