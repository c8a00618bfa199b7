"""Makes empty files without end: they need no space in the folder, only memory of the kernel."""

from itertools import count
from pathlib import Path

for i in count():
    Path(f"/tmp/{i}").touch()
