"""Prices of sensors: sums, limits, and what a participant reads."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mdrive_sumo.contract import SensorSpec
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.runs.open_agents import MAX_ARRAY_SENSORS
from mdrive_sumo.sensing.sensor_kinds import BUDGET_MS, check_sensor_budget, price_sensor


def bev(**options: float | str | bool) -> SensorSpec:
    return SensorSpec("bev", id=str(options), options=options)


def lidar(**options: float | str | bool) -> SensorSpec:
    return SensorSpec("lidar", id=str(options), options=options)


ACCEPTED = {
    "all of the paper's views": tuple(bev(profile=name) for name in ("default", "tcp", "b2d", "perception-swap")),
    "the largest raster, a LiDAR and objects": (bev(size=1024), lidar(), SensorSpec("objects")),
    "LiDARs": tuple(SensorSpec("lidar", id=str(n)) for n in range(7)),
    "a LiDAR that leans": (lidar(pitch_deg=5.0), SensorSpec("objects"), bev(), SensorSpec("gnss")),
    "nothing": (),
}
REFUSED = {
    "the attack": tuple(SensorSpec("bev", id=str(n), options={"size": 1024}) for n in range(8)),
    "two of the largest": (bev(size=1024), bev(size=1024.0, metres_per_pixel=1.0)),
    "two that lean": (lidar(pitch_deg=5.0), lidar(roll_deg=-1)),
    "a size that is no number": (bev(size="large"), bev(size="larger")),
    "a size out of range": (bev(size=1e9), bev(size=float("nan"))),
}


@pytest.mark.parametrize("name", ACCEPTED)
def test_what_agents_use_is_within_the_budget(name: str) -> None:
    check_sensor_budget(ACCEPTED[name])


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_too_dear_is_refused_in_one_sentence(name: str) -> None:
    with pytest.raises(InputError) as caught:
        check_sensor_budget(REFUSED[name])
    sentence = str(caught.value)
    assert sentence.startswith("sensors: expected a price of at most 40 ms a tick") and "\n" not in sentence
    assert f"{sum(map(price_sensor, REFUSED[name])):.1f} ms for {len(REFUSED[name])} sensors" in sentence


@given(st.integers(16, 1024), st.integers(16, 1024))
def test_more_pixels_cost_more(first: int, second: int) -> None:
    assert (price_sensor(bev(size=first)) < price_sensor(bev(size=second))) == (first < second)


def test_as_many_sensors_as_are_allowed_stay_within_a_tick() -> None:
    """Eight CAVs of the budget: a third of a second a tick at most; the attack took 1.5 s."""
    assert 8 * BUDGET_MS <= 350
    assert MAX_ARRAY_SENSORS * price_sensor(bev(size=16)) < BUDGET_MS
    assert price_sensor(lidar(profile="lmdrive")) < 2 * price_sensor(lidar())  # a scan every second tick
    assert price_sensor(lidar(every_ticks=4)) == price_sensor(lidar()) / 4
    assert price_sensor(lidar(every_ticks=math.inf)) == price_sensor(lidar())  # it is refused
    assert price_sensor(lidar(hit_ids=True)) > price_sensor(lidar(hit_ids=False))
