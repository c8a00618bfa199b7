"""Eight processes that together want 4.8 GB: no limit of a single process stops that."""

import os
import time

from tell import tell

for _ in range(8):
    if os.fork() == 0:
        held = bytearray(b"x") * (600 << 20)
        time.sleep(600)
try:
    while os.wait()[1] == 9:
        continue
except ChildProcessError:
    tell(all_killed=True)
