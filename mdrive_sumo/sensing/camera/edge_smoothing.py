"""Smooth the edges of a drawn image, so that lines are no stairs: antialiasing after drawing.

As Lottes (FXAA, NVIDIA 2009) does it: where brightness jumps, the ends of the edge are looked for along it, and the
pixel is mixed with the one beyond by where it lies between them. In whole numbers, so that all machines agree. Four
samples a pixel took 2.2 times as long as one (docs/cameras.md).
"""

import numpy as np
import numpy.typing as npt

from mdrive_sumo.core.compiled import twin
from mdrive_sumo.core.geometry import Bool, Int

LEAST_JUMP = 21
"""Of 255: differences of brightness below, or below a sixth of the brightness, are no edge; values of Lottes."""
SEARCH_PX = 6
"""How far along an edge its ends are looked for, in pixels to each side."""
Bytes = npt.NDArray[np.uint8]


@twin
def smooth_edges(image: Bytes, /) -> Bytes:
    """Return an image (H, W, 4) as (H, W, 3), smoothed; the fourth channel means nothing. Raises ValueError."""
    if image.ndim != 3 or image.shape[2] != 4:
        raise ValueError("expected an image (H, W, 4)")
    smooth = image[:, :, :3].copy()
    wide = image.astype(np.int64)
    bright = (2 * wide[:, :, 0] + 5 * wide[:, :, 1] + wide[:, :, 2]) >> 3
    rows, columns = np.nonzero(_find_edges(bright))
    if len(rows):
        _mix(wide, bright, rows, columns, smooth)
    return smooth


def _find_edges(bright: Int) -> Bool:
    """Return which pixels (H, W) lie at an edge; those at the border of the image do not."""
    edges = np.zeros(bright.shape, dtype=np.bool_)
    if min(bright.shape) > 2:
        cross = np.stack((bright[1:-1, 1:-1], bright[:-2, 1:-1], bright[2:, 1:-1], bright[1:-1, :-2], bright[1:-1, 2:]))
        most = cross.max(axis=0)
        edges[1:-1, 1:-1] = most - cross.min(axis=0) >= np.maximum(LEAST_JUMP, (most >> 3) + (most >> 5))
    return edges


def _mix(wide: Int, bright: Int, rows: Int, columns: Int, smooth: Bytes) -> None:
    """Mix the pixels at these rows and columns with their neighbours across the edge."""
    height, width = bright.shape
    flat = bright.reshape(-1)
    at = rows * width + columns
    here, up, down, left, right = (flat[at + step] for step in (0, -width, width, -1, 1))
    corners = [flat[at + step] for step in (-width - 1, -width + 1, width - 1, width + 1)]
    across_rows = abs(corners[0] + corners[2] - 2 * left) + 2 * abs(up + down - 2 * here)
    across_rows += abs(corners[1] + corners[3] - 2 * right)
    across_columns = abs(corners[0] + corners[1] - 2 * up) + 2 * abs(left + right - 2 * here)
    across_columns += abs(corners[2] + corners[3] - 2 * down)
    is_level = across_rows >= across_columns  # the edge lies along a row
    before, after = np.where(is_level, up, left), np.where(is_level, down, right)
    is_before = abs(before - here) >= abs(after - here)
    beyond = np.where(is_before, before, after)
    step = np.where(is_level, width, 1) * np.where(is_before, -1, 1)
    jump = abs(beyond - here)
    # Twice the brightness in the middle between both sides, and how far an end of the edge is from it.
    middle = here + beyond
    along = np.where(is_level, 1, width)
    room_back, room_on = np.where(is_level, columns, rows), np.where(is_level, width - 1 - columns, height - 1 - rows)
    back, end_back = _follow(flat, at, -along, step, middle, jump, room_back)
    on, end_on = _follow(flat, at, along, step, middle, jump, room_on)
    near, end = np.minimum(back, on), np.where(back < on, end_back, end_on)
    share = 128 - 256 * near // (back + on)
    # No change where the edge bends away from this pixel, or has no end nearby.
    share[((end < 0) == (2 * here - middle < 0)) | (2 * abs(end) < jump)] = 0
    own, other = wide.reshape(-1, 4)[at, :3], wide.reshape(-1, 4)[at + step, :3]
    smooth.reshape(-1, 3)[at] = (own * (256 - share[:, None]) + other * share[:, None] + 128) >> 8


def _follow(flat: Int, at: Int, along: Int, step: Int, middle: Int, jump: Int, room: Int) -> tuple[Int, Int]:
    """Return how many pixels away an edge ends, and what brightness there lies above twice its middle."""
    distance = np.ones_like(at)
    place = at + along
    value = flat[place] + flat[place + step] - middle
    for _ in range(SEARCH_PX - 1):
        goes_on = (2 * abs(value) < jump) & (distance < room)
        distance += goes_on
        place = place + np.where(goes_on, along, 0)
        value = flat[place] + flat[place + step] - middle
    return distance, value
