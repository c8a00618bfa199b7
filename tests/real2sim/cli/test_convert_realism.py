"""`convert --realism`: the tables of a suite converted from a log, and what is refused."""

import json
from pathlib import Path

import pytest
from testing.convert_command import run

from real2sim.traffic_fidelity import drawn_traffic
from real2sim.traffic_fidelity.realism_score import MEASURES

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def table(suite: Path) -> dict[str, dict[str, float]]:
    done = run("--realism", suite, "--rollouts", "2", "--json")
    assert done.exit_code == 0, done.output
    found = json.loads(done.stdout)
    assert (found["scenarios"], found["vehicles"], found["rollouts"]) == (1, 2, 2)
    assert found["seconds"] == pytest.approx(2 * 4.0, abs=0.3)
    return {row["traffic"]: row["likelihoods"] | {"realism": row["realism"]} for row in found["rows"]}


def test_the_log_is_more_likely_under_itself_than_under_any_simulation(table: dict[str, dict[str, float]]) -> None:
    own = table.pop("log replay")
    assert set(own) == {"realism", *MEASURES}
    assert all(row["realism"] <= own["realism"] for row in table.values())


def test_traffic_on_the_schedule_of_the_log_is_more_like_it_than_free_traffic(
    table: dict[str, dict[str, float]],
) -> None:
    assert table["scheduled"]["speed"] > table["free"]["speed"]
    assert table["scheduled"]["realism"] > table["SUMO's defaults"]["realism"]


def test_the_command_prints_both_tables_also_of_drawn_traffic(suite: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(drawn_traffic, "DRAWN", {"town-quiet": ("crossing",)})
    monkeypatch.setattr(drawn_traffic, "SEEDS", (1,))
    done = run("--realism", suite, "--rollouts", "1", "--drawn")
    assert done.exit_code == 0, done.output
    drawn = [line.split("  ")[0] for line in done.stdout.splitlines() if line.startswith("drawn")]
    assert drawn == ["drawn: town-quiet"]
    assert "1 scenarios, 2 vehicles driven by SUMO" in done.stdout
    assert done.stdout.count("SUMO's defaults") == 2


def test_what_has_no_log_and_what_stands_beside_a_source_is_refused(suite: Path) -> None:
    packaged = run("--realism", "interaction")
    assert packaged.exit_code == 2
    assert "log.npz: expected the log of a converted scenario, found none" in packaged.stderr
    both = run("--realism", suite, "--summary", suite)
    assert both.exit_code == 2
    assert "--summary: expected no --realism beside it: one report a call" in both.stderr


@pytest.mark.usefixtures("in_process")
def test_real_logs_are_more_like_scheduled_traffic_than_like_sumos_defaults(shared_data: Path, tmp_path: Path) -> None:
    logs = shared_data / "real_logs" / "commonroad"
    converted = run("commonroad", logs, "--out", tmp_path / "suite", "--workers", "1")
    assert converted.exit_code in (0, 1), converted.output
    done = run("--realism", tmp_path / "suite", "--rollouts", "2", "--json")
    rows = {row["traffic"]: row["realism"] for row in json.loads(done.stdout)["rows"]}
    assert rows["log replay"] > rows["scheduled"] > rows["SUMO's defaults"]
