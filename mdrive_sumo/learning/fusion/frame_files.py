"""Fusion frames on disk: a folder with `frames.json` and archives of arrays, docs/fusion-frames.md."""

import json
import re
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from mdrive_sumo.agents.learned.fusion_spec import GRID_VERSION
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.input_files import read_json_file
from mdrive_sumo.core.output_files import make_folder, write_text
from mdrive_sumo.learning.array_files import read_arrays, write_arrays
from mdrive_sumo.learning.fusion.frames import ARRAYS, OPTIONAL, FusionFrames, check_frames, concatenate_frames

FORMAT = "mdrive-sumo fusion frames 1"
INDEX_NAME, ARCHIVE_NAME = "frames.json", "frames-{:06d}.npz"
READERS = 8
"""Threads that unpack archives; zlib lets others run meanwhile."""
_SHARD_NAME = re.compile(r"frames-\d{6}\.npz")


def write_frames(folder: Path, split: str, shards: list[FusionFrames]) -> Path:
    """Write a data set and return the path of its index. Raises InputError for arrays of another kind."""
    make_folder(folder)
    names = [ARCHIVE_NAME.format(i) for i in range(len(shards))]
    for name, frames in zip(names, shards, strict=True):
        write_archive(folder / name, frames)
    return write_index(folder, split, names, {})


def write_archive(path: Path, frames: FusionFrames) -> None:
    """Write one archive; equal frames give equal bytes. Raises InputError for arrays of another kind, and OSError."""
    check_frames(frames, str(path))
    write_arrays(path, {"places": np.array(frames.places, dtype=np.str_), **frames.get_arrays()})


def write_index(folder: Path, split: str, names: Sequence[str], about: Mapping[str, Any]) -> Path:
    """Write the index of archives and return its path; about: what else it says. Raises OSError."""
    index = {"format": FORMAT, "grid_version": GRID_VERSION, "split": split, "shards": list(names), **about}
    write_text(folder / INDEX_NAME, json.dumps(index, indent=1) + "\n")
    return folder / INDEX_NAME


def read_frames(folder: Path) -> FusionFrames:
    """Return all frames of a data set. Raises InputError for what is missing, damaged or different."""
    names = _read_index(folder / INDEX_NAME)
    with ThreadPoolExecutor(READERS) as readers:
        return concatenate_frames([*readers.map(_read_shard, [folder / name for name in names])])


def _read_index(path: Path) -> list[str]:
    """Return the names of the archives."""
    index = read_json_file(path, "the index of fusion frames", FORMAT, "; `mdrive-sumo learn scans` makes them")
    if index.get("grid_version") != GRID_VERSION:
        raise InputError(
            f"{path}: expected scans in the point grid of version {GRID_VERSION}, found"
            f" {index.get('grid_version')!r:.40}; collect them again with this version of mdrive-sumo"
        )
    names: Any = index.get("shards")
    if not isinstance(names, list) or not names:
        raise InputError(f"{path}: shards: expected the names of one archive or more, found {names!r:.60}")
    for name in names:
        if not isinstance(name, str) or not _SHARD_NAME.fullmatch(name):
            raise InputError(f"{path}: shards: expected names such as frames-000000.npz, found {name!r:.60}")
    return names


def _read_shard(path: Path) -> FusionFrames:
    arrays = read_arrays(path, "fusion frames")
    for name in ("places", *ARRAYS):
        if name not in arrays and name not in OPTIONAL:
            hint = "; frames need LiDAR scans" if name in ("cells", "scan") else ""
            raise InputError(f"{path}: expected an array {name}, found none{hint}")
    places = arrays["places"]
    if places.ndim != 1 or places.dtype.kind != "U":
        raise InputError(f"{path}: places: expected names, found {places.dtype.name} {places.shape}")
    frames = FusionFrames(tuple(places.tolist()), **{name: arrays[name] for name in ARRAYS if name in arrays})
    check_frames(frames, str(path))
    return frames
