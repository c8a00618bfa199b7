"""Path loss and shadowing: values by hand, closed forms, and the statistics of the field."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mdrive_sumo.v2x.radio.path_loss import (
    LOSS_FORMULAS,
    WAVELENGTH_M,
    LinkClass,
    RadioEnvironment,
    compute_blockage_mean,
    compute_corner_loss,
    compute_path_loss,
    find_blockage_sigma,
)
from mdrive_sumo.v2x.radio.shadowing import draw_waves, evaluate_field

URBAN, HIGHWAY = RadioEnvironment.URBAN, RadioEnvironment.HIGHWAY
LOS, NLOSV, NLOSB = LinkClass.LOS, LinkClass.NLOSV, LinkClass.NLOSB


@pytest.mark.parametrize(
    ("environment", "kind", "distance", "loss_db"),
    [
        (URBAN, LOS, 100.0, 86.19951),  # 38.77 + 16.7 x 2 + 18.2 x 0.7708520
        (URBAN, NLOSV, 10.0, 69.49951),
        (URBAN, NLOSB, 100.0, 111.41910),  # 36.85 + 30 x 2 + 18.9 x 0.7708520
        (HIGHWAY, LOS, 100.0, 87.81704),  # 32.4 + 20 x 2 + 20 x 0.7708520
        (HIGHWAY, NLOSB, 10.0, 81.41910),
        (HIGHWAY, LOS, 0.0, 47.81704),  # as at 1 m
    ],
)
def test_the_formulas_of_tr_37885(
    environment: RadioEnvironment, kind: LinkClass, distance: float, loss_db: float
) -> None:
    loss = compute_path_loss(LOSS_FORMULAS[environment], np.array([kind], dtype=np.uint8), np.array([distance]))
    assert loss[0] == pytest.approx(loss_db, abs=1e-5)


@given(st.floats(1.0, 3000.0))
def test_the_highway_is_free_space(distance: float) -> None:
    friis_db = 20 * math.log10(4 * math.pi * distance / WAVELENGTH_M)
    loss = compute_path_loss(LOSS_FORMULAS[HIGHWAY], np.array([LOS], dtype=np.uint8), np.array([distance]))
    assert loss[0] == pytest.approx(friis_db, abs=0.06)  # the TR rounds 32.45 to 32.4


@pytest.mark.parametrize(
    ("distance", "low", "high", "blocker", "mean_db", "sigma_db"),
    [
        (100.0, 1.5, 1.5, 3.4, 9.0, 4.5),
        (1000.0, 1.5, 1.5, 3.4, 13.0, 4.5),  # 9 + 15 x 3 - 41
        (1000.0, 1.5, 3.4, 2.2, 9.0, 4.0),
        (100.0, 1.5, 1.5, 1.5, 5.0, 4.0),  # a car behind a car: neither above nor below
        (100.0, 3.4, 3.4, 1.5, 0.0, 0.0),
    ],
)
def test_the_loss_of_a_vehicle_in_between(
    distance: float, low: float, high: float, blocker: float, mean_db: float, sigma_db: float
) -> None:
    heights = np.array([low]), np.array([high]), np.array([blocker])
    assert compute_blockage_mean(np.array([distance]), *heights)[0] == pytest.approx(mean_db)
    assert find_blockage_sigma(*heights)[0] == sigma_db


@pytest.mark.parametrize("rx_corner_m", [20.0, 60.0, 177.0, 178.0, 300.0])
def test_the_corner_model_is_virtual_source_11p(rx_corner_m: float) -> None:
    break_m = 4 * 1.5 * 1.5 / WAVELENGTH_M  # 177.1 m
    far = rx_corner_m if rx_corner_m <= break_m else rx_corner_m**2 / break_m
    inner = 30.0**0.957 / (12.0 * 24.0) ** 0.81 * 4 * math.pi * far / WAVELENGTH_M
    loss = compute_corner_loss(30.0, rx_corner_m, 24.0, 12.0, height_m=1.5, suburban=False)
    assert loss == pytest.approx(3.75 + 10 * math.log10(inner**2.69), abs=1e-9)
    assert compute_corner_loss(30.0, rx_corner_m, 24.0, 12.0, height_m=1.5, suburban=True) - loss == pytest.approx(2.94)


def test_shadowing_has_unit_variance_and_the_decorrelation_distance() -> None:
    """Over 600 seeds: mean 0, variance 1, correlation exp(-1) after one station moved 10 m, exp(-2) after both did."""
    first, second = np.array([[0.0, 0.0]]), np.array([[60.0, 20.0]])
    values = np.array(
        [
            [
                evaluate_field(waves, first, second)[0],
                evaluate_field(waves, first + np.array([10.0, 0.0]), second)[0],
                evaluate_field(waves, first + np.array([0.0, 10.0]), second + np.array([6.0, 8.0]))[0],
            ]
            for waves in (draw_waves(seed, "shadowing", 10.0) for seed in range(600))
        ]
    )
    assert np.abs(values.mean(axis=0)).max() < 0.12
    assert values.std(axis=0) == pytest.approx(np.ones(3), abs=0.1)
    correlations = np.corrcoef(values.T)[0, 1:]
    assert correlations == pytest.approx(np.exp([-1.0, -2.0]), abs=0.1)


def test_a_value_of_the_field_depends_on_its_own_pair_only() -> None:
    waves, places = draw_waves(3, "shadowing", 25.0), np.array([[1.0, 2.0], [30.0, -4.0], [7.0, 500.0]])
    together = evaluate_field(waves, places, places[::-1])
    alone = [evaluate_field(waves, places[i : i + 1], places[::-1][i : i + 1])[0] for i in range(3)]
    assert together.tolist() == alone
    other = evaluate_field(draw_waves(4, "shadowing", 25.0), places, places[::-1])
    assert together.tolist() != other.tolist()
