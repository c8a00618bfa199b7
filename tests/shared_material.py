"""The read-only material beside the repository, which may be absent: then tests of it skip."""

from pathlib import Path

import pytest

SHARED_DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
NEEDS_SHARED_DATA = "needs ../shared/data"
needs_data = pytest.mark.skipif(not SHARED_DATA.is_dir(), reason=NEEDS_SHARED_DATA)
