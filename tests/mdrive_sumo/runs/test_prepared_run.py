"""A prepared run: its limit of time, and its folder before the first episode."""

from pathlib import Path

from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.prepared_run import prepare
from mdrive_sumo.runs.run_config import RunConfig


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
