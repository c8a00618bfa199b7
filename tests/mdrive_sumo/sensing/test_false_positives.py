"""False positives: those of single cells, whatever is drawn together."""

import math

from hypothesis import given
from hypothesis import strategies as st

from mdrive_sumo.contract.detector_profiles import FAR_M, PROFILES
from mdrive_sumo.core.geometry import TAU
from mdrive_sumo.core.seeding import draw_first_uniform, draw_uniforms
from mdrive_sumo.sensing.detection_noise import CELL_M, EPOCH_TICKS, draw_false_positives

PROFILE = max(PROFILES.values(), key=lambda profile: profile.false_positives)
Row = tuple[str, float, float, float]


def draw_in_cell(seed: int, tick: int, i: int, j: int) -> list[Row]:
    cell = f"{i} {j}"
    epoch = (tick + int(draw_uniforms(seed, "phase", cell)[0] * EPOCH_TICKS)) // EPOCH_TICKS
    luck, x, y, yaw, *_ = draw_uniforms(seed, "ghost", cell, epoch)
    if luck >= PROFILE.false_positives / (math.pi * (FAR_M * FAR_M)) * (CELL_M * CELL_M):
        return []
    return [(f"ghost {cell} {epoch}", (i + x) * CELL_M, (j + y) * CELL_M, (yaw - 0.5) * TAU)]


@given(st.integers(0, 1000), st.integers(0, 400), st.integers(-300, 300), st.integers(-300, 300))
def test_each_cell_is_drawn_by_itself(seed: int, tick: int, x: int, y: int) -> None:
    range_m = 200.0
    low, high = (int((min(x, y) - range_m) // CELL_M), int((max(x, y) + range_m) // CELL_M))
    rows = [row for i in range(low, high + 1) for j in range(low, high + 1) for row in draw_in_cell(seed, tick, i, j)]
    near = [row for row in rows if math.sqrt((row[1] - x) * (row[1] - x) + (row[2] - y) * (row[2] - y)) <= range_m]
    found = draw_false_positives(PROFILE, seed, tick, (float(x), float(y)), range_m)
    assert [(one.id, one.x, one.y, one.yaw) for one in found] == near


def test_the_first_number_is_that_of_all() -> None:
    assert draw_first_uniform(3, "ghost", 7) == draw_uniforms(3, "ghost", 7)[0]
