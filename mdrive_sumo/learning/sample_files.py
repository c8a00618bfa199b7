"""The files of one sample, and shards of them as tar files in the layout of WebDataset."""

import io
import os
import tarfile
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mdrive_sumo.core.checksum import MAX_CHECKED_BYTES, compute_file_checksum
from mdrive_sumo.core.input_files import open_regular
from mdrive_sumo.core.output_files import new_file
from mdrive_sumo.learning.recording_agent import RecordedDecision
from mdrive_sumo.learning.sample_format import (
    ABOUT_SUFFIX,
    IMAGE_ENDING,
    INSTRUCTION_SUFFIX,
    LABELS,
    LABELS_SUFFIX,
    SampleAbout,
)
from mdrive_sumo.learning.scene_labels import Labels

READ_BYTES = 2**20
"""Read at once."""


@dataclass(frozen=True, slots=True)
class SampleFiles:
    """One sample: the contents of its files by what follows the key and a dot in their names."""

    key: str
    files: Mapping[str, bytes]


def encode_sample(key: str, decision: RecordedDecision, scene: Labels, about: SampleAbout) -> SampleFiles:
    """Return the files of a sample; equal arguments give equal bytes."""
    arrays: dict[str, Any] = {**decision.labels, **scene}
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **{name: arrays[name] for name in LABELS if name in arrays})
    images = {f"{name}{IMAGE_ENDING}": data for name, data in sorted(decision.images.items())}
    rest = {
        LABELS_SUFFIX: buffer.getvalue(),
        INSTRUCTION_SUFFIX: decision.instruction.encode(),
        ABOUT_SUFFIX: about.model_dump_json().encode(),
    }
    return SampleFiles(key, images | rest)


def pack_samples(samples: Iterable[SampleFiles]) -> Iterator[bytes]:
    """Yield the members of a tar file with the files of samples; they follow each other as samples do.

    Members have no time and no owner, so equal samples give equal bytes, and those of several scenarios may be joined.
    """
    for sample in samples:
        for suffix, data in sample.files.items():
            member = tarfile.TarInfo(f"{sample.key}.{suffix}")
            member.size = len(data)
            yield member.tobuf(tarfile.USTAR_FORMAT)
            yield data
            yield bytes(-len(data) % tarfile.BLOCKSIZE)


def write_members(path: Path, members: Iterable[bytes]) -> tuple[int, str]:
    """Write members of a tar file without its end, whole or not at all; return size [bytes] and checksum.

    It may be lost in a power cut, which its checksum tells. Raises OSError.
    """
    with new_file(path) as file:
        file.writelines(members)
    return path.stat().st_size, compute_file_checksum(path)


def read_members(paths: Iterable[Path]) -> Iterator[bytes]:
    """Yield the content of files that `write_members` wrote, one after the other. Raises OSError."""
    for path in paths:
        with open_regular(path, MAX_CHECKED_BYTES) as file:
            while piece := file.read(READ_BYTES):
                yield piece


def write_shard(path: Path, members: Iterable[bytes]) -> tuple[int, str]:
    """Write a shard, a tar file, whole or not at all; return its size [bytes] and checksum. Raises OSError."""
    with new_file(path) as file:
        file.writelines(members)
        end_bytes = 2 * tarfile.BLOCKSIZE  # two empty blocks end an archive, which is a whole number of records
        file.write(bytes(end_bytes + -(file.tell() + end_bytes) % tarfile.RECORDSIZE))
        file.flush()
        os.fsync(file.fileno())
    return path.stat().st_size, compute_file_checksum(path)
