"""`mdrive-sumo convert` for logs: the written suite, quality.json, batches, windows, exit codes."""

import io
import shutil
import signal
from dataclasses import replace
from pathlib import Path

import pytest
from testing.convert_command import run
from testing.interaction_samples import VEHICLES, build_street, write_table
from testing.small_log import FRAMES, STATION, recording, road, track

from mdrive_sumo.core.atomic_folder import atomic_folder
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.roads import find_network_folder, load_road_map
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.episode_job import EpisodeJob, run_job
from mdrive_sumo.scenario.checks import check_scenario
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.suite import load_suite
from real2sim.clean import clean_recording
from real2sim.clean.cleaning_report import ChangeReason
from real2sim.cli.log_options import show_progress
from real2sim.fit.background_vehicle import median_size
from real2sim.fit.cav_selection import select_cav_tracks
from real2sim.pipeline.log_conversion import make_scenario_id, split_into_windows
from real2sim.pipeline.log_source import LogSource
from real2sim.pipeline.quality_file import load_quality
from real2sim.recording import ObserverView
from real2sim.writers.v2xpnp import write_v2xpnp
from real2sim.writers.v2xpnp_map import write_vector_map

pytestmark = [pytest.mark.slow, pytest.mark.costly_fixture]


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


def test_it_can_be_driven(suite: Path) -> None:
    assert run_job(EpisodeJob(suite, "small", AgentSpec("idm"))).ds > 90


def test_quality_json_describes_all_steps(suite: Path) -> None:
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


def test_the_report_pages_are_in_the_suite(suite: Path) -> None:
    assert 'href="small/conversion.html"' in (suite / "conversion.html").read_text()
    assert "<svg" in (suite / "small" / "conversion.html").read_text()


@pytest.mark.usefixtures("in_process")
def test_the_same_log_gives_the_same_bytes(suite: Path, small: tuple[Path, Path], tmp_path: Path) -> None:
    done = run("v2xpnp", small[0], "--map", small[1], "--out", tmp_path / "again", "--name", "my_suite", "--report")
    assert done.exit_code == 0, done.output
    files = sorted(path.relative_to(suite) for path in suite.rglob("*") if path.is_file())
    assert len(files) >= 8
    assert files == sorted(path.relative_to(tmp_path / "again") for path in tmp_path.rglob("*") if path.is_file())
    for file in files:
        assert (suite / file).read_bytes() == (tmp_path / "again" / file).read_bytes(), file


@pytest.mark.usefixtures("in_process")
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


@pytest.mark.usefixtures("in_process")
def test_an_unsuitable_cav_of_the_source_is_reported(tmp_path: Path) -> None:
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


def test_an_implausible_size_is_clamped_and_reported() -> None:
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


@pytest.mark.full
def test_a_batch_cut_into_windows_keeps_what_can_be_converted(small: tuple[Path, Path], tmp_path: Path) -> None:
    """Two halves of the log; a second one of the same name, and a broken one, are listed."""
    shutil.copytree(small[0], tmp_path / "twin" / "small")
    shutil.copytree(small[0], tmp_path / "broken")
    (tmp_path / "broken" / "2" / "000007.yaml").write_text("cut off")
    paths = (small[0], tmp_path / "twin" / "small", tmp_path / "broken")
    options = ("--map", small[1], "--out", tmp_path / "out", "--every", "2", "--workers", "2")
    done = run("v2xpnp", *paths, *options)
    assert done.exit_code == 2
    errors = [line for line in done.stderr.splitlines() if line.startswith("Error: ")]
    assert len(errors) == 3
    assert sum("expected logs of different names, found small_" in line for line in errors) == 2
    assert sum("000007.yaml: expected a last line with its end" in line for line in errors) == 1
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
@pytest.mark.usefixtures("in_process")
def test_windows(
    small: tuple[Path, Path],
    window: tuple[float, float] | None,
    every: float,
    found: tuple[tuple[float, float], ...],
) -> None:
    assert split_into_windows(LogSource("v2xpnp", small[0], (small[1],), None, window), every) == found


@pytest.mark.usefixtures("in_process")
def test_windows_outside_of_the_log_are_refused(small: tuple[Path, Path]) -> None:
    with pytest.raises(InputError, match=r"small: expected a window within 0 s to 4 s, found 3 s to 9 s"):
        split_into_windows(LogSource("v2xpnp", small[0], (small[1],), None, (3.0, 9.0)), 1.0)


def test_ids_are_those_of_logs_in_plain_characters() -> None:
    assert make_scenario_id("-a b/c", (0.0, 2.5)) == "a_b_c_0-2.5s"
    assert len(make_scenario_id("x" * 200, (0.0, 2.5))) == 80


def test_a_terminated_conversion_leaves_nothing(tmp_path: Path) -> None:
    before = signal.getsignal(signal.SIGTERM)
    with pytest.raises(KeyboardInterrupt), atomic_folder(tmp_path / "out") as draft:
        (draft / "half").touch()
        signal.raise_signal(signal.SIGTERM)
    assert list(tmp_path.iterdir()) == []
    assert signal.getsignal(signal.SIGTERM) is before


@pytest.mark.usefixtures("in_process")
def test_every_case_of_an_interaction_table_is_a_scenario(tmp_path: Path) -> None:
    build_street().write(tmp_path / "DR_X.osm")
    rows = [
        f"{case}.0,1,{frame},{100 * frame},car,{case + frame:.1f},2,10,0,0,4.5,1.8"
        for case in (1, 2, 3)
        for frame in range(1, 31)
    ]
    table = write_table(tmp_path / "DR_X_train.csv", *rows, header=f"case_id,{VEHICLES}")
    done = run("interaction", tmp_path, "--cases", "1,3", "--out", tmp_path / "suite", "--workers", "1")
    assert done.exit_code == 0, done.stderr
    assert "DR_X_train.csv, case 3: passed" in done.stderr
    assert [one.id for one in load_suite(str(tmp_path / "suite")).scenarios] == ["DR_X_train_case1", "DR_X_train_case3"]
    twice = run("interaction", table, table, "--cases", "2", "--out", tmp_path / "again", "--workers", "1")
    assert "expected every log once, found it twice (case 2)" in twice.stderr


@pytest.mark.parametrize(
    ("source", "wanted"),
    [
        ("scenarionet", "*.pkl"),
        ("commonroad", "*.xml"),
        ("argoverse2", "*.parquet or *.feather"),
        ("interaction", "vehicle_tracks_*.csv or DR_*.csv"),
    ],
)
def test_a_folder_without_logs(source: str, wanted: str, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    done = run(source, tmp_path / "empty", "--out", tmp_path / "suite")
    assert done.exit_code == 2
    assert f"empty: expected {wanted} in it or below, found none" in done.stderr


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


@pytest.mark.full
def test_authored_sources_share_the_command(tmp_path: Path, shared_data: Path) -> None:
    done = run(
        "mdrive", shared_data / "mdrive/interaction", "--towns", shared_data / "carla_towns", "--out", tmp_path / "a"
    )
    assert done.exit_code == 0, done.output
    assert len(load_suite(str(tmp_path / "a")).scenarios) == 4
    done = run("opendrive", shared_data / "carla_towns" / "Town01.xodr", "--out", tmp_path / "b")
    assert done.exit_code == 0, done.output
    assert (tmp_path / "b" / "networks" / "Town01" / "network.json").is_file()
