"""Read the arrays of a recording from strangers: name, type, shape and size are checked before memory is taken.

numpy's own reader allocates what the header of an array announces, and raises whatever Python's tokenizer raises.
"""

import io
import math
import tokenize
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.input_files import open_regular
from mdrive_sumo.episode.episode_schema import ARRAYS, OF_RADIO

MAX_BYTES = 2**30
"""Bytes of all arrays of a recording together; the largest of the benchmark have 3 MB."""
MAX_ARRAY_HEADER = 1000
"""Characters; numpy writes about 120."""
_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
_SUFFIX = ".npy"
_HEADER_ERRORS = (
    ValueError, SyntaxError, tokenize.TokenError, RecursionError, MemoryError, TypeError, KeyError, AttributeError,
)  # fmt: skip
"""What numpy's parser of array headers raises."""

Arrays = dict[str, npt.NDArray[Any]]


def read_arrays(path: Path) -> Arrays:
    """Return the arrays of `ARRAYS` that an .npz file has. Raises OSError, zipfile.BadZipFile, zlib.error, ValueError.

    Raises InputError for a file that announces more than `MAX_BYTES`.
    """
    with open_regular(path, MAX_BYTES) as file, zipfile.ZipFile(file) as archive:
        members = archive.infolist()
        _check_members(path, members)
        return {one.filename.removesuffix(_SUFFIX): _read_array(archive, one) for one in members}


def _check_members(path: Path, members: list[zipfile.ZipInfo]) -> None:
    names = [one.filename for one in members]
    unknown = sorted(set(names) - {name + _SUFFIX for name in ARRAYS})
    if unknown or len(set(names)) < len(names):
        raise ValueError(f"arrays of a recording expected, each once, found {ascii(unknown or names)[:100]}")
    if any(one.compress_type not in _METHODS or one.flag_bits & 1 for one in members):
        raise ValueError("members stored or deflated expected, found others")
    if (total := sum(one.file_size for one in members)) > MAX_BYTES:
        raise InputError(f"{path}: expected a recording of at most {MAX_BYTES} bytes, found one of {total}")


def _read_array(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> npt.NDArray[Any]:
    """Return an array; raise ValueError for one whose header is not that of `ARRAYS` or does not fit its size."""
    name = member.filename.removesuffix(_SUFFIX)
    with archive.open(member) as file:
        head = io.BytesIO(file.read(12 + MAX_ARRAY_HEADER))
        shape, fortran, dtype = _read_header(name, head)
        size = math.prod(shape) * dtype.itemsize
        if head.tell() + size != member.file_size:
            raise ValueError(f"{name}: the shape {str(shape)[:60]} does not fit its {member.file_size} bytes")
        data = bytearray(size)
        begin = head.read()[:size]
        data[: len(begin)] = begin
        _read_into(file, memoryview(data)[len(begin) :])
        if file.read(1):  # read to the end: only then the checksum is compared
            raise ValueError(f"{name}: more bytes than announced")
    return np.frombuffer(data, dtype).reshape(shape, order="F" if fortran else "C")


def _read_into(file: Any, view: memoryview) -> None:
    while view:
        count = file.readinto(view)
        if not count:
            raise ValueError("fewer bytes than announced")
        view = view[count:]


def _read_header(name: str, head: io.BytesIO) -> tuple[tuple[int, ...], bool, "np.dtype[Any]"]:
    try:
        np.lib.format.read_magic(head)  # of another version, the next line fails
        shape, fortran, dtype = np.lib.format.read_array_header_1_0(head, max_header_size=MAX_ARRAY_HEADER)
    except _HEADER_ERRORS:
        raise ValueError(f"{name}: damaged header") from None
    wanted = ARRAYS[name]
    if dtype.name not in wanted.dtype or dtype.byteorder == ">" or len(shape) != len(wanted.shape):
        raise ValueError(f"{name}: {' or '.join(wanted.dtype)} of {len(wanted.shape)} dimensions expected")
    return shape, fortran, dtype


def check_shapes(arrays: Mapping[str, npt.NDArray[Any]], sizes: Mapping[str, int]) -> None:
    """Raise ValueError unless every array is there in the shape of `ARRAYS`; `sizes` are the known dimensions.

    Those of a radio may be missing.
    """
    size_by_symbol = dict(sizes)
    for name, wanted in ARRAYS.items():
        if name not in arrays and name in OF_RADIO:
            continue
        if name not in arrays:
            raise ValueError(f"no array {name}")
        for symbol, size in zip(wanted.shape, arrays[name].shape, strict=True):
            if size != (symbol if isinstance(symbol, int) else size_by_symbol.setdefault(symbol, size)):
                raise ValueError(f"{name}: arrays of different shapes")
