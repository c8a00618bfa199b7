"""Prints 40 MB."""

import os

from tell import tell

for _ in range(640):
    os.write(1, b"x" * 65535 + b"\n")
os.write(2, b"the end\n")
tell(written=True)
