"""Which suites a hidden phase may have."""

import json
from pathlib import Path

import pytest
from testing.suite_fakes import make_suite

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.scenario.packaged_suites import find_suite_folder
from server.phase_suites import LoadedPhaseSuites
from server.settings import PhaseSettings, ServerSettings
from server.store.tables import PhaseRow


def phase(suite: str, **options: object) -> tuple[LoadedPhaseSuites, PhaseRow]:
    times = {"opens": "2026-01-01T00:00Z", "closes": "2027-01-01T00:00Z"}
    made = PhaseSettings.model_validate(
        {"id": "final", "title": "Final", "suite": suite, "public": False} | times | options
    )
    new = made.as_new()
    row = PhaseRow(**{name: getattr(new, name) for name in ("id", "title", "suite", "public", "seeds")})
    return LoadedPhaseSuites(ServerSettings(phases=(made,))), row


def listing(folder: Path) -> str:
    """A suite of one's own that only lists a packaged one."""
    folder.mkdir()
    (folder / "suite.json").write_text(json.dumps({"name": "mine", "title": "Mine", "parts": ["interdrive@0"]}))
    return str(folder)


def test_a_hidden_phase_on_scenarios_that_everyone_has_is_refused_unless_told(tmp_path: Path) -> None:
    said = r"phase final: expected hidden .* of the packaged suite interdrive, .*packaged_suite = true"
    for suite in ("interdrive", str(find_suite_folder("interdrive@0")), listing(tmp_path / "listing")):
        suites, row = phase(suite)
        with pytest.raises(InputError, match=said):
            suites.jobs(row)
    suites, row = phase("interdrive", packaged_suite=True)
    assert len(suites.jobs(row)) == 46
    suites, row = phase("interdrive", public=True)
    assert len(suites.jobs(row)) == 46
    suites, row = phase(str(make_suite(tmp_path / "own", *["nap"] * 5).folder))
    assert len(suites.jobs(row)) == 5
