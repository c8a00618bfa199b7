"""Starts 5000 threads."""

import threading
import time

from tell import tell

count = 0
try:
    while count < 5000:
        threading.Thread(target=time.sleep, args=(600,), daemon=True).start()
        count += 1
except RuntimeError:
    tell(count=count)
time.sleep(600)
