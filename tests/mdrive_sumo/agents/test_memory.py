"""`memory`: which drive it finds, how it repeats it, and what it does where it knows none."""

import hashlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from testing.planning import briefing, own

from mdrive_sumo.agents import memory
from mdrive_sumo.agents.memory import DriveReplay, KnownDrives, MemoryAgent, load_drives, pack_drives, unpack_drives
from mdrive_sumo.agents.sensorless import ConstantSpeedAgent
from mdrive_sumo.contract import Briefing, Observation
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import DT, End
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.episode_job import EpisodeJob, load_job_scenario, reexecute
from mdrive_sumo.scenario.packaged_suites import find_suite_folder
from mdrive_sumo.scenario.suite import load_suite
from mdrive_sumo.scoring.criteria import compute_time_limit_ticks
from tools.build_memory_drives import sample_drives

FAST = "i01_ins_c_main_street_right"


def line(x: float, steps: list[float]) -> Float:
    """A drive along y = 0 with these steps [m]."""
    return np.stack([x + np.concatenate([[0.0], np.cumsum(steps)]), np.zeros(len(steps) + 1)], axis=1)


STANDING = line(0.0, [0.0] * 8 + [1.0] * 12)
MOVING = line(100.0, [2.0] * 20)


def known(*drives: Float, limits: tuple[float, ...] = ()) -> KnownDrives:
    goals = np.array([drive[-1] for drive in drives])
    return unpack_drives(pack_drives(goals, np.array(limits or [30.0] * len(drives)), list(drives)))


def test_a_file_holds_drives_to_a_centimetre() -> None:
    drives = known(STANDING + 0.004, MOVING)
    assert drives.points[: len(STANDING)] == pytest.approx(STANDING, abs=0.005)
    assert drives.points[drives.firsts[1] :] == pytest.approx(MOVING)
    assert pack_drives(drives.goals, drives.time_limits, [STANDING]) == pack_drives(
        drives.goals, drives.time_limits, [STANDING]
    )


@pytest.mark.parametrize(
    ("start", "goal", "found"),
    [
        ((0.0, 0.0), (12.0, 0.0), 0),
        ((3.0, 0.5), (12.3, 0.2), 0),
        ((4.5, 0.0), (12.0, 0.0), 0),  # where the drive is after 3 s
        ((-4.5, 0.0), (12.0, 0.0), None),
        ((0.0, 0.0), (13.5, 0.0), None),
        ((112.0, 0.0), (140.0, 0.0), 1),
    ],
)
def test_a_drive_is_found_by_start_and_goal(
    start: tuple[float, float], goal: tuple[float, float], found: int | None
) -> None:
    drives = known(STANDING, MOVING)
    drive = drives.find(np.array(start), np.array(goal), 30.0)
    assert (drive is None) is (found is None)
    if found is not None:
        assert drive is not None and drive[0].tolist() == [(0.0, 100.0)[found], 0.0]


def test_of_several_drives_the_time_limit_tells_the_scenario() -> None:
    near, far = line(0.0, [1.0] * 12), line(2.0, [1.0] * 10)
    drives = known(near, far, limits=(30.0, 40.0))
    for limit_s, start in ((30.0, 0.0), (40.0, 2.0), (35.0, 0.0)):
        drive = drives.find(np.array((0.0, 0.0)), np.array((12.0, 0.0)), limit_s)
        assert drive is not None and drive[0, 0] == start


def test_a_car_is_where_the_drive_was_and_never_goes_back() -> None:
    waiting = DriveReplay(STANDING, np.array((1.5, 0.0)))
    assert waiting.plan(0.0).points[:, 0] == pytest.approx([1.5] * 9 + [2.0, 3.0, 4.0])
    assert waiting.plan(2.0).points[:3, 0] == pytest.approx([1.5, 2.0, 3.0])
    assert waiting.plan(1.8).points[:3, 0] == pytest.approx([1.5, 1.5, 2.2])
    assert waiting.plan(60.0).points[:, 0] == pytest.approx([32.0] * 12), "5 s beyond its end"
    rolling = DriveReplay(MOVING, np.array((104.2, 1.0)))
    assert rolling.plan(0.0).points[:2].tolist() == [[106.0, 0.0], [108.0, 0.0]]


def drive_blindly(agent: ConstantSpeedAgent, about: Briefing) -> Float:
    agent.start(about)
    plan = agent.act(Observation(0, own())).plan
    assert plan is not None
    return plan.points


def test_where_it_knows_no_drive_it_drives_blindly() -> None:
    about = briefing(np.stack([np.arange(60.0), np.full(60, 5000.0)], axis=1))
    assert (drive_blindly(MemoryAgent({}), about) == drive_blindly(ConstantSpeedAgent({}), about)).all()


@pytest.mark.slow
def test_every_cav_of_season_0_has_its_drive_and_no_option_is_taken() -> None:
    drives, suite = load_drives(), load_suite("mdrive@0")
    cavs = [(ego, compute_time_limit_ticks(scenario)[ego.id] * DT) for scenario in suite for ego in scenario.egos]
    assert len(cavs) == len(drives.goals) == 756
    for i, (ego, limit_s) in enumerate(cavs):
        drive = drives.find(ego.xy[0], ego.xy[-1], limit_s)
        assert drive is not None
        assert np.linalg.norm(drives.points[drives.firsts[i]] - ego.xy[0]) < 2.0, "recordings start beside their route"
    assert memory.DRIVES_FILE.stat().st_size < 300_000
    with pytest.raises(InputError, match=r"agent memory: expected options among \(none\), found 'speed'"):
        MemoryAgent({"speed": 3.0})


def test_changed_drives_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "drives.npz").write_bytes(b"else")
    monkeypatch.setattr(memory, "DRIVES_FILE", tmp_path / "drives.npz")
    load_drives.cache_clear()
    with pytest.raises(InputError, match=r"expected the packaged drives with checksum .*, found"):
        MemoryAgent({})
    monkeypatch.undo()
    load_drives.cache_clear()
    assert hashlib.sha256(memory.DRIVES_FILE.read_bytes()).hexdigest() == memory.DRIVES_CHECKSUM


def job(agent: str, seed: int) -> EpisodeJob:
    return EpisodeJob(find_suite_folder("interdrive@0"), FAST, AgentSpec(agent), seed)


@pytest.mark.slow
def test_the_packaged_drives_are_those_of_omniscient() -> None:
    """`python -m tools.build_memory_drives` makes them all; here one scenario is driven again."""
    episode = reexecute(job("omniscient", 0))
    scenario, _ = load_job_scenario(job("omniscient", 0))
    for goal, limit_s, points in sample_drives(scenario, episode):
        found = load_drives().find(points[0], goal, limit_s)
        assert found is not None and found == pytest.approx(points, abs=0.006)


@pytest.mark.slow
def test_it_arrives_with_another_seed() -> None:
    episode = reexecute(replace(job("memory", 2)))
    assert {ending.end for ending in episode.endings} == {End.ARRIVED}
