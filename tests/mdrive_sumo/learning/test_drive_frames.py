"""Frames of a drive: scans and own states are those of the drive, points lie on true boxes, and who sees what when."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import shapely
from testing.training_data import drive_here, make_settings

from mdrive_sumo.agents.learned.fusion_spec import DELAYS_TICKS, GRID_REACH_M
from mdrive_sumo.agents.learned.network_inputs import LIDAR_HEIGHT_M
from mdrive_sumo.agents.learned.point_grid import SCAN_SENSOR, build_point_cells
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.learning import recording_agent
from mdrive_sumo.learning.drive_episode import CollectedDrive
from mdrive_sumo.learning.fusion import drive_frames
from mdrive_sumo.learning.fusion.drive_frames import (
    CLASS_OF_MODEL,
    DriveFrames,
    FrameSampling,
    build_drive_frames,
    choose_views,
)
from mdrive_sumo.learning.fusion.frames import MOTION_S, check_frames
from mdrive_sumo.sensing.camera.road_user_models import RoadUserModel

pytestmark = [pytest.mark.slow, pytest.mark.costly_fixture]
SAMPLING = FrameSampling(interval_ticks=14)
"""Every second sampled tick is one of a decision, at which the drive notes what the CAVs have."""


@pytest.fixture(scope="module")
def drive(short_suite: Any) -> CollectedDrive:
    """A drive whose CAVs have the LiDAR, and note its cells with their own states at decisions."""
    settings = make_settings(short_suite, expert="sharing+negotiation", perturbation=0.0)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(recording_agent, "build_rig_sensors", lambda *_: (SCAN_SENSOR,))
        patch.setattr(recording_agent, "build_lidar_histogram", lambda cloud: build_point_cells(cloud.points))
        return drive_here(settings)


@pytest.fixture(scope="module")
def made(drive: CollectedDrive) -> DriveFrames:
    """Its frames, with the points of all scans of sampled ticks."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(drive_frames, "POINTS_SHARE", 1.0)
        found = build_drive_frames(drive, SAMPLING)
    check_frames(found.frames, "here")
    assert len(found.frames) > 8 and (found.frames.scan[:, 1, 0] >= 0).all()
    return found


def place_points(points: Float, pose: Float) -> Float:
    """Return points (N, 2) of a frame where that frame's pose lies, by complex numbers."""
    turned = (points[:, 0] + 1j * points[:, 1]) * np.exp(1j * pose[2]) + complex(pose[0], pose[1])
    return np.column_stack((turned.real, turned.imag))


def test_boxes_move_as_the_road_users_do_until_they_or_the_drive_end(drive: CollectedDrive, made: DriveFrames) -> None:
    episode, frames = drive.episode, made.frames
    assert frames.box_motion is not None
    there = 0
    for i in range(len(frames)):
        own = find_views(drive)[i].cars[0]
        pose = [float(each[frames.tick[i], own]) for each in (episode.x, episode.y, episode.yaw)]
        for row in np.flatnonzero(frames.box_class[i] >= 0):
            column = frames.box_id[i, row]
            for j, seconds in enumerate(MOTION_S):
                tick, found = int(frames.tick[i] + round(20 * seconds)), frames.box_motion[i, row, j].astype(float)
                if not 0 <= tick < episode.ticks or not episode.valid[tick, column]:
                    assert np.isnan(found).all()
                    continue
                there += 1
                placed = place_points(found[None, :2], np.array(pose))
                assert np.allclose(placed, (episode.x[tick, column], episode.y[tick, column]), atol=1e-3)
                assert np.cos(found[2] + pose[2] - episode.yaw[tick, column]) > 1 - 1e-9
    assert there > 50 and np.isnan(frames.box_motion[frames.box_class < 0]).all()


def find_views(drive: CollectedDrive) -> list[drive_frames.View]:
    return choose_views(drive.episode, SAMPLING, drive.config.sensor_context.seed)[0]


