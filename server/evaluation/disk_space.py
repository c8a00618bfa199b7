"""Whether the data folder has room for results."""

import logging
import shutil
from pathlib import Path

from mdrive_sumo.core.errors import InputError

LOG = logging.getLogger("mdrive.worker")
MIN_FREE_BYTES = 64 * 2**20
"""Free disk space without which no job is claimed [bytes]: results that cannot be written count as our failures."""


def has_disk_space(data: Path) -> bool:
    """Return whether the folder has room; write a line into the log if it has none. Raises InputError for no folder."""
    try:
        free = shutil.disk_usage(data).free
    except OSError as error:
        raise InputError(f"data: expected a folder {data}, found none ({error.strerror})") from None
    if free >= MIN_FREE_BYTES:
        return True
    LOG.error("%s: expected %d MiB free, found %d: nothing new is begun", data, MIN_FREE_BYTES // 2**20, free // 2**20)
    return False
