"""Read shards: the files of each sample, checked and decoded. Errors name the shard and the key."""

import io
import tarfile
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from PIL import UnidentifiedImageError
from pydantic import ValidationError

from mdrive_sumo.core.checksum import compute_file_checksum
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.input_files import open_regular, read_bytes
from mdrive_sumo.learning.sample_format import (
    ABOUT_SUFFIX,
    DATASET_FILE,
    FORMAT,
    IMAGE_ENDING,
    INSTRUCTION_SUFFIX,
    LABELS,
    LABELS_SUFFIX,
    DatasetFile,
    LabelArray,
    SampleAbout,
    ShardEntry,
    decode_image,
)
from mdrive_sumo.scenario.scenario import describe_first_error

REMEDY = "`learn data` makes the shard again"
_NPZ_ERRORS = (
    zipfile.BadZipFile, zlib.error, ValueError, OSError, EOFError, KeyError, SyntaxError, NotImplementedError,
)  # fmt: skip
"""What numpy and zipfile raise for a damaged archive."""


@dataclass(frozen=True, slots=True)
class StoredSample:
    """The undecoded files of one sample."""

    place: str
    """Shard and key, for errors."""
    key: str
    files: Mapping[str, bytes]
    """Contents of its files by what follows the key and a dot in their names."""

    def get_file(self, suffix: str) -> bytes:
        """Return the content of a file. Raises InputError if it is missing."""
        if suffix not in self.files:
            raise InputError(f"{self.place}: expected a file {self.key}.{suffix}, found none")
        return self.files[suffix]

    def read_labels(self) -> dict[str, npt.NDArray[Any]]:
        """Return the arrays of `LABELS`. Raises InputError for missing arrays, and for other types or shapes."""
        try:
            with np.load(io.BytesIO(self.get_file(LABELS_SUFFIX)), allow_pickle=False) as archive:
                arrays = {name: archive[name] for name in archive.files}
        except _NPZ_ERRORS as error:
            reason = " ".join(str(error).split())[:120]
            raise InputError(f"{self.place}: {LABELS_SUFFIX}: expected an archive of arrays, found {reason}") from None
        sizes: dict[str, int] = {}
        for name, wanted in LABELS.items():
            if name not in arrays:
                if wanted.is_optional:
                    continue
                raise InputError(f"{self.place}: {LABELS_SUFFIX}: expected an array {name}, found none")
            self._check(name, wanted, arrays[name], sizes)
        return arrays

    def _check(self, name: str, wanted: LabelArray, found: npt.NDArray[Any], sizes: dict[str, int]) -> None:
        fits = found.dtype.name == wanted.dtype and len(found.shape) == len(wanted.shape)
        if fits:
            known = [size if isinstance(size, int) else sizes.get(size) for size in wanted.shape]
            fits = all(a in (None, b) for a, b in zip(known, found.shape, strict=True))
        if not fits:
            shape = ", ".join(map(str, wanted.shape))
            raise InputError(
                f"{self.place}: {LABELS_SUFFIX}: {name}: expected {wanted.dtype} of shape ({shape}),"
                f" found {found.dtype.name} of shape {found.shape}"
            )
        sizes |= {size: length for size, length in zip(wanted.shape, found.shape, strict=True) if isinstance(size, str)}

    def read_image(self, name: str, size: tuple[int, int]) -> npt.NDArray[np.uint8]:
        """Return the pixels (H, W, 3) of the image RIG-CAMERA; size: (H, W). Raises InputError."""
        suffix = f"{name}{IMAGE_ENDING}"
        try:
            pixels = decode_image(self.get_file(suffix))
        except OSError as error:
            reason = "no image" if isinstance(error, UnidentifiedImageError) else error
            raise InputError(f"{self.place}: {suffix}: expected a JPEG image, found {reason}") from None
        if pixels.shape[:2] != size:
            raise InputError(
                f"{self.place}: {suffix}: expected {size[1]} x {size[0]} pixels,"
                f" found {pixels.shape[1]} x {pixels.shape[0]}"
            )
        return pixels

    def read_instruction(self) -> str:
        """Return the instruction. Raises InputError."""
        try:
            return self.get_file(INSTRUCTION_SUFFIX).decode()
        except UnicodeDecodeError:
            raise InputError(f"{self.place}: {INSTRUCTION_SUFFIX}: expected UTF-8 text, found other bytes") from None

    def read_about(self) -> SampleAbout:
        """Return where the sample comes from. Raises InputError."""
        try:
            return SampleAbout.model_validate_json(self.get_file(ABOUT_SUFFIX))
        except ValidationError as error:
            raise InputError(f"{self.place}: {ABOUT_SUFFIX}: {describe_first_error(error)}") from None


def load_dataset_file(folder: Path) -> DatasetFile:
    """Return the description of a data set. Raises InputError, also for another version of the format."""
    path = folder / DATASET_FILE
    try:
        return DatasetFile.model_validate_json(read_bytes(path))
    except OSError as error:
        raise InputError(f"{path}: expected a data set of `mdrive-sumo learn data`, found {error.strerror}") from None
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        if first["loc"] == ("format",):
            raise InputError(f"{path}: expected the format {FORMAT}, found {str(first['input'])[:60]!r}") from None
        raise InputError(f"{path}: {describe_first_error(error)}") from None


def iterate_shard(path: Path, entry: ShardEntry) -> Iterator[StoredSample]:
    """Yield the samples of a shard in order. Raises InputError for a shard that is not as `dataset.json` says.

    It never yields more samples than that. The checksum is compared last, so that what is missing is named before.
    """
    found = 0
    for found, sample in enumerate(_group_members(path, entry.bytes), start=1):
        if found <= entry.samples:
            yield sample
    if found != entry.samples:
        raise InputError(f"{path}: expected {entry.samples} samples, found {found}; {REMEDY}")
    if (checksum := compute_file_checksum(path)) != entry.checksum:
        raise InputError(f"{path}: expected the checksum {entry.checksum:.23}..., found {checksum:.23}...; {REMEDY}")


def _group_members(path: Path, size: int) -> Iterator[StoredSample]:
    key, files = "", dict[str, bytes]()
    for name, data in _read_members(path, size):
        prefix, _, suffix = name.partition(".")
        if prefix != key and files:
            yield StoredSample(f"{path}: {key}", key, files)
            files = {}
        key = prefix
        files[suffix] = data
    if files:
        yield StoredSample(f"{path}: {key}", key, files)


def _read_members(path: Path, size: int) -> Iterator[tuple[str, bytes]]:
    """Yield name and content of every member."""
    last = "its beginning"
    try:
        if (found := path.stat().st_size) != size:
            raise InputError(f"{path}: expected {size} bytes, found {found}; {REMEDY}")
        with open_regular(path, size) as content, tarfile.open(fileobj=content, mode="r:") as shard:
            for member in shard:
                file = shard.extractfile(member)
                data = b"" if file is None else file.read()
                if len(data) != member.size:
                    raise tarfile.ReadError("unexpected end of data")
                last = member.name
                yield member.name, data
    except tarfile.TarError as error:
        raise InputError(f"{path}: expected a tar file, found after {last}: {error}") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
