"""The compiled parts of the radio against the Python text."""

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from testing.twins import compare_twins, get_compiled

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.v2x.radio.packet_error import BLUR_FIRST_DB, FIRST_DB, PacketErrorModel
from mdrive_sumo.v2x.radio.path_loss import LOSS_FORMULAS, Classes, RadioEnvironment
from mdrive_sumo.v2x.radio.radio_medium import AirBill, AirLink, RadioLoss, Transmission
from mdrive_sumo.v2x.radio.radio_settings import RadioProfile
from mdrive_sumo.v2x.radio.shadowing import draw_waves

ENVIRONMENTS, PROFILES = st.sampled_from(RadioEnvironment), st.sampled_from(RadioProfile)
SEEDS = st.integers(0, 10**6)
POWER_TWIN = "v2x_radio_received_power_compute_received_power"


@dataclass(frozen=True)
class Heard:
    """Made-up stations: n of them hear all."""

    xy: Float
    height: Float
    classes: Classes
    blocker: Float
    power: Float
    rng: np.random.Generator


def make_up(seed: int) -> Heard:
    """Levels from far below the noise to above any; symmetric among stations."""
    rng = np.random.default_rng(seed)
    n, total = int(rng.integers(1, 6)), int(rng.integers(6, 30))
    classes = rng.integers(0, 3, (n, total)).astype(np.uint8)
    blocker = np.where(classes == 1, rng.choice([1.5, 2.2, 3.4], (n, total)), 0.0)
    power = rng.choice([rng.uniform(-130.0, 10.0, (n, total)), np.full((n, total), -85.0)])
    for square in (classes, blocker, power):
        square[:, :n] = np.triu(square[:, :n]) + np.triu(square[:, :n], 1).T
    return Heard(
        rng.uniform(-600, 600, (total, 2)), rng.choice([1.5, 2.2, 3.4, 5.0], total), classes, blocker, power, rng
    )


@given(SEEDS, ENVIRONMENTS, st.booleans())
def test_received_power(seed: int, environment: RadioEnvironment, has_corners: bool) -> None:
    heard, formulas = make_up(seed), LOSS_FORMULAS[environment]
    n = len(heard.classes)
    around = np.where(heard.rng.random((n, n)) < 0.5, np.nan, heard.rng.uniform(60.0, 140.0, (n, n)))
    waves = draw_waves(seed, "shadowing", 10.0), draw_waves(seed, "blockage", 10.0)
    scene = heard.xy, heard.height, heard.classes, heard.blocker, around if has_corners else None
    compare_twins(POWER_TWIN, *scene, formulas, *waves, 29.0)
    compare_twins(POWER_TWIN, heard.xy * np.nan, *scene[1:], formulas, *waves, 29.0)


@pytest.mark.parametrize("name", ["itsg5", "sidelink"])
@given(SEEDS, ENVIRONMENTS, PROFILES, st.sampled_from([0.0, -4000.0, 4000.0]))
def test_load(name: str, seed: int, environment: RadioEnvironment, profile: RadioProfile, more_db: float) -> None:
    heard, errors = make_up(seed), PacketErrorModel(profile, environment)
    total = heard.classes.shape[1]
    is_known = (np.arange(total) < len(heard.classes)) | (heard.rng.random(total) < 0.2)
    rate = heard.rng.uniform(0.0, 12.0, total) * (heard.rng.random(total) < 0.8)
    size = heard.rng.uniform(0.0, 3e-3, total) if name == "itsg5" else heard.rng.integers(1, 6, total).astype(float)
    curves = errors.blurred, BLUR_FIRST_DB
    compare_twins(
        f"v2x_radio_channel_load_sum_{name}_risks",
        *(heard.power + more_db, heard.classes, is_known, rate, size, *curves, -95.0, -85.0),
    )


@given(SEEDS, ENVIRONMENTS, PROFILES, st.lists(st.sampled_from([0.0, 0.3, 0.99, 1.0]), max_size=5))
def test_losses(seed: int, environment: RadioEnvironment, profile: RadioProfile, lucks: list[float]) -> None:
    heard, errors = make_up(seed), PacketErrorModel(profile, environment)
    n = len(heard.classes)
    columns = {f"cav_{i}": i for i in range(n)}
    messages = [
        Transmission(name, 100, tuple(columns)[: len(lucks)], tuple(lucks[:n])) for name in [*columns, *columns]
    ]
    bills = [AirBill((), (), *heard.rng.uniform(0.1, 9.0, 4).tolist()) for _ in messages]
    compare_twins(
        "v2x_radio_radio_medium_find_losses",
        *(messages, bills, columns, tuple(RadioLoss), heard.power, heard.classes),
        *(errors.curves, FIRST_DB, -95.0, *heard.rng.uniform(0.0, 0.1, (5, n, n))),
    )


@given(SEEDS)
def test_links(seed: int) -> None:
    heard = make_up(seed)
    stations = tuple(f"cav_{i}" for i in range(len(heard.classes)))
    known: dict[int, AirLink] = {}
    links = compare_twins("v2x_radio_radio_medium_list_links", stations, heard.classes, heard.power, known)
    assert [list(others) for others in links.values()] == [[o for o in stations if o != one] for one in stations]
    assert {link for others in links.values() for link in others.values()} == set(known.values())


@pytest.mark.parametrize("wrong", range(9))
def test_wrong_arguments_are_refused(wrong: int) -> None:
    heard = make_up(1)
    waves = draw_waves(1, "shadowing", 10.0), draw_waves(1, "blockage", 10.0)
    scene = heard.xy, heard.height, heard.classes, heard.blocker, np.zeros((len(heard.classes),) * 2)
    arguments: list[object] = [*scene, LOSS_FORMULAS[RadioEnvironment.URBAN], *waves, 29.0]
    arguments[wrong] = np.full((2, 2, 2), 7) if wrong < 8 else float("inf")
    with pytest.raises((ValueError, TypeError)):
        get_compiled(POWER_TWIN)(*arguments)
