"""A checksum of the code that does not change while tests of real workers run."""

import pytest
from testing.evaluation_fakes import steady
from testing.paths import TESTS


@pytest.fixture
def steady_code(monkeypatch: pytest.MonkeyPatch) -> None:
    """Replace the checksum in this process; the workers' programs do it themselves."""
    monkeypatch.setattr("server.phase_suites.compute_code_checksum", steady)
    monkeypatch.setenv("PYTHONPATH", str(TESTS))  # for the module that workers run: `evaluation_real.COMMAND`
