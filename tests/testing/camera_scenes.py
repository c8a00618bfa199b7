"""Scenes for tests of cameras: boxes on a packaged network, and a sensor in them."""

from collections.abc import Mapping, Sequence
from functools import lru_cache

import numpy as np
import pytest

from mdrive_sumo.contract import CameraImage, Objects, SensorSpec
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.state import EgoState, Kind
from mdrive_sumo.roads import RoadMap, find_network_folder, load_road_map
from mdrive_sumo.scenario.weather import WEATHERS
from mdrive_sumo.sensing.camera.camera_renderer import load_renderer
from mdrive_sumo.sensing.camera.camera_sensor import CameraSensor
from mdrive_sumo.sensing.sensing_frame import SensingFrame, SensorPose, SensorSetup

Box = tuple[float, float, float, float, float, Kind]
"""x, y [m], yaw [rad], length, width [m], kind."""
CAR_M = (4.6, 1.85)
TOWN = "town_crossing"


@lru_cache(maxsize=1)
def _can_render() -> bool:
    try:
        load_renderer()
    except InputError:
        return False
    return True


needs_opengl = pytest.mark.skipif(not _can_render(), reason="needs OpenGL")


def load_town() -> RoadMap:
    """Return a packaged network with houses."""
    return load_road_map(find_network_folder(TOWN))


def build_scene(boxes: Sequence[Box], tick: int = 0, signals: Mapping[str, str] | None = None) -> SensingFrame:
    """Return a frame in which the first box is the CAV "me"."""
    x, y, yaw, length, width = (np.array([box[i] for box in boxes], dtype=np.float64) for i in range(5))
    kind = np.array([box[5] for box in boxes], dtype=np.uint8)
    ids = ("me", *(f"o{i}" for i in range(1, len(boxes))))
    me = EgoState(float(x[0]), float(y[0]), float(yaw[0]), 10.0)
    objects = Objects(ids, kind, x, y, yaw, np.zeros(len(boxes)), length, width)
    return SensingFrame(tick, objects, {"me": me}, signals or {})


def place_car(x: float, y: float, yaw: float) -> Box:
    """Return the box of a car."""
    return (x, y, yaw, *CAR_M, Kind.VEHICLE)


def build_camera(roads: RoadMap, weather: str = "default", seed: int = 7, **options: float | str) -> CameraSensor:
    """Return a camera of the CAV "me"."""
    setup = SensorSetup("me", seed, roads, WEATHERS[weather], None, 3)  # type: ignore[index]
    return CameraSensor(SensorSpec("camera", "front", options=options), setup)


def find_eye(scene: SensingFrame) -> SensorPose:
    """Return where the CAV "me" is."""
    me = scene.egos["me"]
    return SensorPose(me.x, me.y, me.yaw, 0)


def take_image(scene: SensingFrame, roads: RoadMap, **options: float | str) -> CameraImage:
    """Return an image of the CAV "me"."""
    image = build_camera(roads, **options).sense(scene, find_eye(scene))
    assert image is not None
    return image
