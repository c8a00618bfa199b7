"""The read-only material beside the repository, which may be absent: then tests of it skip."""

import pytest

from testing.paths import ROOT

SHARED_DATA = ROOT.parent / "shared" / "data"
NEEDS_SHARED_DATA = "needs ../shared/data"
needs_data = pytest.mark.skipif(not SHARED_DATA.is_dir(), reason=NEEDS_SHARED_DATA)
