"""Antialiasing and camera errors: the compiled functions against the Python text, and what they do to images."""

from hashlib import blake2b

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from testing.twins import compare_twins

from mdrive_sumo.sensing.camera.edge_smoothing import smooth_edges
from mdrive_sumo.sensing.camera.image_errors import ImageErrors, add_errors

Bytes = npt.NDArray[np.uint8]
DIGEST = "1a21078128c89158"
"""Of the image of `test_digest_of_a_spoilt_image`: whole numbers, so the same on all machines."""


def draw_disc(height: int = 40, width: int = 60) -> Bytes:
    rows, columns = np.ogrid[:height, :width]
    image = np.full((height, width, 4), 40, dtype=np.uint8)
    image[(rows - 18) ** 2 + 2 * (columns - 30) ** 2 < 200] = (220, 180, 60, 0)
    return image


@given(seed=st.integers(0, 2**32 - 1), size=st.tuples(st.integers(0, 20), st.integers(0, 20)), is_rough=st.booleans())
def test_any_image_is_smoothed_alike(seed: int, size: tuple[int, int], is_rough: bool) -> None:
    random = np.random.default_rng(seed)
    image = random.integers(0, 256, (*size, 4), dtype=np.uint8)
    if not is_rough:
        image = (image > 200).astype(np.uint8) * np.uint8(200)
    smooth = compare_twins("sensing_camera_edge_smoothing_smooth_edges", image)
    assert smooth.shape == (*size, 3)
    if size[0] > 2 and size[1] > 2:
        assert (smooth[0] == image[0, :, :3]).all() and (smooth[:, -1] == image[:, -1, :3]).all()


def test_images_of_another_shape_are_refused() -> None:
    with pytest.raises(ValueError, match=r"\(H, W, 4\)"):
        smooth_edges(np.zeros((4, 4, 3), dtype=np.uint8))


def test_a_leaning_edge_gets_steps_between_its_sides_and_an_upright_one_stays() -> None:
    rows, columns = np.mgrid[:24, :64]
    image = np.where((8 * rows > columns + 60)[..., None], 200, 20).astype(np.uint8).repeat(4, axis=2)
    smooth = smooth_edges(image)
    middle = smooth[2:-2, 8:-8]
    assert len(np.unique(middle)) > 5
    # The brightness along the edge is nearer to that of the share of each pixel that is covered.
    covered = np.clip((8 * rows - columns - 60 + 4) / 8, 0, 1) * 180 + 20
    before, after = (np.abs(part[2:-2, 8:-8, 0] - covered[2:-2, 8:-8]).sum() for part in (image.astype(float), smooth))
    assert after < 0.75 * before
    upright = np.where((columns > 30)[..., None], 200, 20).astype(np.uint8).repeat(4, axis=2)
    assert (smooth_edges(upright) == upright[:, :, :3]).all()


@given(seed=st.integers(0, 2**32 - 1), rows=st.integers(0, 6), columns=st.integers(0, 9))
def test_any_errors_are_alike(seed: int, rows: int, columns: int) -> None:
    random = np.random.default_rng(seed)
    image, gain = random.integers(0, 256, (2, rows, columns, 3), dtype=np.uint8)
    draws, starts = random.integers(0, 256, 64, dtype=np.uint8), random.integers(0, 64 - 3 * columns + 1, rows)
    found = compare_twins("sensing_camera_image_errors_add_errors", image, gain, draws, starts)
    assert found.shape == image.shape


@pytest.mark.parametrize("start", [-1, 3])
def test_starts_without_draws_are_refused(start: int) -> None:
    image = np.zeros((1, 2, 3), dtype=np.uint8)
    with pytest.raises(ValueError, match="starts that there are draws for"):
        add_errors(image, image, np.zeros(8, dtype=np.uint8), np.array([start]))


def test_noise_is_normal_as_strong_as_declared_and_new_in_every_tick() -> None:
    grey = np.full((200, 300, 3), 128, dtype=np.uint8)
    first, again, later, other = (
        ImageErrors(0.02, 0.0).spoil(grey, *key).astype(float) - 128 for key in ((5, 0), (5, 0), (5, 1), (6, 0))
    )
    assert (first == again).all()
    for noise in (first, later, other):
        assert (noise.mean(), noise.std()) == (pytest.approx(0.0, abs=0.05), pytest.approx(5.1, rel=0.03))
        assert (np.abs(noise) < 5.5).mean() == pytest.approx(0.719, abs=0.02)  # 5.5 is 1.08 standard deviations
    assert abs(np.corrcoef(first.ravel(), later.ravel())[0, 1]) < 0.02
    assert abs(np.corrcoef(first.ravel(), other.ravel())[0, 1]) < 0.02
    assert abs(np.corrcoef(first[:, :-1].ravel(), first[:, 1:].ravel())[0, 1]) < 0.02


def test_corners_lack_the_declared_share_of_light() -> None:
    grey = np.full((120, 200, 3), 200, dtype=np.uint8)
    shown = ImageErrors(0.0, 0.3).spoil(grey, 1, 2)
    assert shown[60, 100].tolist() == pytest.approx([200] * 3, abs=1)
    assert shown[0, 0].tolist() == pytest.approx([140] * 3, abs=2)
    assert shown[60, 0, 0] == pytest.approx(200 * (1 - 0.3 * 100**2 / (100**2 + 60**2)), abs=2)
    assert ImageErrors(0.0, 0.0).spoil(grey, 1, 2) is grey


def test_digest_of_a_spoilt_image() -> None:
    image = ImageErrors(0.02, 0.25).spoil(smooth_edges(draw_disc()), 7, 3)
    assert blake2b(image.tobytes(), digest_size=8).hexdigest() == DIGEST