def test_scans_and_own_states_are_those_of_the_drive(drive: CollectedDrive, made: DriveFrames) -> None:
    noted = {(one.tick, car): one.labels for car, all_ in enumerate(drive.decisions) for one in all_}
    compared = 0
    for i, view in enumerate(find_views(drive)):
        own = noted.get((view.tick, view.cars[0]))
        for slot, car in enumerate(view.cars):
            for j, delay in enumerate(DELAYS_TICKS):
                sender, number = noted.get((view.tick - delay, car)), made.frames.scan[i, slot, j]
                if own is None or sender is None or number < 0:
                    continue
                assert np.array_equal(made.frames.get_scan(number), sender["lidar"])
                x, y, yaw = made.frames.estimated_pose[i, slot, j].astype(float)
                placed = place_points(np.array([[x, y]]), own["own"].astype(float))
                assert np.allclose(placed, sender["own"][:2], atol=1e-3)
                assert np.cos(own["own"][2] + yaw - sender["own"][2]) > 1 - 1e-9
                compared += 1
    assert compared > 20


def test_true_poses_lead_to_where_cars_were(drive: CollectedDrive, made: DriveFrames) -> None:
    episode, frames = drive.episode, made.frames
    poses = np.stack((episode.x, episode.y, episode.yaw), axis=-1)
    errors: list[Any] = []
    for i, view in enumerate(find_views(drive)):
        assert frames.tick[i] == view.tick and frames.place[i] == 0
        for slot, car in enumerate(view.cars):
            for j, delay in enumerate(DELAYS_TICKS if slot else DELAYS_TICKS[:1]):
                was, pose = poses[view.tick - delay, car], frames.true_pose[i, slot, j].astype(float)
                assert np.allclose(place_points(pose[None], poses[view.tick, view.cars[0]]), was[:2], atol=1e-4)
                errors += [frames.estimated_pose[i, slot, j, :2] - frames.true_pose[i, slot, j, :2]] if slot else []
    # Two cars with 0.2 m each, and 0.2 degrees at some ten metres.
    assert 0.05 < np.sqrt(np.mean(np.square(errors))) < 0.8


def test_points_on_boxes_are_those_in_the_boxes(made: DriveFrames) -> None:
    """Counted by shapely, at true poses: points of own car and senders that are above the ground."""
    frames, kept = made.frames, made.points
    clouds = dict(zip(kept.scan.tolist(), np.split(kept.points / 100.0, kept.starts[1:-1]), strict=True))
    counted = np.zeros_like(frames.box_points)
    for i in range(len(frames)):
        used = np.flatnonzero(frames.box_class[i] >= 0)
        shapes = [_draw_box(*frames.boxes[i, row].astype(float)).buffer(0.02) for row in used]
        for slot in np.flatnonzero(frames.scan[i, :, 0] >= 0):
            cloud = clouds[frames.scan[i, slot, 0]]
            raised = cloud[cloud[:, 2] > 0.03 - LIDAR_HEIGHT_M]
            x, y = place_points(raised, frames.true_pose[i, slot, 0].astype(float)).T
            counted[i, used, slot] = [shapely.contains_xy(shape, x, y).sum() for shape in shapes]
    assert frames.box_points.any(axis=2).sum() > 10 and (frames.box_points[..., 1:] > 0).any()
    # A wheel's lowest centimetres look like the ground here.
    assert (counted <= frames.box_points).all() and counted.sum() > 0.97 * frames.box_points.sum()


def _draw_box(x: float, y: float, yaw: float, length: float, width: float) -> shapely.Polygon:
    corners = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)]) * (length / 2, width / 2)
    return shapely.Polygon(place_points(corners, np.array((x, y, yaw))))


