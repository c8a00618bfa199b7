"""Fills shared memory in each of its forms."""

import errno
import os

from tell import tell


def fill(fd: int) -> tuple[int, str]:
    written = 0
    try:
        while written < 1 << 30:
            written += os.write(fd, b"x" * 65536)
    except OSError as error:
        return written, errno.errorcode[error.errno or 0]
    return written, ""


tell(
    file=fill(os.open("/dev/shm/x", os.O_CREAT | os.O_WRONLY, 0o600)),
    unnamed=fill(os.memfd_create("x")),
)
