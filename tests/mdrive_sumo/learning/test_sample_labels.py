"""Labels against independent computations from the recording of the same drive."""

from pathlib import Path

import numpy as np
import pytest
import shapely
from testing.training_data import drive_here, make_settings

from mdrive_sumo.agents.learned.system_spec import LIDAR_BEHIND_M, LIDAR_CELL_M, LIDAR_CELLS
from mdrive_sumo.contract import SensorSpec
from mdrive_sumo.core.geometry import box_corners
from mdrive_sumo.episode import rebuild_frame
from mdrive_sumo.learning.drive_episode import CollectedDrive
from mdrive_sumo.learning.sample_format import OCCUPANCY_SHAPE
from mdrive_sumo.learning.scene_labels import SceneLabels
from mdrive_sumo.scenario.weather import WEATHERS
from mdrive_sumo.sensing.objects_sensor import ObjectsSensor
from mdrive_sumo.sensing.observation_builder import build_sensing_frame
from mdrive_sumo.sensing.sensing_frame import SensorPose, SensorSetup, derive_track_name

pytestmark = [pytest.mark.slow, pytest.mark.costly_fixture]
Labels = dict[tuple[int, int], dict[str, np.ndarray]]


@pytest.fixture(scope="module")
def drive(short_suite: Path) -> CollectedDrive:
    """A drive of `omniscient` without perturbation."""
    return drive_here(make_settings(short_suite, perturbation=0.0))


@pytest.fixture(scope="module")
def scenes(drive: CollectedDrive) -> Labels:
    """Labels by CAV and tick."""
    labels = SceneLabels(drive.episode, drive.config.roads)
    found: Labels = {}
    for tick in range(0, drive.episode.ticks, 4):
        cavs = [cav for cav in range(drive.episode.egos) if drive.episode.valid[tick, cav]]
        found |= {(cav, tick): dict(one) for cav, one in labels.build(tick, cavs).items()}
    return found


def to_complex_frame(x: np.ndarray, y: np.ndarray, pose: tuple[float, float, float]) -> np.ndarray:
    """Return world points in the frame of a pose as complex numbers, ahead + i left."""
    return (x + 1j * y - (pose[0] + 1j * pose[1])) * np.exp(-1j * pose[2])


def find_pose(drive: CollectedDrive, tick: int, cav: int) -> tuple[float, float, float]:
    episode = drive.episode
    return float(episode.x[tick, cav]), float(episode.y[tick, cav]), float(episode.yaw[tick, cav])


def test_an_experts_plan_is_where_it_drives(drive: CollectedDrive) -> None:
    """0.5 s later the car that nothing disturbs is within 0.3 m of the first point of its plan."""
    errors = []
    for cav, decisions in enumerate(drive.decisions):
        for one in decisions:
            if one.tick + 10 < drive.episode.ticks and drive.episode.valid[one.tick + 10, cav]:
                x, y, _ = find_pose(drive, one.tick + 10, cav)
                real = to_complex_frame(np.array(x), np.array(y), find_pose(drive, one.tick, cav))
                plan = one.labels["expert_plan"][0]
                errors.append(abs(complex(real) - complex(plan[0], plan[1])))
    assert len(errors) > 100
    assert np.quantile(errors, 0.95) <= 0.3
    assert np.max(errors) <= 0.6


def test_own_states_have_the_errors_that_a_learner_gets(drive: CollectedDrive) -> None:
    """`omniscient` itself gets the true state, because of its privileged sensor."""
    gaps = [
        np.hypot(*(one.labels["own"][:2] - find_pose(drive, one.tick, cav)[:2]))
        for cav, decisions in enumerate(drive.decisions)
        for one in decisions
    ]
    assert 0.05 < np.mean(gaps) < 0.6
    assert all(not one.labels["perturbed"] for decisions in drive.decisions for one in decisions)


def test_futures_are_the_recorded_ones(drive: CollectedDrive, scenes: Labels) -> None:
    episode, checked = drive.episode, 0
    for (cav, tick), labels in scenes.items():
        own = find_pose(drive, tick, cav)
        for box, future in zip(labels["boxes"], labels["futures"], strict=True):
            column = int(box[8])
            for step in range(6):
                later = tick + 10 * (step + 1)
                if later >= episode.ticks or not episode.valid[later, column]:
                    assert np.isnan(future[step]).all()
                    continue
                x, y, yaw = find_pose(drive, later, column)
                expected = to_complex_frame(np.array(x), np.array(y), own)
                assert abs(complex(*future[step, :2]) - complex(expected)) < 1e-3
                assert abs(np.exp(1j * future[step, 2]) - np.exp(1j * (yaw - own[2]))) < 1e-4
                checked += 1
    assert checked > 500


