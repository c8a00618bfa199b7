"""Maps of features as messages: what a sender chooses and quantises, and what a receiver makes of what arrived.

Each packet is a message of its own and is read alone, so a loss costs its tiles and nothing else (decision 101). Sizes,
and with them what a radio does, are the same on every host: the code is our own, in whole numbers.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import islice
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from mdrive_sumo.contract import Message
from mdrive_sumo.contract.reply_check import MAX_MESSAGES
from mdrive_sumo.core.geometry import Bool, Float, Int
from mdrive_sumo.v2x.content import (
    MAX_PACKET_BYTES,
    MAX_TILE_VALUES,
    MAX_TILES,
    Feature,
    FeatureGrid,
    MessageError,
    ReferencePose,
)
from mdrive_sumo.v2x.feature_encoding import check_grid, count_head_bytes
from mdrive_sumo.v2x.messages import encode
from mdrive_sumo.v2x.rice_code import choose_parameter, count_rice_bits

Element = TypeVar("Element", bound=np.generic)
MAX_BITS = 8
"""Bits of a quantised value at most, its sign included: levels up to `MAX_LEVEL`."""
MAX_FEATURE = 16_000.0
"""Largest feature, either sign: its step, doubled until nothing is left of it, is still a number of half precision."""


@dataclass(frozen=True, slots=True)
class FeatureMap:
    """What arrived of a map of features."""

    pose: ReferencePose
    """Where the sender was, as far as the receiver knows."""
    features: npt.NDArray[np.float32]
    """(C, rows, columns); 0 where no tile arrived."""
    arrived: Bool
    """(rows, columns): whether the tile of a cell arrived. Tiles that the sender did not choose never do."""
    confidence: npt.NDArray[np.float32]
    """(rows, columns): the confidence that the sender stated of the tile, 0 where none arrived."""


@dataclass(frozen=True, slots=True)
class _Tiles:
    """The chosen tiles of a map, in the order of sending."""

    index: Int
    """(K,)"""
    confidence: Float
    """(K,)"""
    levels: Int
    """(K, cells of a tile, channels), zeros included."""


def encode_feature_map(
    features: npt.NDArray[np.floating],
    confidence: npt.NDArray[np.floating],
    pose: ReferencePose,
    grid: FeatureGrid,
    *,
    bits: int = 6,
    budget_bytes: float = np.inf,
    least_confidence: float = 0.0,
    most_messages: int = MAX_MESSAGES - 4,
) -> tuple[Message, ...]:
    """Return the messages of a map, the most confident tiles first, each no larger than a packet.

    features: (C, rows, columns). confidence: (rows, columns) in [0, 1]; that of a tile is its greatest. Tiles whose
    confidence is 0 or below `least_confidence` are not sent. bits: of a quantised value, 1 to 8; each channel has steps
    of its own, so that its greatest value takes the largest level. budget_bytes: of all payloads together; the least
    confident tiles stay out. most_messages: those that do not fit into so many stay out, too; by default a reply has
    room for a CAM, CPM, MCM and DENM besides. A tile that fits no packet is sent in steps twice as large, or four
    times, and so on.

    Raises MessageError for arrays of other shapes, numbers that are not finite and a grid that no message can carry.
    """
    check_grid(grid)
    shape = grid.channels, grid.rows, grid.columns
    if features.shape != shape or confidence.shape != shape[1:]:
        raise MessageError(
            f"feature: expected features {shape} and confidence {shape[1:]} of the grid {grid.name}, found"
            f" {features.shape} and {confidence.shape}"
        )
    if not 1 <= bits <= MAX_BITS:
        raise MessageError(f"feature: expected 1 to {MAX_BITS} bits, found {bits}")
    if not (np.isfinite(features).all() and ((confidence >= 0) & (confidence <= 1)).all()):
        raise MessageError("feature: expected finite features and a confidence in [0, 1]")
    steps = _choose_steps(features, bits)
    safe_steps = np.where(steps > 0, steps, 1.0)
    levels = np.rint(features.astype(np.float64) / safe_steps[:, None, None]).astype(np.int64)
    tiles = _choose_tiles(_cut(levels.transpose(1, 2, 0), grid), _cut(confidence[..., None], grid), least_confidence)
    return tuple(islice(_fill_packets(tiles, steps, pose, grid, budget_bytes), most_messages))


def _choose_steps(features: npt.NDArray[np.floating], bits: int) -> Float:
    """Return steps (C,) in half precision, rounded up so that no level exceeds what the bits hold."""
    most = (1 << bits) - 1 if features.min(initial=0.0) >= 0 else max((1 << bits - 1) - 1, 1)
    peaks = np.abs(features).max(axis=(1, 2)).astype(np.float64)
    if peaks.max() > MAX_FEATURE:
        raise MessageError(f"feature: expected features up to {MAX_FEATURE:g}, found {peaks.max():g}")
    exact = peaks / most
    half = exact.astype(np.float16)
    return np.where(half < exact, np.nextafter(half, np.float16(np.inf)), half).astype(np.float64)


def _cut(cells: npt.NDArray[Element], grid: FeatureGrid) -> npt.NDArray[Element]:
    """Return an array (rows, columns, n) by tile: (tiles, cells of a tile, n)."""
    side = grid.tile_cells
    blocks = cells.reshape(grid.tile_rows, side, grid.tile_columns, side, -1).transpose(0, 2, 1, 3, 4)
    return blocks.reshape(grid.tile_rows * grid.tile_columns, side * side, -1)


def _choose_tiles(levels: Int, confidence: npt.NDArray[np.floating], least_confidence: float) -> _Tiles:
    """Return the tiles that are worth sending, the most confident first; of equals the first in the grid."""
    peaks = confidence.max(axis=(1, 2)).astype(np.float64)
    order = np.argsort(-peaks, kind="stable")
    chosen = order[(peaks[order] > 0) & (peaks[order] >= least_confidence)]
    return _Tiles(chosen, peaks[chosen], levels[chosen])


def _fill_packets(
    tiles: _Tiles, steps: Float, pose: ReferencePose, grid: FeatureGrid, budget_bytes: float
) -> Iterator[Message]:
    """Yield messages until the tiles or the budget are spent."""
    most_tiles = min(MAX_TILES, MAX_TILE_VALUES // grid.tile_values)
    bounds = _bound_bits(tiles.levels)
    begin, left_bytes = 0, budget_bytes
    while begin < len(tiles.index):
        ends = np.cumsum(bounds[begin : begin + most_tiles])
        sizes = -(-ends // 8) + [count_head_bytes(grid, 1 + i) for i in range(len(ends))]
        count = int(np.searchsorted(sizes, min(left_bytes, MAX_PACKET_BYTES), side="right"))
        if count:
            message = encode(_make_feature(tiles, slice(begin, begin + count), steps, pose, grid))
        elif sizes[0] > MAX_PACKET_BYTES:
            count = 1
            message = encode(_coarsen(tiles, begin, steps, pose, grid))
        else:
            return
        left_bytes -= len(message.payload)
        if left_bytes < 0:
            return
        yield message
        begin += count


def _bound_bits(levels: Int) -> Int:
    """Return how many bits (K,) each tile takes at most, in a packet with any others; levels: (K, cells, channels).

    Parameters are those of all tiles together. A packet chooses its own, which are no worse.
    """
    channels = levels.shape[2]
    is_filled = (levels != 0).any(axis=2)
    row, cell = np.nonzero(is_filled)
    bits = _bound_gaps(row, cell, np.full(len(levels), is_filled.shape[1]))
    rank = np.cumsum(is_filled, axis=1) - 1
    row, cell, channel = np.nonzero(levels)
    bits += _bound_gaps(row, rank[row, cell] * channels + channel, (rank[:, -1] + 1) * channels)
    sizes = np.abs(levels[row, cell, channel]) - 1
    np.add.at(bits, row, count_rice_bits(sizes, choose_parameter(sizes)) + bool((levels < 0).any()))
    return bits


def _bound_gaps(row: Int, place: Int, width: Int) -> Int:
    """Return how many bits (K,) the gaps before the places of each tile take at most.

    row, place: (N,) tile and place in it, ascending. width: (K,) places of each tile. The places behind the last one
    lengthen the first gap of the tile that follows; their bits count here.
    """
    is_first = np.diff(row, prepend=-1) > 0
    gaps = np.where(is_first, place, np.diff(place, prepend=-1) - 1)
    parameter = choose_parameter(gaps)
    bits, last = np.zeros(len(width), dtype=np.int64), np.full(len(width), -1)
    np.add.at(bits, row, count_rice_bits(gaps, parameter))
    last[row] = place
    return bits + ((width - 1 - last) >> parameter) + 1


def _make_feature(tiles: _Tiles, chosen: slice, steps: Float, pose: ReferencePose, grid: FeatureGrid) -> Feature:
    levels = tiles.levels[chosen].ravel()
    places = np.flatnonzero(levels)
    return Feature(pose, grid, steps, tiles.index[chosen], tiles.confidence[chosen], places, levels[places])


def _coarsen(tiles: _Tiles, row: int, steps: Float, pose: ReferencePose, grid: FeatureGrid) -> Feature:
    """Return a packet of one tile, in steps so large that it fits."""
    one = slice(row, row + 1)
    factor, levels, room_bits = 1, tiles.levels[one], 8 * (MAX_PACKET_BYTES - count_head_bytes(grid, 1))
    while int(_bound_bits(levels)[0]) > room_bits:
        factor *= 2
        levels = np.rint(tiles.levels[one] / factor).astype(np.int64)
    coarse = _Tiles(tiles.index[one], tiles.confidence[one], levels)
    return _make_feature(coarse, slice(0, 1), factor * steps, pose, grid)


def assemble_feature_map(received: Iterable[Feature], grid: FeatureGrid) -> FeatureMap:
    """Return the map of what arrived of one map of one sender; the order does not matter, nor do repetitions.

    Raises MessageError for no feature at all, for another grid or version, and for features of several poses.
    """
    features = tuple(received)
    if not features:
        raise MessageError("feature: expected at least one message of a map, found none")
    shape = (grid.tile_rows * grid.tile_columns, grid.tile_cells * grid.tile_cells)
    levels = np.zeros((*shape, grid.channels), dtype=np.float32)
    arrived, confidence = np.zeros(shape, dtype=np.bool_), np.zeros(shape, dtype=np.float32)
    for one in features:
        if one.grid != grid:
            raise MessageError(f"feature: expected the grid {_describe(grid)}, found {_describe(one.grid)}")
        if one.pose != features[0].pose:
            raise MessageError(
                f"feature: expected messages of one map, found poses of ticks {features[0].pose.tick} and"
                f" {one.pose.tick}"
            )
        levels[one.tiles] = expand_tiles(one)
        arrived[one.tiles] = True
        confidence[one.tiles] = one.confidence[:, None]
    return FeatureMap(
        features[0].pose,
        np.ascontiguousarray(_join(levels, grid).transpose(2, 0, 1)),
        _join(arrived[..., None], grid)[..., 0],
        _join(confidence[..., None], grid)[..., 0],
    )


def expand_tiles(feature: Feature) -> npt.NDArray[np.float32]:
    """Return the values (K, cells of a tile row by row, C) of the tiles of a message."""
    grid = feature.grid
    values = np.zeros(len(feature.tiles) * grid.tile_values, dtype=np.float32)
    values[feature.places] = feature.levels * feature.steps[feature.places % grid.channels]
    return values.reshape(len(feature.tiles), -1, grid.channels)


def _join(tiles: npt.NDArray[Element], grid: FeatureGrid) -> npt.NDArray[Element]:
    """Return an array by tile as (rows, columns, n): the inverse of `_cut`."""
    side = grid.tile_cells
    blocks = tiles.reshape(grid.tile_rows, grid.tile_columns, side, side, -1).transpose(0, 2, 1, 3, 4)
    return blocks.reshape(grid.rows, grid.columns, -1)


def _describe(grid: FeatureGrid) -> str:
    return (
        f"{grid.name} version {grid.version} ({grid.channels} x {grid.rows} x {grid.columns} of {grid.cell_m:g} m,"
        f" tiles of {grid.tile_cells})"
    )
