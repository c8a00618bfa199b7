"""CommonRoad, validated and read back by commonroad-io; and converted back by `mdrive-sumo convert`."""

import json
import re
from pathlib import Path
from typing import Any

import commonroad
import numpy as np
import pytest
import shapely
from commonroad.common.file_reader import CommonRoadFileReader
from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]
from testing.convert_command import run as convert
from testing.mixed_run import CAVS, SCENARIO

from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.export.scored_recording import ScoredRecording
from mdrive_sumo.scenario.scripted_actor import ReplayMotion
from mdrive_sumo.scenario.suite import load_suite
from real2sim.readers.commonroad import read_commonroad

from .conftest import Export

pytestmark = pytest.mark.slow  # of an episode that is driven

MAX_ERROR_M = 0.01
"""Of the round trip."""


@pytest.fixture(scope="module")
def path(exported: Export) -> Path:
    return exported("commonroad") / f"{SCENARIO}.xml"


@pytest.fixture(scope="module")
def obstacles(path: Path) -> dict[str, str]:
    """Obstacle -> id of the road user."""
    return json.loads(path.with_suffix(".ids.json").read_text())["obstacles"]


@pytest.fixture(scope="module")
def scenario(path: Path) -> Any:
    return CommonRoadFileReader(str(path)).open()[0]


def test_the_file_is_valid_by_the_schema_of_commonroad(path: Path, record: EpisodeRecord) -> None:
    """But for one rule: obstacles begin at time 0. What arrives later keeps its time, as commonroad-io writes it."""
    schema = Path(commonroad.__file__).parent / "common" / "xml_definition_files" / "XML_commonRoad_XSD.xsd"
    validator = etree.XMLSchema(etree.parse(schema))
    validator.validate(etree.parse(path))
    late = np.argmax(record.valid, axis=0)
    found = [
        re.search(r"The value '(\d+)' is greater than the maximum value allowed", str(one))
        for one in validator.error_log
    ]
    assert sorted(int(one[1]) for one in found if one) == sorted(late[late > 0].tolist()) == [10, 20]
    assert len(found) == 2


def test_every_cav_has_its_task(path: Path, recording: ScoredRecording) -> None:
    problems: dict[int, Any] = CommonRoadFileReader(str(path)).open()[1].planning_problem_dict
    cavs = json.loads(path.with_suffix(".ids.json").read_text())["planning_problems"]
    assert {cavs[str(number)] for number in problems} == set(CAVS)
    for number, problem in problems.items():
        ego = next(one for one in recording.scenario.egos if one.id == cavs[str(number)])
        assert problem.initial_state.position == pytest.approx((ego.start.x, ego.start.y), abs=1e-3)
        (goal,) = problem.goal.state_list
        assert goal.position.shapely_object.centroid.distance(shapely.Point(ego.xy[-1])) < 1e-3


def test_commonroad_reads_the_recorded_poses(
    scenario: Any, obstacles: dict[str, str], recording: ScoredRecording
) -> None:
    record = recording.record
    assert (scenario.dt, len(scenario.obstacles)) == (0.05, len(record.ids))
    for obstacle in scenario.dynamic_obstacles:
        column = record.ids.index(obstacles[str(obstacle.obstacle_id)])
        states = (obstacle.initial_state, *obstacle.prediction.trajectory.state_list)
        assert [state.time_step for state in states] == np.flatnonzero(record.valid[:, column]).tolist()
        for state in states:
            tick = state.time_step
            centre = obstacle.occupancy_at_time(tick).shapely_object.centroid
            assert np.hypot(centre.x - record.x[tick, column], centre.y - record.y[tick, column]) < 1e-3
            assert np.cos(state.orientation - record.yaw[tick, column]) > 1 - 1e-9
            assert state.velocity == pytest.approx(record.speed[tick, column], abs=1e-3)
        shape = obstacle.obstacle_shape
        assert (shape.length, shape.width) == (record.length[column], record.width[column])
    (static,) = scenario.static_obstacles
    assert obstacles[str(static.obstacle_id)] == "cone"


def test_the_network_has_every_lane_with_limits_and_lights(
    scenario: Any, path: Path, recording: ScoredRecording
) -> None:
    lanes = json.loads(path.with_suffix(".ids.json").read_text())["lanelets"]
    network, roads = scenario.lanelet_network, recording.roads
    assert sorted(lanes.values()) == sorted(roads.lanes)
    for lanelet in network.lanelets:
        lane = roads.lanes[lanes[str(lanelet.lanelet_id)]]
        assert {lanes[str(other)] for other in lanelet.successor} == set(lane.successors)
        assert np.abs(lanelet.center_vertices - lane.centre.xy).max() < 1e-3
        widths = np.hypot(*(lanelet.left_vertices - lanelet.right_vertices).T)
        assert np.abs(widths - lane.width).max() < 1e-3
        (sign,) = (network.find_traffic_sign_by_id(one) for one in lanelet.traffic_signs)
        assert float(sign.traffic_sign_elements[0].additional_values[0]) == pytest.approx(lane.speed_limit, rel=1e-4)
        assert len(lanelet.traffic_lights) == len(lane.lights)
    greens = [light.get_state_at_time_step(0).value for light in network.traffic_lights]
    letters = recording.record.signals[0].state
    assert greens.count("green") == sum(letter in "gG" for letter in letters)


def test_the_same_tracks_come_back(path: Path, obstacles: dict[str, str], record: EpisodeRecord) -> None:
    log = read_commonroad(path)
    assert log.exact and log.dt_s == 0.05
    for track in log.views[0].tracks:
        column = record.ids.index(obstacles[track.id])
        assert (track.valid == record.valid[:, column]).all()
        gap = np.hypot(track.x - record.x[:, column], track.y - record.y[:, column])
        assert gap[track.valid].max() < MAX_ERROR_M


@pytest.mark.full
def test_convert_makes_a_scenario_with_the_same_tracks(
    path: Path, obstacles: dict[str, str], record: EpisodeRecord, tmp_path: Path
) -> None:
    """Logs are smoothed, those of a simulation are not: its hard braking is what happened."""
    cav = next(number for number, id_ in obstacles.items() if id_ == "0")
    out = tmp_path / "suite"
    ended = convert("commonroad", path, "--workers", 1, "--out", out, "--cavs", cav, "--traffic", "replay")
    assert ended.exit_code in (0, 1), ended.output  # 1: harder braking than the targets for recorded people allow
    (scenario,) = load_suite(str(out)).scenarios
    poses = {one.id: one.log for one in scenario.background.vehicles}
    poses |= {one.id: one.motion.poses for one in scenario.actors if isinstance(one.motion, ReplayMotion)}
    assert {obstacles[id_] for id_ in poses} >= {"1", "late", "walker", "cyclist"}
    for id_, rows in poses.items():
        column = record.ids.index(obstacles[id_])
        times, x, y, _ = np.array(rows).T
        ticks = np.rint(times * 20).astype(int)
        assert np.hypot(x - record.x[ticks, column], y - record.y[ticks, column]).max() < MAX_ERROR_M
    start = scenario.egos[0].start
    assert np.hypot(start.x - record.x[0, 0], start.y - record.y[0, 0]) < MAX_ERROR_M


def test_files_of_others_are_not_taken_for_exact(path: Path, tmp_path: Path) -> None:
    foreign = tmp_path / "foreign.xml"
    foreign.write_text(path.read_text().replace('source="mdrive-sumo', 'source="a drone'))
    assert not read_commonroad(foreign).exact
