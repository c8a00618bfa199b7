"""Leaves a child that has left the session and forked again, then ends as if all were well."""

import os
import time

from tell import tell

if os.fork() == 0:
    os.setsid()
    if os.fork() == 0:
        time.sleep(600)
    os._exit(0)
time.sleep(0.2)
tell(left=True)
