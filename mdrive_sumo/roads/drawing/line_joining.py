"""Join pieces of lines that continue each other, and smooth the result."""

from collections.abc import Sequence

import numpy as np
import shapely

from mdrive_sumo.core.geometry import Float

MAX_AHEAD_M, MAX_ASIDE_M = 3.0, 1.3
"""[m] How far ahead of the end of a piece, and how far beside it, the next one may start; junctions are wider."""
JOINT_COS = 0.85
"""Smallest cosine between the directions of joined pieces."""
SPACING_M = 1.0
"""[m] Between the points of a smoothed line."""
SIGMA_M = 1.5
"""[m] Standard deviation of the smoothing: moves a line of 12 m radius by 0.1 m, spreads a step over 5 m."""
REACH = 5
"""Points to either side that the smoothing weighs."""
TOLERANCE_M = 0.02
"""[m] Points of less effect are left out."""


def join_lines(pieces: Sequence[Float]) -> list[Float]:
    """Return lines (N, 2) made of pieces (M, 2) whose ends nearly coincide in one direction, each joined once."""
    following = _match_ends(pieces)
    starts = [i for i in range(len(pieces)) if i not in following.values()]
    lines: list[Float] = []
    used = set[int]()
    for start in (*starts, *range(len(pieces))):  # what is left then are rings
        chain: list[Float] = []
        current: int | None = start
        while current is not None and current not in used:
            used.add(current)
            chain.append(pieces[current])
            current = following.get(current)
        if chain:
            lines.append(np.concatenate(chain))
    return lines


def _match_ends(pieces: Sequence[Float]) -> dict[int, int]:
    """Return piece -> next piece; the nearest ends are matched first."""
    if len(pieces) < 2:
        return {}
    starts, ends = (np.array([piece[row] for piece in pieces]) for row in (0, -1))
    entry, leave = (_compute_direction(pieces, row) for row in (0, -2))
    here, there = shapely.STRtree(np.asarray(shapely.points(starts), dtype=object)).query(
        shapely.points(ends), predicate="dwithin", distance=float(np.hypot(MAX_AHEAD_M, MAX_ASIDE_M))
    )
    step = starts[there] - ends[here]
    ahead = (step * leave[here]).sum(1)
    aside = np.abs(step[:, 0] * leave[here, 1] - step[:, 1] * leave[here, 0])
    fits = (here != there) & ((leave[here] * entry[there]).sum(1) > JOINT_COS)
    fits &= (ahead > -MAX_ASIDE_M / 2) & (ahead <= MAX_AHEAD_M) & (aside <= MAX_ASIDE_M)
    here, there, length = here[fits], there[fits], np.abs(ahead[fits]) + 2 * aside[fits]
    following: dict[int, int] = {}
    taken = set[int]()
    for pair in np.lexsort((there, here, length)).tolist():
        one, other = int(here[pair]), int(there[pair])
        if one not in following and other not in taken:
            following[one] = other
            taken.add(other)
    return following


def _compute_direction(pieces: Sequence[Float], row: int) -> Float:
    step = np.array([piece[row + 1] - piece[row] for piece in pieces])
    return step / np.maximum(np.hypot(step[:, 0], step[:, 1]), 1e-9)[:, None]


def smooth_line(line: Float) -> Float:
    """Return a line (N, 2) without kinks; its ends stay."""
    whole = shapely.LineString(line)
    count = max(2, 1 + round(whole.length / SPACING_M))
    xy = shapely.get_coordinates(whole.interpolate(np.linspace(0.0, 1.0, count), normalized=True))
    reach = min(REACH, count - 1)
    offsets = np.arange(-reach, reach + 1) * SPACING_M
    weights = np.exp(-((offsets / SIGMA_M) ** 2) / 2)
    before, after = 2 * xy[0] - xy[reach:0:-1], 2 * xy[-1] - xy[-2 : -2 - reach : -1]
    padded = np.concatenate((before, xy, after))
    smooth = np.column_stack([np.convolve(column, weights / weights.sum(), mode="valid") for column in padded.T])
    return shapely.get_coordinates(shapely.LineString(smooth).simplify(TOLERANCE_M))
