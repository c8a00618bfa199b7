"""Summary and targets of converted suites."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from testing.convert_command import run

from real2sim.clean import clean_recording
from real2sim.clean.cleaning_report import ChangeReason, CleaningReport, TrackChange
from real2sim.fidelity_targets import (
    FidelityTarget,
    build_logged_drive_target,
    build_lost_target,
    count_sumo_driven,
    find_silently_lost,
)
from real2sim.fit import Disposition, TrackRole
from real2sim.logged_drive import LoggedDrive, LoggedInfraction
from real2sim.pipeline.log_source import LogSource, read_log
from real2sim.pipeline.quality_file import load_quality
from real2sim.pipeline.suite_summary import format_summary, summarize_suite


@pytest.mark.slow
def test_summary_of_a_suite(suite: Path) -> None:
    table = run("--summary", suite)
    assert table.exit_code == 0
    assert "all 1" in table.stdout
    assert "Every figure meets its target." in table.stdout
    figures = json.loads(run("--summary", suite, "--json").stdout)
    assert figures["all"]["moving_vehicles"] == 4
    assert figures["misses"] == {}


def test_summary_names_what_misses_its_target(suite: Path, tmp_path: Path) -> None:
    shutil.copytree(suite, tmp_path / "worse")
    path = tmp_path / "worse" / "small" / "quality.json"
    quality = load_quality(path)
    far = FidelityTarget(name="error p95", value=1.5, limit=1.0, unit="m")
    path.write_text(quality.model_copy(update={"targets": (far,), "passed": False}).model_dump_json())
    table = run("--summary", tmp_path / "worse")
    assert table.exit_code == 1
    assert "small: error p95: 1.5 m, at most 1 m wanted" in table.stdout


def test_summary_adds_counts_and_takes_the_worst_error(suite: Path) -> None:
    one = load_quality(suite / "small" / "quality.json")
    worse = one.model_copy(update={"fidelity": one.fidelity.model_copy(update={"error_p95": 9.0, "teleports": 2})})
    found = summarize_suite([one, worse, one]).all
    assert (found.scenario, found.moving_vehicles, found.teleports, found.error_p95) == ("all 3", 12, 2, 9.0)
    assert found.by_sumo == 6


def test_summary_names_the_worst_vehicle_and_contacts(suite: Path) -> None:
    one = load_quality(suite / "small" / "quality.json")
    far = tuple(error.model_copy(update={"worst": 7.5}) for error in one.closeness.errors)
    close = one.closeness.model_copy(update={"errors": far, "contacts": (("11", "12", 3),)})
    met = one.fidelity.model_copy(update={"collisions": (("11", "12", 2),)})
    found = summarize_suite([one, one.model_copy(update={"closeness": close, "fidelity": met})])
    assert (found.all.worst_at_5s, found.all.contacts, found.scenarios[0].contacts, found.all.collisions) == (
        7.5,
        1,
        0,
        1,
    )
    assert "5 s of the median scenario" in format_summary(found)


@pytest.mark.parametrize(
    ("arguments", "where", "sentence"),
    [
        ((), "nowhere", "expected a suite folder, found none"),
        ((), ".", "expected quality.json beside scenario.json of converted logs, found none"),
        (("commonroad", "x.xml", "--out", "y"), ".", "expected no source beside it, found commonroad"),
    ],
)
def test_summary_refuses(tmp_path: Path, arguments: tuple[str, ...], where: str, sentence: str) -> None:
    done = run("--summary", tmp_path / where, *arguments)
    assert done.exit_code == 2
    assert sentence in done.stderr


@pytest.mark.parametrize(
    ("target", "met"),
    [
        (FidelityTarget(name="a", value=3.0, limit=3.0), True),
        (FidelityTarget(name="a", value=3.1, limit=3.0), False),
        (FidelityTarget(name="a", value=0.9, limit=0.9, at_least=True), True),
        (FidelityTarget(name="a", value=0.8, limit=0.9, at_least=True), False),
        (FidelityTarget(name="a", value=None, limit=0.9), None),
    ],
)
def test_targets(target: FidelityTarget, met: bool | None) -> None:
    assert target.met is met


def test_a_track_of_the_source_may_be_lost_with_a_reason_only(small: tuple[Path, Path]) -> None:
    log, map_ = small
    recording = read_log(LogSource("v2xpnp", log, (map_,)))
    cleaned = clean_recording(recording)
    roles = {track.id: TrackRole(Disposition.ACTOR) for track in cleaned.tracks}
    assert build_lost_target(recording, cleaned, roles).value == 0
    assert find_silently_lost(recording, cleaned, roles | {"11": TrackRole(Disposition.LEFT_OUT)}) == ("11",)
    assert (
        find_silently_lost(recording, cleaned, roles | {"11": TrackRole(Disposition.LEFT_OUT, "it left the map")}) == ()
    )
    forgotten = replace(cleaned, successors={k: v for k, v in cleaned.successors.items() if k != "12"})
    assert find_silently_lost(recording, forgotten, {k: v for k, v in roles.items() if k != "12"}) == ("12",)
    short = TrackChange(ChangeReason.TOO_SHORT, "12", 3, "seen in 3 frames only")
    said = replace(cleaned, report=CleaningReport((*cleaned.report.changes, short)))
    assert find_silently_lost(recording, said, {k: v for k, v in roles.items() if k != "12"}) == ()


def test_a_whole_track_that_is_left_out_as_a_teleport_is_lost_with_its_reason() -> None:
    whole = TrackChange(ChangeReason.TELEPORT, "7", 3, "left out of 1", is_whole_track=True)
    assert CleaningReport((whole, TrackChange(ChangeReason.TELEPORT, "8", 1, "a step"))).drop_reason_by_track == {
        "7": "left out of 1"
    }


@pytest.mark.parametrize(("mode", "driven"), [("reactive", 2), ("hybrid", 2), ("replay", 0)])
def test_cavs_and_scripted_vehicles_are_not_driven_by_sumo(suite: Path, mode: str, driven: int) -> None:
    quality = load_quality(suite / "small" / "quality.json")
    assert (quality.by_sumo, quality.fidelity.moving_vehicles) == (2, 4)
    roles = {role.track: TrackRole(role.became) for role in quality.fit}
    assert count_sumo_driven(quality.fidelity, roles, mode) == driven
    page = (suite / "small" / "conversion.html").read_text()
    assert "SUMO drives 2 of the moving vehicles (reactive)" in page
    assert '<td class="number">2 of 4</td>' in (suite / "conversion.html").read_text()


def test_every_target_has_a_tile(suite: Path) -> None:
    page = (suite / "small" / "conversion.html").read_text()
    targets = load_quality(suite / "small" / "quality.json").targets
    assert len(targets) == 16
    for target in targets:
        assert f"<span>{target.name}</span>" in page


def test_the_logged_drive_is_part_of_quality_verdict_summary_and_page(suite: Path, tmp_path: Path) -> None:
    quality = load_quality(suite / "small" / "quality.json")
    assert quality.logged_drive is not None
    assert [(cav.end, cav.infractions) for cav in quality.logged_drive.cavs] == [("log ended", ())] * 2
    crash = LoggedInfraction(kind="stop-sign", time_s=1.0, from_s=1.0, to_s=1.0, x=0.0, y=0.0, factor=0.8, other="s")
    seen = crash.model_copy(update={"confirmed_by": "me", "reason": "rolls"})
    cav = quality.logged_drive.cavs[0].model_copy(update={"infractions": (crash, seen)})
    worse = quality.model_copy(update={"logged_drive": LoggedDrive(cavs=(cav,))})
    assert worse.logged_drive is not None
    target = build_logged_drive_target(worse.logged_drive)
    assert f"(CAV {cav.id}: stop-sign at 1 s, factor 0.8, at (0.0, 0.0))" in target.format_sentence()
    found = summarize_suite([quality, worse])
    assert [(row.logged_infractions, row.confirmed_infractions) for row in found.scenarios] == [(0, 0), (1, 1)]
    assert "1+1" in format_summary(found)
    before = tmp_path / "quality.json"  # of a version without this check
    before.write_text(
        json.dumps({k: v for k, v in json.loads(quality.model_dump_json()).items() if k != "logged_drive"})
    )
    assert load_quality(before).logged_drive is None
    assert "Logged drive of the CAVs" in (suite / "small" / "conversion.html").read_text()


def test_a_missing_file_of_confirmed_infractions_is_one_sentence(small: tuple[Path, Path], tmp_path: Path) -> None:
    done = run("v2xpnp", small[0], "--map", small[1], "--out", tmp_path / "out", "--confirmed", tmp_path / "no.toml")
    assert (done.exit_code, (tmp_path / "out").exists()) == (2, False)
    assert "no.toml: cannot be read" in done.stderr


def test_an_authored_suite_has_no_summary(tmp_path: Path) -> None:
    (tmp_path / "conversion.md").touch()
    done = run("--summary", tmp_path)
    assert done.exit_code == 2
    assert "found none (authored sources have conversion.md instead)" in done.stderr
