"""Looks for other processes, then kills what it can: only its own box."""

import os
import signal

from tell import tell


def exists(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        pass
    return True


seen = [pid for pid in range(1, 70_000) if exists(pid)]
tell(seen=seen, uid=os.getuid(), groups=os.getgroups(), parent=os.getppid())
for pid in (os.getppid(), 1, -1):
    try:
        os.kill(pid, signal.SIGKILL)
    except OSError:
        continue
tell(survived=True)
