"""The files of one sample, and shards of them as tar files in the layout of WebDataset."""

import io
import os
import tarfile
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mdrive_sumo.core.checksum import compute_file_checksum
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


def write_shard(path: Path, samples: Iterable[SampleFiles]) -> tuple[int, str]:
    """Write a shard, whole or not at all; return its size [bytes] and checksum. Raises OSError.

    Members have no time and no owner, so equal samples give equal files.
    """
    with new_file(path) as file:
        with tarfile.open(fileobj=file, mode="w", format=tarfile.USTAR_FORMAT) as shard:
            for sample in samples:
                for suffix, data in sample.files.items():
                    member = tarfile.TarInfo(f"{sample.key}.{suffix}")
                    member.size = len(data)
                    shard.addfile(member, io.BytesIO(data))
        file.flush()
        os.fsync(file.fileno())
    return path.stat().st_size, compute_file_checksum(path)
