"""A prepared run: its limit of time, and its folder before the first episode."""

from pathlib import Path

import pytest
from testing.season_suites import package_seasons

from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.prepared_run import prepare
from mdrive_sumo.runs.run_config import RunConfig
from mdrive_sumo.scenario.suite import load_suite


def test_a_run_with_a_pace_is_given_the_time_that_its_requests_take() -> None:
    """Also one of built-in agents: 2400 ticks of a second each are no hung episode."""
    free, paced = (
        prepare(RunConfig(suite="interdrive@0", scenario="i13*", agent=AgentSpec("idm"), pace_ms=ms))
        for ms in (0.0, 1000.0)
    )
    assert paced.limit_s() >= free.limit_s() + 2400


def test_what_a_killed_start_left_is_removed_from_every_folder(tmp_path: Path) -> None:
    run = prepare(RunConfig(suite="interdrive@0", scenario="i13*", agent=AgentSpec("idm"), out=tmp_path))
    for kind in ("episodes", "cameras", "transcripts"):
        (tmp_path / kind).mkdir()
        (tmp_path / kind / ".0123456789abcdef.part").touch()
    run.make_folders()
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []


def test_results_journal_and_folder_name_the_season(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Season 0 has the names of runs from before there were seasons; a bare name is the newest season."""
    package_seasons(tmp_path / "scenarios", 1, load_suite("interdrive@0").scenarios[1], monkeypatch)
    names = ("interdrive@0", "interdrive@1", "interdrive")
    old, new, bare = (prepare(RunConfig(suite=name, agent=AgentSpec("idm"))) for name in names)
    assert [run.info.suite for run in (old, new, bare)] == ["interdrive", "interdrive@1", "interdrive@1"]
    assert [run.info.suite_label for run in (old, new)] == ["interdrive@0", "interdrive@1"]
    assert [run.info.season for run in (old, new)] == ["0", "1"]
    assert new.fingerprint == bare.fingerprint and new.folder == bare.folder != old.folder
    assert old.folder.name.startswith("interdrive-idm") and new.folder.name.startswith("interdrive_1-idm")
    read = [RunConfig.from_journal(run.fingerprint, run.folder).suite for run in (old, bare)]
    assert read == ["interdrive@0", "interdrive@1"]
