"""Sizes and times of features as messages, beside zlib and LZMA, on made-up sparse maps: docs/feature-messages.md."""

import lzma
import statistics
import sys
import time
import zlib
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from mdrive_sumo.v2x.content import MAX_PACKET_BYTES
from mdrive_sumo.v2x.feature_encoding import count_head_bytes
from mdrive_sumo.v2x.feature_map import assemble_feature_map, encode_feature_map, expand_tiles
from mdrive_sumo.v2x.messages import Feature, FeatureGrid, ReferencePose, decode

GRID = FeatureGrid("bev-a", 1, 1.6, 64, 64, 16)
POSE = ReferencePose(1.0, 2.0, 0.3, 9)
REPEATS = 15
COMPRESSORS: dict[str, Callable[[bytes], bytes]] = {
    "zlib": lambda data: zlib.compress(data, 9),
    "LZMA": lambda data: lzma.compress(data, lzma.FORMAT_RAW, filters=[{"id": lzma.FILTER_LZMA2, "preset": 9}]),
}


def make_map(objects: int) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """Features (16, 64, 64), positive, and a confidence (64, 64): boxes of 3 x 3 cells, four walls, smooth noise."""
    rng = np.random.default_rng(objects)
    activity = np.zeros((64, 64))
    for _ in range(objects):
        row, column = rng.integers(4, 60), rng.integers(4, 60)
        activity[row - 1 : row + 2, column - 1 : column + 3] += rng.uniform(0.5, 2)
    for _ in range(4):
        wall = slice(rng.integers(0, 32), rng.integers(32, 64)), rng.integers(0, 64)
        activity[wall if rng.random() < 0.5 else wall[::-1]] += rng.uniform(0.3, 1)
    gains = rng.normal(0, 1, (16, 1, 1))
    response = (gains + smooth(rng.normal(0, 3, (16, 64, 64)))) * (smooth(activity[None]) + 0.02)
    return np.maximum(response - 0.03, 0).astype(np.float32), (1 - np.exp(-activity)).astype(np.float32)


def smooth(layers: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Mean of 3 x 3 cells."""
    padded = np.pad(layers, ((0, 0), (1, 1), (1, 1)))
    shifted = [padded[:, i : i + 64, j : j + 64] for i in range(3) for j in range(3)]
    return np.mean(shifted, axis=0)


def pack_otherwise(received: list[Feature], compress: Callable[[bytes], bytes]) -> int:
    """Bytes of the same tiles in packets that another compressor fills, the better of both orders of their values."""
    levels = np.concatenate([np.rint(expand_tiles(one) / np.maximum(one.steps, 1e-9)) for one in received]).astype(
        np.uint8
    )
    totals: list[int] = []
    for tiles in (levels, levels.transpose(0, 2, 1)):
        total, begin = 0, 0
        while begin < len(tiles):
            count, size = 0, 0
            while begin + count < len(tiles):
                tried = count_head_bytes(GRID, count + 1) + len(compress(tiles[begin : begin + count + 1].tobytes()))
                if tried > MAX_PACKET_BYTES and count:
                    break
                count, size = count + 1, tried
            total, begin = total + size, begin + count
        totals.append(total)
    return min(totals)


def median_ms(work: Callable[[], object]) -> float:
    """Processor time [ms]."""
    times: list[float] = []
    for _ in range(REPEATS):
        since = time.process_time()
        work()
        times.append(time.process_time() - since)
    return 1000 * statistics.median(times)


def main() -> None:
    """Prints a line for each map and number of bits."""
    for objects in (5, 15, 40):
        features, confidence = make_map(objects)
        for bits in (8, 6, 4):
            messages = encode_feature_map(features, confidence, POSE, GRID, bits=bits)
            received = [content for message in messages if isinstance(content := decode(message), Feature)]
            others = {name: pack_otherwise(received, compress) for name, compress in COMPRESSORS.items()}
            times = (
                median_ms(lambda: encode_feature_map(features, confidence, POSE, GRID, bits=bits)),  # noqa: B023
                median_ms(lambda: [decode(message) for message in messages]),  # noqa: B023
                median_ms(lambda: assemble_feature_map(received, GRID)),  # noqa: B023
            )
            size, tiles = sum(len(one.payload) for one in messages), sum(len(one.tiles) for one in received)
            sys.stdout.write(
                f"{objects} objects, {tiles} tiles, {bits} bits: {size} bytes in {len(messages)} packets, {others};"
                f" encode {times[0]:.1f}, decode {times[1]:.1f}, assemble {times[2]:.2f} ms\n"
            )


if __name__ == "__main__":
    main()