def test_boxes_are_all_within_60_m_and_visible_ones_are_those_that_an_ideal_sensor_detects(
    drive: CollectedDrive, scenes: Labels
) -> None:
    episode, roads = drive.episode, drive.config.roads
    setup = SensorSetup("me", 0, roads, WEATHERS["default"], None)
    sensor = ObjectsSensor(SensorSpec("objects", range_m=60.0, options={"profile": "ideal", "min_visible": 0.0}), setup)
    hidden = 0
    for (cav, tick), labels in list(scenes.items())[::5]:
        frame = rebuild_frame(episode, tick)
        sizes = {ego: (float(episode.length[i]), float(episode.width[i])) for i, ego in enumerate(episode.ego_ids)}
        row = list(frame.egos).index(episode.ego_ids[cav])
        x, y, yaw = find_pose(drive, tick, cav)
        eye = SensorPose(x, y, yaw, row)
        detected = set(sensor.sense(build_sensing_frame(frame, sizes), eye).ids)
        boxes = labels["boxes"]
        visible = {derive_track_name("me", episode.ids[int(box[8])]) for box in boxes if box[7]}
        assert visible == detected
        hidden += int((boxes[:, 7] == 0).sum())
        distances = np.hypot(boxes[:, 0], boxes[:, 1])
        assert (distances < 60.0 + 10.0).all()
        assert cav not in boxes[:, 8]
    assert hidden > 0


def test_occupancy_is_what_shapely_finds(drive: CollectedDrive, scenes: Labels) -> None:
    """A cell is occupied if one of nine points in it lies in the box of a road user that is or lately was visible."""
    step = LIDAR_CELL_M / 3
    across = (np.arange(3 * LIDAR_CELLS) + 0.5) * step
    x, y = np.meshgrid(
        LIDAR_CELLS * LIDAR_CELL_M - LIDAR_BEHIND_M - across, LIDAR_CELLS * LIDAR_CELL_M / 2 - across, indexing="ij"
    )
    last_seen: dict[tuple[int, int], int] = {}
    occupied = 0
    for (cav, tick), labels in scenes.items():
        boxes = labels["boxes"]
        last_seen |= {(cav, int(box[8])): tick for box in boxes if box[7]}
        if tick % 40 or tick + 60 >= drive.episode.ticks:
            continue
        known = [row for row, box in enumerate(boxes) if tick - last_seen.get((cav, int(box[8])), -99) <= 40]
        cells = np.unpackbits(labels["occupancy"]).reshape(OCCUPANCY_SHAPE)
        for layer in (0, 3, 6):
            poses = boxes[known, :3] if layer == 0 else labels["futures"][known, layer - 1]
            shapes: list[shapely.Polygon] = []
            for row, pose in zip(known, poses, strict=True):
                if not np.isnan(pose).any():
                    x_box, y_box, yaw = (float(value) for value in pose)
                    length, width = float(boxes[row, 3]), float(boxes[row, 4])
                    shapes.append(shapely.Polygon(box_corners(x_box, y_box, yaw, length, width)))
            inside = shapely.contains_xy(shapely.union_all(shapes), x, y)
            expected = inside.reshape(LIDAR_CELLS, 3, LIDAR_CELLS, 3).any(axis=(1, 3))
            occupied += int(expected.sum())
            assert (expected != cells[layer].astype(bool)).sum() <= 2  # points on an edge
    assert occupied > 50


def test_lanes_lie_on_centre_lines_near_the_car(drive: CollectedDrive, scenes: Labels) -> None:
    roads = drive.config.roads
    centres = shapely.union_all([shapely.LineString(lane.centre.xy) for lane in roads.driving])
    for (cav, tick), labels in list(scenes.items())[::9]:
        x, y, yaw = find_pose(drive, tick, cav)
        lanes = labels["lane_graph"].astype(np.float64)
        world = (lanes[..., 0] + 1j * lanes[..., 1]) * np.exp(1j * yaw) + complex(x, y)
        gaps = shapely.distance(centres, shapely.points(world.real, world.imag))
        assert gaps.max() < 0.15  # chords of bends, points 1 m apart
        assert np.abs(lanes[..., 0] + 1j * lanes[..., 1]).max() <= 40.0 + 1e-3
        assert 1 <= len(lanes) <= 40
        nearest = roads.find_nearest_lanes(np.array(((x, y),))).distance[0]
        assert np.abs(lanes[..., 0] + 1j * lanes[..., 1]).min() < nearest + 6.0
