"""`mdrive-sumo convert` for logs: the suite that is written, its quality.json, batches, windows, exit codes."""

import io
import json
import shutil
import signal
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from testing.small_log import FRAMES, STATION, recording, road, track, write_small_log

from mdrive_sumo.cli import main
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.roads import find_network_folder, load_road_map
from mdrive_sumo.scenario.checks import check_scenario
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.suite import load_suite
from real2sim.atomic_folder import atomic_folder
from real2sim.clean import clean_recording
from real2sim.clean.cleaning_report import ChangeReason, CleaningReport, TrackChange
from real2sim.cli.log_options import show_progress
from real2sim.fidelity_targets import FidelityTarget, build_lost_target, count_sumo_driven, find_silently_lost
from real2sim.fit.background_vehicle import median_size
from real2sim.fit.disposition import Disposition, TrackRole
from real2sim.pipeline.cav_selection import select_cav_tracks
from real2sim.pipeline.log_conversion import make_scenario_id, split_into_windows
from real2sim.pipeline.log_source import LogSource, read_log
from real2sim.pipeline.quality_file import load_quality
from real2sim.pipeline.suite_summary import format_summary, summarize_suite
from real2sim.recording import ObserverView
from real2sim.writers.v2xpnp import write_v2xpnp
from real2sim.writers.v2xpnp_map import write_vector_map

LOGS = Path("real_logs")
SCENE = "scenarionet_nuscenes/sd_nuscenes_scene-0757.pkl"


def run(*arguments: object) -> Result:
    return CliRunner().invoke(main, ["convert", *map(str, arguments)])


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    return write_small_log(tmp_path_factory.mktemp("small"))


