"""MDrive directories through the commands: converted, driven, and what happened on the road."""

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from testing.map_faults import lane, lanes_map
from testing.mdrive_directory import Directory, xml
from testing.shared_material import SHARED_DATA, needs_data

from mdrive_sumo.cli import main
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.episode.episode import EpisodeRecord
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.episode_job import EpisodeJob, reexecute
from mdrive_sumo.scenario.suite import load_suite
from real2sim.readers.carla_frame import UCLA_FRAME
from real2sim.writers.v2xpnp_map import write_vector_map


def convert(*arguments: object) -> str:
    answer = CliRunner().invoke(main, ["convert", "mdrive", *map(str, arguments)], catch_exceptions=False)
    assert answer.exit_code == 0, answer.output
    return answer.output


def driven(suite: Path, agent: str) -> dict[str, EpisodeRecord]:
    """Episodes of all scenarios."""
    ids = [scenario.id for scenario in load_suite(str(suite)).scenarios]
    return {id_: reexecute(EpisodeJob(suite, id_, AgentSpec(agent))) for id_ in ids}


def way(episode: EpisodeRecord, name: str) -> Float:
    """Positions (T, 2) [m] of a road user."""
    row = episode.ids.index(name)
    return np.column_stack((episode.x[:, row], episode.y[:, row]))


@pytest.fixture
def directory(tmp_path: Path) -> Directory:
    return Directory(tmp_path)


@pytest.mark.slow
def test_a_v2xpnp_scenario_runs_on_its_vector_map(directory: Directory, tmp_path: Path) -> None:
    """The map is a pickle whose lanes tell no direction; the logged car and a pedestrian are where the log has them."""
    west = lane("0_1", UCLA_FRAME.to_map_xy(np.array([(x, 0.0) for x in range(200, -1, -1)])), directed=False)
    write_vector_map(lanes_map(west), tmp_path / "map.pkl")
    for name, x in (("x_vehicle_1_0.xml", 5), ("x_vehicle_2_1.xml", 25)):
        (directory.folder / name).write_text(xml([(x, 0, 0), (60, 0, 0)]))
    log = [(60 + t, 0.3, 0, t / 10) for t in range(100)]
    directory.add("npc", "a.xml", xml(log, control_mode="replay"), name="a")
    directory.add("walker", "b.xml", xml([(100, 6, 0, t / 10) for t in range(100)]), name="b")
    convert(directory.write(), "--map", tmp_path / "map.pkl", "--out", tmp_path / "out")
    (episode,) = driven(tmp_path / "out", "idm").values()
    assert [ending.end for ending in episode.endings] == ["arrived", "arrived"]
    assert way(episode, "a")[40] == pytest.approx((60 + 20 + UCLA_FRAME.x, UCLA_FRAME.y - 0.3), abs=0.02)
    assert way(episode, "b")[40] == pytest.approx((100 + UCLA_FRAME.x, UCLA_FRAME.y - 6), abs=0.02)


@needs_data
@pytest.mark.full
def test_the_real_directories_run(tmp_path: Path) -> None:
    convert(SHARED_DATA / "mdrive" / "interaction", "--towns", SHARED_DATA / "carla_towns", "--out", tmp_path / "out")
    episodes = driven(tmp_path / "out", "idm")
    assert len(episodes) == 4
    crosswalk, precrash = episodes["Pedestrian_Crosswalk_8"], episodes["precrash_L"]
    walked = {name: float(np.hypot(*np.ptp(way(crosswalk, name), axis=0))) for name in ("entity_1", "entity_2")}
    assert walked["entity_1"] == 0, "the file's CAV 0 never comes near enough"
    assert walked["entity_2"] > 5
    assert float(np.ptp(way(precrash, "npc_brake")[:, 1])) > 5
    zone = episodes["Construction_Zone_10"]
    assert {name for name in zone.ids if name.startswith("entity")} == {
        "entity_1_1",
        "entity_1_2",
        "entity_1_3",
        "entity_2_1",
        "entity_2_2",
    }
