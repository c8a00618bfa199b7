"""Errors of a camera: an image is darker towards its corners, and its values are noisy.

In whole numbers, so that all machines agree. The noise has the same strength in dark and bright places: photons
scatter by the square root of their number, and the curve by which cameras encode brightness is nearly that root.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from mdrive_sumo.core.compiled import twin
from mdrive_sumo.core.geometry import Int
from mdrive_sumo.sensing.lidar_returns import draw_bits

Bytes = npt.NDArray[np.uint8]
TABLE_SIZE = 1 << 16
"""Rows of images begin at random places of a table with so many draws: a draw for each value costs more than it."""
DRAW_ZERO = 128
"""The draw that stands for 0."""
MOST_VALUES = 9000
"""Values in the longest row: 3000 pixels."""
SPREAD = 209.02
"""Standard deviation of the sum of eight bytes, whose mean is 1020: a nearly normal number."""


@dataclass(frozen=True, slots=True)
class ImageErrors:
    """How far a camera's images are from what they show."""

    noise: float
    """Standard deviation of each value, as a share of 255."""
    vignetting: float
    """Share of the light that is missing in the corners; it grows with the square of the distance from the middle."""

    def spoil(self, image: Bytes, seed: int, tick: int) -> Bytes:
        """Return an image (H, W, 3) with errors, which depend on the seed, the tick and the pixel only."""
        if not self.noise and not self.vignetting:
            return image
        height, width, _ = image.shape
        starts = (draw_bits((seed << 21) + tick, height) % np.uint64(TABLE_SIZE)).astype(np.int64)
        return add_errors(image, _build_gain(height, width, self.vignetting), _build_draws(self.noise), starts)


@lru_cache(maxsize=32)
def _build_gain(height: int, width: int, vignetting: float) -> Bytes:
    """Return what share of the light arrives at each value (H, W, 3): 256ths, less one."""
    rows, columns = np.ogrid[:height, :width]
    down, aside = rows - (height - 1) / 2, columns - (width - 1) / 2
    share = (down * down + aside * aside) / ((height * height + width * width) / 4)
    gain = np.floor(255.0 - 256.0 * vignetting * share + 0.5).astype(np.uint8)
    return np.repeat(gain[:, :, None], 3, axis=2)


@lru_cache(maxsize=8)
def _build_draws(noise: float) -> Bytes:
    """Return normal draws (TABLE_SIZE + MOST_VALUES,) as differences of values, added to DRAW_ZERO."""
    sums = draw_bits(0, TABLE_SIZE + MOST_VALUES).view(np.uint8).reshape(-1, 8).astype(np.int64).sum(axis=1)
    steps = np.floor((sums - 1020) * (255.0 * noise / SPREAD) + 0.5) + DRAW_ZERO
    return np.clip(steps, 0, 255).astype(np.uint8)


@twin
def add_errors(image: Bytes, gain: Bytes, draws: Bytes, starts: Int, /) -> Bytes:
    """Return an image (H, W, 3) with errors.

    gain: (H, W, 3) share of light, in 256ths less one. draws: differences of values, added to DRAW_ZERO. starts: (H,)
    where each row's draws begin. Raises ValueError for arrays that do not fit.
    """
    if image.ndim != 3 or gain.shape != image.shape or starts.shape != image.shape[:1]:
        raise ValueError("expected an image (H, W, 3), a gain for each value and a start for each row")
    values = image.shape[1] * image.shape[2]
    if np.any(starts < 0) or np.any(starts > len(draws) - values):
        raise ValueError("expected starts that there are draws for")
    lit = (image.astype(np.int64) * (gain.astype(np.int64) + 1)) >> 8
    noise = draws[starts[:, None] + np.arange(values)].reshape(image.shape).astype(np.int64) - DRAW_ZERO
    return np.clip(lit + noise, 0, 255).astype(np.uint8)
