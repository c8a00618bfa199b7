"""Looks for other processes, then kills what it can: only its own box."""

import os
import signal
from pathlib import Path

from tell import tell

seen = sorted(int(entry.name) for entry in Path("/proc").iterdir() if entry.name.isdigit())
tell(seen=seen, uid=os.getuid(), groups=os.getgroups(), parent=os.getppid())
for pid in (os.getppid(), 1, -1):
    try:
        os.kill(pid, signal.SIGKILL)
    except OSError:
        continue
tell(survived=True)
