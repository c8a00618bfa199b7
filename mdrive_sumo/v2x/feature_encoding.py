"""Bytes of `feature` messages; decoding has two steps as in `encoding`. docs/feature-messages.md has the table."""

import math
import struct
from typing import NamedTuple

import numpy as np

from mdrive_sumo.contract import NAME
from mdrive_sumo.core.geometry import Int
from mdrive_sumo.v2x.content import (
    MAX_CHANNELS,
    MAX_LEVEL,
    MAX_PACKET_BYTES,
    MAX_TILE_CELLS,
    MAX_TILE_VALUES,
    MAX_TILES,
    MESSAGE_REACH_M,
    Feature,
    FeatureGrid,
    MessageError,
    ReferencePose,
)
from mdrive_sumo.v2x.encoding import HEADER_BYTES
from mdrive_sumo.v2x.rice_code import (
    MAX_PARAMETER,
    choose_parameter,
    decode_rice,
    encode_rice,
    read_unary,
)

_GRID = struct.Struct("<16sHHHHBB")
"""Name, version, cell [mm], rows, columns, channels, cells along the edge of a tile."""
_COUNTS = struct.Struct("<BBHHBBB")
"""Tiles, 1 if levels have signs, cells that are not empty, values, Rice parameters of cells, places and levels."""
_TILE_BYTES = 3
"""Index and confidence of a tile."""
_MILLI = 1000.0
_CONFIDENCE_STEPS = 255.0
"""Of a confidence from 0 to 1, which a message holds in a byte."""


class FeatureParts(NamedTuple):
    """The fields of a feature body, checked."""

    grid: FeatureGrid
    steps: bytes
    tiles: bytes
    confidence: bytes
    places: Int
    levels: Int


def count_head_bytes(grid: FeatureGrid, tiles: int) -> int:
    """Return the bytes of a message of so many tiles without their values, common header included."""
    return HEADER_BYTES + _GRID.size + _COUNTS.size + 2 * grid.channels + _TILE_BYTES * tiles


def check_grid(grid: FeatureGrid) -> None:
    """Raise MessageError for a grid that no message can carry."""
    if not NAME.fullmatch(grid.name):
        raise MessageError(f"expected a grid whose name has 1 to 16 of a-z, 0-9, _ and -, found {grid.name!r:.40}")
    cell_mm = grid.cell_m * _MILLI
    limits = (
        ("version", grid.version, 0, 65535),
        ("cell_m in mm", round(cell_mm) if math.isfinite(cell_mm) else -1, 1, 65535),
        ("channels", grid.channels, 1, MAX_CHANNELS),
        ("tile_cells", grid.tile_cells, 1, MAX_TILE_CELLS),
    )
    for name, value, low, high in limits:
        if not low <= value <= high:
            raise MessageError(f"expected a grid with {name} from {low} to {high}, found {value}")
    for name, cells in (("rows", grid.rows), ("columns", grid.columns)):
        if cells < 1 or cells % grid.tile_cells or cells * grid.cell_m > 2 * MESSAGE_REACH_M:
            raise MessageError(
                f"expected a grid with {name} that are a multiple of {grid.tile_cells} within {MESSAGE_REACH_M} m of"
                f" the sender, found {cells} of {grid.cell_m:g} m"
            )
    if grid.tile_rows * grid.tile_columns > 65536:
        raise MessageError(f"expected a grid of at most 65536 tiles, found {grid.tile_rows * grid.tile_columns}")


