"""Archives of arrays (.npz): equal arrays give equal bytes, and a damaged archive is a sentence."""

import io
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.input_files import read_bytes
from mdrive_sumo.core.output_files import write_bytes

MAX_ARCHIVE_BYTES = 2**31
"""A thousand fusion frames of three cars have about 50 MB."""
_NPZ_ERRORS = (
    zipfile.BadZipFile, zlib.error, ValueError, OSError, EOFError, KeyError, SyntaxError, NotImplementedError,
)  # fmt: skip
"""What numpy and zipfile raise for a damaged archive."""


def write_arrays(path: Path, arrays: Mapping[str, Any]) -> None:
    """Write an archive of arrays, compressed. Raises OSError."""
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)
    write_bytes(path, buffer.getvalue())


def read_arrays(path: Path, what: str) -> dict[str, npt.NDArray[Any]]:
    """Return the arrays of an archive by name. what: is in it, for errors. Raises InputError."""
    try:
        content = read_bytes(path, MAX_ARCHIVE_BYTES)
    except OSError as error:
        raise InputError(f"{path}: expected an archive of {what}, found {error.strerror}") from None
    try:
        with np.load(io.BytesIO(content), allow_pickle=False) as archive:
            return {name: archive[name] for name in archive.files}
    except _NPZ_ERRORS as error:
        reason = " ".join(str(error).split())[:120]
        raise InputError(f"{path}: expected an archive of arrays, found a damaged one ({reason})") from None
