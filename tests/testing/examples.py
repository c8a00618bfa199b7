"""How many examples an expensive property gets."""

import os


def examples(count: int) -> int:
    """All of them in `make test-all`, a quarter elsewhere."""
    return count if os.environ.get("MDRIVE_HYPOTHESIS") == "all" else max(1, count // 4)
