"""The driving request: where around a car seeing matters for its driving, which it asks of others in a small message.

A request is a map of features of its own grid with one channel, so that headers, errors of poses, losses and checks are
those of all features (docs/feature-messages.md). Senders give priority to what is asked for and what they see something
in, as Where2comm (Hu et al. 2022) and CoDriving (Liu et al. 2024) do; here both maps are rules, not learned.
"""

import math
from collections.abc import Iterable

import numpy as np

from mdrive_sumo.agents.learned.ego_frame import convert_to_frame
from mdrive_sumo.agents.learned.feature_inbox import ReceivedMap
from mdrive_sumo.agents.learned.fusion_spec import (
    FEATURE_CELL_M,
    FEATURE_CELLS,
    GRID_CELL_M,
    GRID_CELLS,
    GRID_REACH_M,
)
from mdrive_sumo.agents.learned.point_grid import Cells
from mdrive_sumo.contract import Message
from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Bool, Float, Int
from mdrive_sumo.v2x.feature_map import encode_feature_map
from mdrive_sumo.v2x.messages import FeatureGrid, ReferencePose

REQUEST_CELLS, REQUEST_CELL_M = 16, 6.4
"""A cell is a quarter of a tile of features: smaller ones would ask for the same tiles."""
REQUEST_GRID = FeatureGrid("request", 1, REQUEST_CELL_M, REQUEST_CELLS, REQUEST_CELLS, 1, tile_cells=REQUEST_CELLS)
REQUEST_BITS = 2
"""Levels 0 to 3."""
REACHES_M = (8.0, 25.0, 45.0)
"""[m] From the way ahead: the lanes that the car drives on and beside, what reaches it within 3 s at the 8 m/s of the
benchmark, and what does so at 15 m/s. Each asks for one level less."""
WAY_S, LEAST_WAY_M = 4.0, 20.0
"""The way ahead is what a car drives in the time of a plan, and 20 m at least: a standing car wants to see, too."""
VISIBLE_SHARE = 1 / 3
"""Of the demand for what the car sees itself: others see it from another side."""
SIGHT_BINS = 180
"""Directions of 2 degrees in which something hides what lies behind it: a car 45 m away covers 2 to 6 degrees."""
HIDING_LAYERS = 2
"""Layers from this one on hide: points from 0.7 m above the ground on. What is lower, one can look over."""


def find_hidden(cells: Cells) -> Bool:
    """Return which cells (REQUEST_CELLS, REQUEST_CELLS) of a request something in the own scan hides."""
    index = (cells >> np.uint32(8)).astype(np.int64)
    index = index[index >= HIDING_LAYERS * GRID_CELLS * GRID_CELLS]
    row, column = ((index // GRID_CELLS) % GRID_CELLS).astype(np.float64), (index % GRID_CELLS).astype(np.float64)
    ahead, left = (GRID_REACH_M - (each + 0.5) * GRID_CELL_M for each in (row, column))
    nearest = np.full(SIGHT_BINS, np.inf)
    np.minimum.at(nearest, _find_bins(ahead, left), portable.hypot(ahead, left))
    x, y = _build_centres()
    return portable.hypot(x, y) > nearest[_find_bins(x.ravel(), y.ravel())].reshape(x.shape) + REQUEST_CELL_M / 2


def _find_bins(ahead: Float, left: Float) -> Int:
    """Return in which of SIGHT_BINS directions points lie."""
    turns = portable.atan2(left, ahead) / (2 * math.pi) + 0.5
    return np.minimum((turns * SIGHT_BINS).astype(np.int64), SIGHT_BINS - 1)


def _build_centres() -> tuple[Float, Float]:
    """Return how far ahead and left [m] the centres of the cells of a request lie, both (rows, columns)."""
    offsets = GRID_REACH_M - (np.arange(REQUEST_CELLS, dtype=np.float64) + 0.5) * REQUEST_CELL_M
    return np.repeat(offsets[:, None], REQUEST_CELLS, axis=1), np.repeat(offsets[None], REQUEST_CELLS, axis=0)


def build_demand(way: Float, hidden: Bool) -> Float:
    """Return how much seeing each cell (REQUEST_CELLS, REQUEST_CELLS) matters, in [0, 1].

    way: (K, 2) points of the way ahead [m] in the own frame. hidden: of the same cells, what the car cannot see.
    """
    x, y = _build_centres()
    gap = portable.hypot(x[..., None] - way[:, 0], y[..., None] - way[:, 1]).min(axis=-1)
    level = np.zeros(gap.shape)
    for reach in REACHES_M:
        level += gap <= reach
    return level / len(REACHES_M) * np.where(hidden, 1.0, VISIBLE_SHARE)


def encode_request(demand: Float, pose: ReferencePose) -> tuple[Message, ...]:
    """Return the message of a request: one packet of less than 200 bytes."""
    return encode_feature_map(demand[None], demand, pose, REQUEST_GRID, bits=REQUEST_BITS)


def find_demand(requests: Iterable[ReceivedMap]) -> Float:
    """Return how much others want of each cell of the own features (FEATURE_CELLS, FEATURE_CELLS), in [0, 1].

    requests: maps of REQUEST_GRID. Of several the largest demand counts; 0 where none asks.
    """
    offsets = GRID_REACH_M - (np.arange(FEATURE_CELLS, dtype=np.float64) + 0.5) * FEATURE_CELL_M
    ahead = np.repeat(offsets[:, None], FEATURE_CELLS, axis=1)
    centres = np.stack((ahead, ahead.T), axis=-1)
    wanted = np.zeros((FEATURE_CELLS, FEATURE_CELLS))
    for request in requests:
        theirs = convert_to_frame(centres, request.pose.astype(np.float64))
        cell = np.floor((GRID_REACH_M - theirs) / REQUEST_CELL_M).astype(np.int64)
        row, column = cell[..., 0], cell[..., 1]
        inside = (row >= 0) & (row < REQUEST_CELLS) & (column >= 0) & (column < REQUEST_CELLS)
        demand = np.clip(request.map.features[0], 0.0, 1.0)[np.where(inside, row, 0), np.where(inside, column, 0)]
        wanted = np.maximum(wanted, np.where(inside, demand, 0.0))
    return wanted