@pytest.fixture(scope="module")
def suite(small: tuple[Path, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("suites") / "my suite"
    log, map_ = small
    done = run("v2xpnp", log, "--map", map_, "--out", out, "--report")
    assert done.exit_code == 0, done.output
    assert "1 of 1 scenarios meet every target" in done.stdout
    return out


def only(suite: Path) -> Scenario:
    (scenario,) = load_suite(str(suite)).scenarios
    return scenario


def test_a_log_becomes_a_suite_that_fits_its_network(suite: Path) -> None:
    scenario = only(suite)
    check_scenario(scenario, load_road_map(find_network_folder(scenario.network, suite)))
    assert (scenario.id, scenario.bucket, scenario.category) == ("small", "V2XPnP", "real2sim")
    assert [ego.start_speed for ego in scenario.egos] == pytest.approx([8.0, 9.0], abs=0.1)
    assert [ego.start.x for ego in scenario.egos] == pytest.approx([20.0, 30.0], abs=0.1)
    assert [ego.start.y for ego in scenario.egos] == pytest.approx([0.0, 3.5], abs=0.1)
    assert [vehicle.id for vehicle in scenario.background.vehicles] == ["11", "12"]
    assert {actor.id: (actor.kind, actor.motion.type) for actor in scenario.actors} == {
        "13": ("pedestrian", "replay"),
        "14": ("vehicle", "standing"),
    }
    (station,) = scenario.rsus
    assert (station.id, station.x, station.y) == ("rsu1", *STATION)
    assert load_suite(str(suite)).name == "my_suite"


def test_it_can_be_driven(suite: Path, tmp_path: Path) -> None:
    done = CliRunner().invoke(
        main, ["eval", "--suite", str(suite), "--agent", "idm", "--workers", "1", "--out", str(tmp_path / "run")]
    )
    assert done.exit_code == 0, done.output
    (result,) = json.loads((tmp_path / "run" / "results.json").read_text())["scenarios"]
    assert result["ds"] > 90


def test_quality_json_tells_all_steps(suite: Path) -> None:
    quality = load_quality(suite / "small" / "quality.json")
    assert (quality.source, quality.log, quality.window_s, quality.mode) == ("v2xpnp", "small", None, "reactive")
    assert quality.fidelity.moving_vehicles == 4
    assert quality.fidelity.frames == FRAMES
    assert quality.network.lanes == 2
    assert quality.network.centre_p95_m < 0.05
    assert quality.closeness.vehicles == 2
    assert {role.track: role.became.value for role in quality.fit} == {
        "cav_1": "CAV",
        "cav_2": "CAV",
        "11": "background",
        "12": "background",
        "13": "actor",
        "14": "standing",
    }
    assert quality.cleaning.counts == {
        reason: sum(change.reason == reason for change in quality.cleaning.changes)
        for reason in quality.cleaning.counts
    }
    assert quality.passed
    assert quality.misses == ()
    assert {target.name: target.met for target in quality.targets}["wrong-way frames"] is True


def test_the_pages_lie_beside(suite: Path) -> None:
    assert 'href="small/conversion.html"' in (suite / "conversion.html").read_text()
    assert "<svg" in (suite / "small" / "conversion.html").read_text()


def test_the_same_log_gives_the_same_bytes(suite: Path, small: tuple[Path, Path], tmp_path: Path) -> None:
    done = run("v2xpnp", small[0], "--map", small[1], "--out", tmp_path / "again", "--name", "my_suite", "--report")
    assert done.exit_code == 0, done.output
    files = sorted(path.relative_to(suite) for path in suite.rglob("*") if path.is_file())
    assert len(files) >= 8
    assert files == sorted(path.relative_to(tmp_path / "again") for path in tmp_path.rglob("*") if path.is_file())
    for file in files:
        assert (suite / file).read_bytes() == (tmp_path / "again" / file).read_bytes(), file


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


def test_summary_tells_the_worst_vehicle_and_who_touches(suite: Path) -> None:
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


def test_modes_cavs_agents_and_a_window(small: tuple[Path, Path], tmp_path: Path) -> None:
    options = ("--map", small[1], "--out", tmp_path / "out", "--traffic", "hybrid", "--cavs", "2", "--window", "1,4")
    done = run("v2xpnp", small[0].parent, *options, "--agents", "1,2")
    assert done.exit_code == 0, done.output
    scenario = only(tmp_path / "out")
    assert scenario.id == "small_1-4s"
    assert [ego.id for ego in scenario.egos] == ["cav_2"]
    assert scenario.egos[0].start.x == pytest.approx(39.0, abs=0.1)
    assert scenario.background.mode == "hybrid"
    assert sorted(vehicle.id for vehicle in scenario.background.vehicles) == ["11", "12", "cav_1"]
    assert all(vehicle.log for vehicle in scenario.background.vehicles)
    assert scenario.rsus == ()
    quality = load_quality(tmp_path / "out" / "small_1-4s" / "quality.json")
    assert (quality.mode, quality.window_s) == ("hybrid", (1.0, 4.0))
    assert quality.closeness.mode == "reactive", "poses of the log are close to the log in any case"
    assert "1/1  small, window 1 s to 4 s: passed" in done.stderr


def test_a_cav_of_the_source_that_will_not_do_is_told(tmp_path: Path) -> None:
    """The first car of the source stands for the whole log."""
    (tmp_path / "log").mkdir()
    log = recording()
    tracks = (track("1", 20.0, 0.0, 0.0), *log.views[0].tracks[1:])
    write_v2xpnp(replace(log, views=(ObserverView("log", tracks), log.views[1])), tmp_path / "log" / "small", None, 0)
    write_vector_map(road(), tmp_path / "map.pkl")
    done = run("v2xpnp", tmp_path / "log", "--map", tmp_path / "map.pkl", "--out", tmp_path / "out", "--report")
    assert done.exit_code in (0, 1), done.output
    sentence = "cav_1, a CAV of the source, is not a CAV here: it never moves; driven instead: cav_2"
    scenario = only(tmp_path / "out")
    assert [ego.id for ego in scenario.egos] == ["cav_2"]
    folder = tmp_path / "out" / scenario.id
    assert sentence in scenario.notes
    assert sentence in load_quality(folder / "quality.json").notes
    assert sentence in (folder / "conversion.html").read_text()


def test_a_cav_is_named_by_source_scenario_or_how_it_begins() -> None:
    ids = ("0bfc7d407d09490cbca7", "36209f00d7442a19485f")
    tracks = [track(id_, 20.0, 0.0, 8.0) for id_ in ids]
    cleaned = clean_recording(recording())
    for name in (ids[1], "36209f", "36209f00d7", "3"):
        assert select_cav_tracks((name,), cleaned, tracks, {}) == (ids[1],)
    with pytest.raises(InputError, match=r"CAV 7: expected one of the vehicles \(none is usable\), found none"):
        select_cav_tracks(("7",), cleaned, tracks, {})


def test_an_odd_size_is_bounded_and_told() -> None:
    log = recording()
    tracks = tuple(
        replace(one, length=one.length * 12, width=one.width * 8) if one.id == "11" else one
        for one in log.views[0].tracks
    )
    cleaned = clean_recording(replace(log, views=(ObserverView("log", tracks), log.views[1])))
    told = {change.track: change.detail for change in cleaned.report.list_changes(ChangeReason.SIZE)}
    assert told["11"] == (
        "length 54.00 m is outside the limits of a scenario: 40, width 14.40 m is outside the limits of a scenario: 10"
    )
    (odd,) = [one for one in tracks if one.id == "11"]
    assert median_size(odd) == (40.0, 10.0)
    assert median_size(replace(odd, length=0.0 * odd.length)) == (0.1, 10.0)


def test_a_batch_cut_into_windows_keeps_what_can_be_converted(small: tuple[Path, Path], tmp_path: Path) -> None:
    """Two halves of the log; a second one of the same name, and a broken one, are listed."""
    shutil.copytree(small[0], tmp_path / "twin" / "small")
    shutil.copytree(small[0], tmp_path / "broken")
    (tmp_path / "broken" / "2" / "000007.yaml").unlink()
    paths = (small[0], tmp_path / "twin" / "small", tmp_path / "broken")
    options = ("--map", small[1], "--out", tmp_path / "out", "--every", "2", "--workers", "2")
    done = run("v2xpnp", *paths, *options)
    assert done.exit_code == 2
    errors = [line for line in done.stderr.splitlines() if line.startswith("Error: ")]
    assert len(errors) == 3
    assert sum("expected logs of different names, found small_" in line for line in errors) == 2
    assert sum("found no 000007.yaml" in line for line in errors) == 1
    assert [scenario.id for scenario in load_suite(str(tmp_path / "out")).scenarios] == ["small_0-2s", "small_2-4s"]
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [
        "networks",
        "small_0-2s",
        "small_2-4s",
        "suite.json",
    ]
    assert sorted(path.name for path in (tmp_path / "out" / "networks").iterdir()) == ["small_0-2s", "small_2-4s"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["broken", "out", "twin"]


@pytest.mark.parametrize(
    ("window", "every", "found"),
    [
        (None, 2.0, ((0.0, 2.0), (2.0, 4.0))),
        (None, 3.0, ((0.0, 3.0),)),
        (None, 2.5, ((0.0, 2.5),)),
        ((0.0, 4.0), 2.0, ((0.0, 2.0), (2.0, 4.0))),
        (None, 9.0, ((0.0, 4.0),)),
        ((1.0, 4.0), 2.0, ((1.0, 3.0),)),
    ],
)
def test_windows(
    small: tuple[Path, Path],
    window: tuple[float, float] | None,
    every: float,
    found: tuple[tuple[float, float], ...],
) -> None:
    assert split_into_windows(LogSource("v2xpnp", small[0], (small[1],), None, window), every) == found


def test_windows_outside_of_the_log_are_refused(small: tuple[Path, Path]) -> None:
    with pytest.raises(InputError, match=r"small: expected a window within 0 s to 4 s, found 3 s to 9 s"):
        split_into_windows(LogSource("v2xpnp", small[0], (small[1],), None, (3.0, 9.0)), 1.0)


def test_ids_are_those_of_logs_in_plain_characters() -> None:
    assert make_scenario_id("-a b/c", (0.0, 2.5)) == "a_b_c_0-2.5s"
    assert len(make_scenario_id("x" * 200, (0.0, 2.5))) == 80


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
    assert len(targets) == 14
    for target in targets:
        assert f"<span>{target.name}</span>" in page


def test_a_terminated_conversion_leaves_nothing(tmp_path: Path) -> None:
    before = signal.getsignal(signal.SIGTERM)
    with pytest.raises(KeyboardInterrupt), atomic_folder(tmp_path / "out") as draft:
        (draft / "half").touch()
        signal.raise_signal(signal.SIGTERM)
    assert list(tmp_path.iterdir()) == []
    assert signal.getsignal(signal.SIGTERM) is before


@pytest.mark.parametrize(
    ("source", "wanted"),
    [
        ("scenarionet", "*.pkl"),
        ("commonroad", "*.xml"),
        ("argoverse2", "*.parquet or *.feather"),
        ("interaction", "vehicle_tracks_*.csv"),
    ],
)
def test_a_folder_without_logs(source: str, wanted: str, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    done = run(source, tmp_path / "empty", "--out", tmp_path / "suite")
    assert done.exit_code == 2
    assert f"empty: expected {wanted} in it or below, found none" in done.stderr


def test_an_authored_suite_has_no_summary(tmp_path: Path) -> None:
    (tmp_path / "conversion.md").touch()
    done = run("--summary", tmp_path)
    assert done.exit_code == 2
    assert "found none (authored sources have conversion.md instead)" in done.stderr


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_progress_is_one_live_line_on_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    screen = Terminal()
    monkeypatch.setattr("sys.stderr", screen)
    show_progress(1, 2, "first: passed")
    show_progress(2, 2, "second: passed")
    before, half, end = screen.getvalue().split("\r\x1b[K")
    assert (before, end) == ("", "")
    assert half == "█" * 12 + "░" * 12 + " 1/2  first: passed"


def test_authored_sources_have_the_same_door(tmp_path: Path, shared_data: Path) -> None:
    done = run(
        "mdrive", shared_data / "mdrive/interaction", "--towns", shared_data / "carla_towns", "--out", tmp_path / "a"
    )
    assert done.exit_code == 0, done.output
    assert len(load_suite(str(tmp_path / "a")).scenarios) == 4
    done = run("opendrive", shared_data / "carla_towns" / "Town01.xodr", "--out", tmp_path / "b")
    assert done.exit_code == 0, done.output
    assert (tmp_path / "b" / "networks" / "Town01" / "network.json").is_file()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("source", "path", "more"),
    [
        ("scenarionet", "scenarionet_nuscenes", ()),
        ("commonroad", "commonroad", ()),
        ("argoverse2", "argoverse2/forecasting", ()),
        ("argoverse2", "argoverse2/sensor", ()),
        ("interaction", "interaction", ("--window", "0,40", "--every", "20")),
    ],
)
def test_real_logs(source: str, path: str, more: tuple[str, ...], shared_data: Path, tmp_path: Path) -> None:
    done = run(source, shared_data / LOGS / path, "--out", tmp_path / "suite", "--report", *more)
    assert done.exit_code in (0, 1), done.output
    driven = CliRunner().invoke(
        main, ["eval", "--suite", str(tmp_path / "suite"), "--agent", "idm", "--out", str(tmp_path / "run")]
    )
    assert driven.exit_code == 0, driven.output
    assert run("--summary", tmp_path / "suite").exit_code == done.exit_code
