"""What detectors send: their grids, features as messages, and occupied cells of the point grid as messages."""

import numpy as np
import numpy.typing as npt

from mdrive_sumo.agents.learned.fusion_network import EncodedScan, FusionDetector
from mdrive_sumo.agents.learned.fusion_spec import (
    FEATURE_CELL_M,
    FEATURE_CELLS,
    FEATURE_CHANNELS,
    GRID_CELL_M,
    GRID_CELLS,
    GRID_LAYERS,
    GRID_VERSION,
    MAX_COUNT,
    TILE_CELLS,
)
from mdrive_sumo.agents.learned.point_grid import GRID_SIZE, Cells
from mdrive_sumo.contract import Message
from mdrive_sumo.v2x.feature_map import MAX_BITS, FeatureMap, encode_feature_map
from mdrive_sumo.v2x.messages import FeatureGrid, MessageError, ReferencePose

POINT_TILE_CELLS = 16
"""Of the point grid: 6.4 m; its 256 tiles fit into the 255 of a packet and a second one."""
POINT_GRID = FeatureGrid(
    "points", GRID_VERSION, GRID_CELL_M, GRID_CELLS, GRID_CELLS, GRID_LAYERS, tile_cells=POINT_TILE_CELLS
)
"""Counts of points: a channel for each height layer. They need no weights, so any sender's can be read."""
MAX_RECEIVED_FEATURE = 1000.0
"""Larger values are cut off: encoders answer numbers of the size of 1, and a sender of noise shall not bring the
network to numbers that are not finite."""


def build_feature_grid(detector: FusionDetector) -> FeatureGrid:
    """Return the grid of a detector's features. Its version says which weights: features of others mean nothing.

    Two encoders have one version by chance in one of 65 536 cases.
    """
    version = int(detector.encoder.manifest.sha256[:4], 16)
    return FeatureGrid(
        detector.name, version, FEATURE_CELL_M, FEATURE_CELLS, FEATURE_CELLS, FEATURE_CHANNELS, tile_cells=TILE_CELLS
    )


def encode_features(
    scan: EncodedScan, pose: ReferencePose, grid: FeatureGrid, budget_bytes: float, least_confidence: float
) -> tuple[Message, ...]:
    """Return a scan's features as messages, the tiles first in which a road user is the most likely.

    Nothing is sent of features that are too large for a message, which trained encoders do not answer.
    """
    confidence = np.clip(scan.confidence, 0.0, 1.0)
    try:
        return encode_feature_map(
            scan.features, confidence, pose, grid, budget_bytes=budget_bytes, least_confidence=least_confidence
        )
    except MessageError:
        return ()


def limit_features(features: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Return received features within what an encoder can answer: from 0 on, and finite."""
    return np.clip(features, np.float32(0.0), np.float32(MAX_RECEIVED_FEATURE))


def encode_points(cells: Cells, pose: ReferencePose) -> tuple[Message, ...]:
    """Return the occupied cells of a scan as messages, without any loss; tiles of the ground alone come last.

    There are as many bits as the greatest count needs, so steps are at most 1 and receivers round to the counts.
    """
    counts = np.zeros(GRID_SIZE, np.float32)
    counts[cells >> 8] = cells & 255
    counts = counts.reshape(GRID_LAYERS, GRID_CELLS, GRID_CELLS)
    confidence = np.where(counts[1:].any(axis=0), 1.0, 0.5 * (counts[0] > 0))
    bits = min(max(int(counts.max()).bit_length(), 1), MAX_BITS)
    return encode_feature_map(counts, confidence, pose, POINT_GRID, bits=bits)


def read_points(received: FeatureMap) -> Cells:
    """Return the occupied cells of a received map of counts."""
    values = received.features.ravel()
    occupied = np.flatnonzero(values)
    counts = np.clip(np.rint(values[occupied]), 0, MAX_COUNT).astype(np.uint32)
    cells = (occupied.astype(np.uint32) << np.uint32(8)) | counts
    return cells[counts > 0]
