"""Forks without end; every child stays."""

import os
import time

from tell import tell

count = 0
try:
    while count < 5000:
        if os.fork() == 0:
            time.sleep(600)
        count += 1
except OSError:
    tell(count=count)
time.sleep(600)
