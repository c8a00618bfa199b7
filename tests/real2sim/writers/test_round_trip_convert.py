"""Known scenes written as V2XPnP, converted by the command, and driven."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from testing.busy_log import BUSY, QUIET, WAYS, Crowd, make_busy_log
from testing.convert_command import run
from testing.local_executor import LocalExecutor
from testing.real_logs import READ
from testing.round_trip import as_truth

from mdrive_sumo.core.state import End
from mdrive_sumo.roads import find_network_folder, load_road_map
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.episode_job import EpisodeJob, reexecute
from mdrive_sumo.scenario.suite import load_suite
from real2sim.pipeline import batch, conversion_worker
from real2sim.pipeline.conversion_options import ConversionOptions
from real2sim.pipeline.quality_file import build_quality_file
from real2sim.pipeline.scenario_builder import build_scenario
from real2sim.readers.v2xpnp import read_v2xpnp
from real2sim.recording import Recording
from real2sim.source_scene import SourceScene
from real2sim.writers.observation_noise import ObservationNoise
from real2sim.writers.v2xpnp import write_v2xpnp
from real2sim.writers.v2xpnp_map import write_vector_map
from tests.real2sim.writers.test_round_trip import real

pytestmark = [pytest.mark.slow, pytest.mark.costly_fixture]


@pytest.fixture(scope="module")
def suite(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The busy log, converted without a wish."""
    return converted(tmp_path_factory.mktemp("busy"), QUIET)


def converted(folder: Path, crowd: Crowd) -> Path:
    log, vector_map = make_busy_log(folder, crowd=crowd)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(batch, "ProcessPool", LocalExecutor)
        patch.setattr(conversion_worker, "_redirect_stdout", lambda: None)
        done = run("v2xpnp", log, "--map", vector_map, "--out", folder / "s")
    assert done.exit_code == 0, done.output
    return folder / "s"


def test_a_drive_in_sumo_becomes_a_suite_that_meets_every_target(suite: Path) -> None:
    quality = json.loads((suite / "busy" / "quality.json").read_text())
    assert quality["misses"] == []
    assert quality["passed"] is True
    assert quality["fidelity"]["moving_vehicles"] > 15


@pytest.mark.full
def test_traffic_keeps_the_order_of_a_busy_log(tmp_path: Path) -> None:
    quality = json.loads((converted(tmp_path, BUSY) / "busy" / "quality.json").read_text())
    assert quality["misses"] == []
    assert quality["fidelity"]["moving_vehicles"] > 55
    assert quality["closeness"]["order_share"] >= 0.9


def test_its_cavs_stations_and_people_are_those_of_the_drive(suite: Path) -> None:
    (scenario,) = load_suite(str(suite)).scenarios
    assert [(rsu.id, rsu.x, rsu.y) for rsu in scenario.rsus] == [("rsu1", 14.0, 16.0), ("rsu2", -14.0, -16.0)]
    assert sum(actor.kind == "pedestrian" for actor in scenario.actors) >= 7
    original = load_road_map(find_network_folder("boulevard"))
    assert len(scenario.egos) == len(WAYS)
    for ego, (first, _) in zip(scenario.egos, WAYS, strict=True):
        x, y = original.lanes[first].centre.at(30.0)
        assert (
            np.hypot(ego.start.x - x, ego.start.y - y) < 1.5
        )  # its lidar's place: the box centre is learnt from others
        assert ego.start_speed == pytest.approx(5.0, abs=1.5)


@pytest.mark.full  # in `make test`: a smaller converted log is driven (test_convert_command)
def test_it_runs(suite: Path) -> None:
    episode = reexecute(EpisodeJob(suite, "busy", AgentSpec("idm")))
    assert [ending.end for ending in episode.endings] == [End.ARRIVED] * 2
    assert episode.ticks > 100
    assert len(episode.ids) > 30


def scene(name: str, recording: Recording) -> SourceScene:
    return SourceScene(name, recording.source, "V2XPnP", "real2sim", recording.map, recording)


@pytest.mark.full
@pytest.mark.parametrize("name", READ)
def test_a_real_log_converts_as_well_through_the_format(name: str, shared_data: Path, tmp_path: Path) -> None:
    """Against the conversion of the same scene as it is: sizes, headings, occlusion and the bare map cost little."""
    truth = as_truth(real(name))
    whole = replace(truth, views=(truth.views[0],))
    direct = build_quality_file(build_scenario(scene(name, whole), tmp_path / "direct", ConversionOptions()).findings)
    write_v2xpnp(truth, tmp_path / name, ObservationNoise(), 0)
    write_vector_map(truth.map, tmp_path / "map.pkl")
    read = scene(name, read_v2xpnp(tmp_path / name, tmp_path / "map.pkl"))
    back = build_quality_file(build_scenario(read, tmp_path / "back", ConversionOptions()).findings)
    assert back.network.left_hand is direct.network.left_hand
    assert back.network.links_dropped == ()
    assert back.fidelity.duplicates == ()
    assert back.fidelity.teleports == 0
    assert back.fidelity.error_median is not None
    assert back.fidelity.error_median < 0.15
    assert back.fidelity.moving_passed_share >= direct.fidelity.moving_passed_share - 0.1
    assert back.closeness.median_at_5s is None or back.closeness.median_at_5s <= 3.0
