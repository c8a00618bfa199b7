"""Random numbers by purpose: the same bits from the Python text and from the compiled layer."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from testing.twins import compare_twins

from mdrive_sumo.core.seeding import UNIFORMS, draw_first_uniform, draw_normals, draw_uniforms
from mdrive_sumo.v2x.channel import DeliveryStatus

DRAWS = ("draw_uniforms", "draw_first_uniform", "draw_normals")
PARTS = st.one_of(st.text(max_size=300), st.integers(), st.booleans(), st.sampled_from(DeliveryStatus))


@pytest.mark.parametrize("name", DRAWS)
@given(seed=st.integers(), purpose=st.lists(PARTS, max_size=4))
def test_both_texts_draw_the_same(name: str, seed: int, purpose: list[str | int]) -> None:
    compare_twins(f"core_seeding_{name}", seed, *purpose)


@pytest.mark.parametrize("name", DRAWS)
def test_texts_of_all_lengths_around_a_block_of_the_hash(name: str) -> None:
    for length in (*range(124, 131), 254, 255, 256, 1000):
        compare_twins(f"core_seeding_{name}", 7, "x" * (length - 2))


@pytest.mark.parametrize("name", DRAWS)
def test_text_that_has_no_bytes_is_refused(name: str) -> None:
    assert isinstance(compare_twins(f"core_seeding_{name}", 0, "\ud800"), tuple)


def test_first_uniform_is_that_of_all() -> None:
    assert draw_first_uniform(3, "miss", "car", 2) == draw_uniforms(3, "miss", "car", 2)[0]
    assert draw_uniforms(3, "miss", "car", 2) != draw_uniforms(3, "miss", "car", 3)


def test_numbers_are_spread_as_they_should_be() -> None:
    normals = np.array([draw_normals(0, "n", tick) for tick in range(4000)])
    assert normals.shape == (4000, UNIFORMS)
    assert np.abs(normals.mean(axis=0)).max() < 0.06
    assert np.abs(normals.std(axis=0) - 1).max() < 0.05
    assert np.abs(np.corrcoef(normals.T) - np.eye(UNIFORMS)).max() < 0.06