def encode_feature(feature: Feature, _: ReferencePose) -> bytes:
    """Return the body of a feature message, without header. Raises MessageError if it is larger than a packet."""
    grid = feature.grid
    check_grid(grid)
    _check_contents(feature)
    cells, cell_of = np.unique(feature.places // grid.channels, return_inverse=True)
    # Within the cells that are not empty, which follow on each other here, few values are zero.
    ranks = cell_of * grid.channels + feature.places % grid.channels
    parts = _measure_gaps(cells), _measure_gaps(ranks), np.abs(feature.levels) - 1
    parameters = [choose_parameter(part) for part in parts]
    coded = [encode_rice(part, parameter) for part, parameter in zip(parts, parameters, strict=True)]
    has_signs = bool((feature.levels < 0).any())
    signs = (feature.levels < 0).astype(np.uint8) if has_signs else np.zeros(0, dtype=np.uint8)
    bits = np.concatenate((*(low for low, _ in coded), signs, *(unary for _, unary in coded)))
    body = b"".join(
        (
            _GRID.pack(
                grid.name.encode(), grid.version, round(grid.cell_m * _MILLI), grid.rows, grid.columns,
                grid.channels, grid.tile_cells,
            ),
            _COUNTS.pack(len(feature.tiles), has_signs, len(cells), len(feature.levels), *parameters),
            feature.steps.astype("<f2").tobytes(),
            feature.tiles.astype("<u2").tobytes(),
            np.rint(feature.confidence * _CONFIDENCE_STEPS).astype(np.uint8).tobytes(),
            np.packbits(bits).tobytes(),
        )
    )  # fmt: skip
    if HEADER_BYTES + len(body) > MAX_PACKET_BYTES:
        raise MessageError(f"expected at most {MAX_PACKET_BYTES} bytes, found {HEADER_BYTES + len(body)}")
    return body


def _measure_gaps(ascending: Int) -> Int:
    """Return how many numbers are left out before each one."""
    return np.diff(ascending, prepend=-1) - 1


def _check_contents(feature: Feature) -> None:
    """Raise MessageError for arrays that do not fit each other or the fields of a message."""
    grid, count = feature.grid, len(feature.tiles)
    if feature.steps.shape != (grid.channels,):
        raise MessageError(f"expected steps of shape ({grid.channels},), found {feature.steps.shape}")
    if not (np.isfinite(feature.steps) & (feature.steps >= 0)).all() or feature.steps.max() > np.finfo(np.float16).max:
        raise MessageError("expected steps from 0 to 65504")
    if count > MAX_TILES or count * grid.tile_values > MAX_TILE_VALUES:
        raise MessageError(
            f"expected at most {MAX_TILES} tiles and {MAX_TILE_VALUES} values in them, found {count} tiles"
        )
    if len(set(feature.tiles.tolist())) < count or not _is_within(feature.tiles, grid.tile_rows * grid.tile_columns):
        raise MessageError(f"expected each tile once, from 0 to {grid.tile_rows * grid.tile_columns - 1}")
    if feature.confidence.shape != (count,) or not ((feature.confidence >= 0) & (feature.confidence <= 1)).all():
        raise MessageError(f"expected a confidence in [0, 1] for each of {count} tiles")
    if len(feature.places) != len(feature.levels) or not _is_within(feature.places, count * grid.tile_values):
        raise MessageError(f"expected a level at each place, from 0 to {count * grid.tile_values - 1}")
    if (np.diff(feature.places) <= 0).any() or not (feature.levels != 0).all() or _peak(feature.levels) > MAX_LEVEL:
        raise MessageError(f"expected ascending places and levels from -{MAX_LEVEL} to {MAX_LEVEL} other than 0")


def _is_within(numbers: Int, count: int) -> bool:
    return not len(numbers) or (int(numbers.min()) >= 0 and int(numbers.max()) < count)


def _peak(numbers: Int) -> int:
    return int(np.abs(numbers).max(initial=0))


def parse_feature(body: bytes) -> FeatureParts:
    """Return the fields of a feature body. Raises MessageError unless every bit is valid."""
    if HEADER_BYTES + len(body) > MAX_PACKET_BYTES:
        raise MessageError(f"expected at most {MAX_PACKET_BYTES} bytes, found {HEADER_BYTES + len(body)}")
    if len(body) < _GRID.size + _COUNTS.size:
        raise MessageError(f"expected at least {_GRID.size + _COUNTS.size} bytes after the header, found {len(body)}")
    name, version, cell_mm, rows, columns, channels, tile_cells = _GRID.unpack_from(body)
    grid = FeatureGrid(
        name.rstrip(b"\0").decode("ascii", "replace"), version, cell_mm / _MILLI, rows, columns, channels, tile_cells
    )
    check_grid(grid)
    count, has_signs, cells, values, *parameters = _COUNTS.unpack_from(body, _GRID.size)
    begin = _GRID.size + _COUNTS.size
    ends = np.cumsum((2 * channels, 2 * count, count)) + begin
    if len(body) < ends[-1] or has_signs > 1 or max(parameters) > MAX_PARAMETER:
        raise MessageError(
            f"expected {ends[-1]} bytes or more after the header, 0 or 1 for signs, and parameters up to"
            f" {MAX_PARAMETER}, found {len(body)}, {has_signs} and {max(parameters)}"
        )
    places, levels = _read_values(body[ends[-1] :], (cells, values, values), parameters, bool(has_signs), channels)
    parts = FeatureParts(grid, body[begin : ends[0]], body[ends[0] : ends[1]], body[ends[1] : ends[2]], places, levels)
    _check_contents(build_feature(ReferencePose(0.0, 0.0, 0.0, 0), parts))
    return parts


def _read_values(
    data: bytes, counts: tuple[int, int, int], parameters: list[int], has_signs: bool, channels: int
) -> tuple[Int, Int]:
    """Return places and levels. Raises MessageError unless the bits hold as many numbers as stated, and no more."""
    bits = np.unpackbits(np.frombuffer(data, dtype=np.uint8))
    sizes = [count * parameter for count, parameter in zip(counts, parameters, strict=True)]
    sections = np.cumsum((*sizes, counts[2] * has_signs))
    unary = read_unary(bits[sections[-1] :])
    used = int(sections[-1]) + sum(counts) + int(unary.sum())
    if len(bits) < sections[-1] or len(unary) != sum(counts) or len(bits) - used >= 8:
        raise MessageError(f"expected {sum(counts)} numbers in {len(data)} bytes, found {len(unary)}")
    *low, signs, _ = np.split(bits, sections)
    quotients = np.split(unary, np.cumsum(counts)[:-1])
    cells, ranks, sizes_less_1 = (decode_rice(*one) for one in zip(low, quotients, parameters, strict=True))
    cells, ranks = np.cumsum(cells + 1) - 1, np.cumsum(ranks + 1) - 1
    if not _is_within(ranks, len(cells) * channels):
        raise MessageError(f"expected values in {len(cells)} cells, found some beyond")
    places = cells[ranks // channels] * channels + ranks % channels
    levels = sizes_less_1 + 1
    return places, np.where(signs, -levels, levels) if has_signs else levels


def build_feature(pose: ReferencePose, parts: FeatureParts) -> Feature:
    """Return the content of these fields."""
    return Feature(
        pose,
        parts.grid,
        np.frombuffer(parts.steps, dtype="<f2").astype(np.float64),
        np.frombuffer(parts.tiles, dtype="<u2").astype(np.int64),
        np.frombuffer(parts.confidence, dtype=np.uint8) / _CONFIDENCE_STEPS,
        parts.places,
        parts.levels,
    )