def test_boxes_are_the_others_within_the_grid(drive: CollectedDrive, made: DriveFrames) -> None:
    episode, frames = drive.episode, made.frames
    for i, view in enumerate(find_views(drive)):
        own = np.array([values[view.tick, view.cars[0]] for values in (episode.x, episode.y, episode.yaw)])
        placed = place_points(frames.boxes[i, frames.box_class[i] >= 0, :2].astype(float), own)
        ids = frames.box_id[i, frames.box_class[i] >= 0]
        assert np.allclose(placed, np.column_stack((episode.x[view.tick, ids], episode.y[view.tick, ids])), atol=1e-3)
        assert view.cars[0] not in ids and len({*ids.tolist()}) == len(ids)
        near = np.hypot(episode.x[view.tick] - own[0], episode.y[view.tick] - own[1]) < GRID_REACH_M
        expected = set(np.flatnonzero(near & episode.valid[view.tick])) - {view.cars[0]}
        targets = {column for column in expected if episode.kind[column] != 3}
        assert targets <= {*ids.tolist()}


def test_classes_of_road_users() -> None:
    names = {model.name: int(CLASS_OF_MODEL[model]) for model in RoadUserModel}
    assert names == {
        "CAR": 0, "VAN": 0, "TRUCK": 0, "BUS": 0, "MOTORCYCLE": 1, "CYCLIST": 1, "PEDESTRIAN": 2, "OBSTACLE": -1,
    }  # fmt: skip


def make_episode(xs: Any, ticks: int = 200) -> Any:
    """CAVs on one line: a number stands, a function tells the place by tick, None has left."""
    x = np.array([[one(tick) if callable(one) else one or 0.0 for one in xs] for tick in range(ticks)], float)
    valid = np.repeat([[one is not None for one in xs]], ticks, axis=0)
    return SimpleNamespace(x=x, y=np.zeros_like(x), valid=valid, egos=len(xs), ticks=ticks)


def list_cars(episode: Any, interval: int = 40) -> list[tuple[int, ...]]:
    views, _ = choose_views(episode, FrameSampling(interval), 7)
    return [view.cars for view in views if view.tick == views[0].tick]


def test_senders_are_the_nearest_ones_in_range() -> None:
    assert list_cars(make_episode((0.0, 30.0, -10.0, 149.0, 181.0, 20.0, 40.0)))[0] == (0, 2, 5, 1, 6)
    assert list_cars(make_episode((0.0, 151.0, None, 301.0))) == [(1, 3), (3, 1)]  # 151 m is out of range
    assert list_cars(make_episode((0.0, None, 200.0))) == []


def test_sampled_ticks_have_scans_and_a_drawn_beginning() -> None:
    episode = make_episode((lambda tick: tick, lambda tick: tick + 9.0))
    first: set[int] = set()
    for seed in range(40):
        ticks = [view.tick for view in choose_views(episode, FrameSampling(40), seed)[0] if view.cars[0] == 0]
        assert set(np.diff(ticks)) == {40} and not any(tick % 2 for tick in ticks)
        assert DELAYS_TICKS[-1] <= ticks[0] < 40 + DELAYS_TICKS[-1]
        first.add(ticks[0])
    assert len(first) > 8


def test_cars_that_stand_are_seen_once_until_something_moves() -> None:
    views, left_out = choose_views(make_episode((0.0, 5.0)), FrameSampling(20), 7)
    assert len(views) == 2 and left_out == 2 * (len(range(views[0].tick, 200, 20)) - 1)
    creeping = make_episode((0.0, lambda tick: 5.0 + 0.03 * tick))  # 0.6 m from tick to tick
    ticks = [view.tick for view in choose_views(creeping, FrameSampling(20), 7)[0] if view.cars[0] == 0]
    assert set(np.diff(ticks)) == {40}  # it is 1.2 m from where it was seen last


def test_a_lone_car_has_no_frames() -> None:
    views, left_out = choose_views(make_episode((0.0,)), FrameSampling(20), 7)
    assert views == [] and left_out > 5
