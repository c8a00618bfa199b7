"""Fills the temporary folder: one big file, then many of 1 MB."""

import errno
from pathlib import Path

from tell import tell


def fill(path: Path, most: int) -> tuple[int, str]:
    written = 0
    with path.open("wb", buffering=0) as file:
        try:
            while written < most:
                written += file.write(b"x" * 65536)
        except OSError as error:
            return written, errno.errorcode[error.errno or 0]
    return written, ""


one, one_ended = fill(Path("/tmp/one"), 1 << 30)
Path("/tmp/one").unlink()
total, ended = 0, ""
while not ended and total < 1 << 30:
    written, ended = fill(Path(f"/tmp/{total}"), 1 << 20)
    total += written
tell(one=one, one_ended=one_ended, total=total, ended=ended)
