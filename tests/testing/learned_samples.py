"""Briefings and observations for learned systems."""

from collections.abc import Sequence

import numpy as np

from mdrive_sumo.agents.learned.system_spec import SystemSpec
from mdrive_sumo.contract import Briefing, CameraImage, Observation, OwnState, PointCloud, StopSign, VehicleFacts
from mdrive_sumo.core.state import DT

FACTS = VehicleFacts(4.9, 2.1, 2.9, 1.4, 2000.0, 0.7, 40.0, 4.0, 8.0)


def make_briefing(
    xy: np.ndarray,
    yaw: np.ndarray | None = None,
    lane_width: float = 3.2,
    limit: float = 13.9,
    desired_speed: float | None = 8.0,
    stops: Sequence[float] = (),
    seed: int = 0,
) -> Briefing:
    """A briefing of a route of points (N, 2), one a metre."""
    ones = np.ones(len(xy))
    return Briefing(
        ego_id="a", seed=seed, tick_s=DT, time_limit_s=60.0, vehicle=FACTS, route_xy=xy,
        route_yaw=np.zeros(len(xy)) if yaw is None else yaw, route_s=np.arange(len(xy), dtype=float),
        route_lane_width=lane_width * ones, route_speed_limit=limit * ones,
        stop_signs=tuple(StopSign(s) for s in stops), desired_speed=desired_speed,
    )  # fmt: skip


def make_observation(spec: SystemSpec, tick: int = 0, own: OwnState | None = None, grey: int = 100) -> Observation:
    """What the sensors of a system give: images of one colour each, grey + number of the camera; three LiDAR points."""
    own = own or OwnState(0.0, 0.0, 0.0, 5.0, 0.0, 0.0, 0.0)
    sizes = {camera: (image.height, image.width) for image in spec.images for camera in image.cameras}
    images = {
        camera: CameraImage("rgb", np.full((*size, 3), grey + number, np.uint8), 100.0)
        for number, (camera, size) in enumerate(sizes.items())
    }
    points = np.array(((10.0, 0.0, -2.4, 0.5), (10.0, 0.0, -1.0, 0.5), (-5.0, 8.0, -1.0, 0.5)), np.float32)
    cloud = PointCloud(points, np.zeros(0, np.int32), ())
    return Observation(
        tick, own, speedometer=own.speed, cameras=images, lidar={"top": cloud} if spec.uses_lidar else {}
    )
