"""CameraSensor: images of what lies before a camera on the car, rendered in the ticks that the agent declares."""

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from mdrive_sumo.contract import CameraImage, SensorSpec
from mdrive_sumo.core import portable
from mdrive_sumo.sensing.camera.camera_model import CameraModel, CameraMount, CameraView, ImageKind
from mdrive_sumo.sensing.camera.lighting import LIGHT_OF_WEATHER, LIGHTS
from mdrive_sumo.sensing.sensing_frame import SensingFrame, SensorPose, SensorSetup, derive_track_name
from mdrive_sumo.sensing.sensor_options import (
    TICK_OPTIONS,
    check_option_names,
    read_choice,
    read_measuring_ticks,
    read_number,
    read_whole,
)

OPTIONS = (
    *("kind", "width", "height", "fov_deg", "x", "y", "z", "roll_deg", "pitch_deg", "yaw_deg"),
    *TICK_OPTIONS,
    *("light", "exposure", "noise", "motion_blur_s"),
)
MAX_SIDE_PX = 3000
"""The widest image of the paper's rigs."""
SCENARIO_LIGHT = "scenario"
"""The light of the scenario's weather."""
BLUR_STEPS = 4
"""Pictures of which a blurred one is the mean."""
CAMERA_MS, CAMERA_PIXEL_MS = 1.2, 2.7e-5
"""Price of an image, and of each of its pixels [ms], drawn by Mesa's software renderer on one core; measured 1.9 ms for
400 x 224 pixels and 4.4 ms for 900 x 256, on a machine that is 1.1 to 1.7 times as fast as that of the prices of other
sensors (`sensor_kinds.price_sensor`)."""
LABELLED_IMAGES = (ImageKind.SEMANTIC.value, ImageKind.INSTANCE.value)
"""Kinds of images that say what each pixel shows."""


class CameraSensor:
    """A pinhole camera with the pose and size that the agent declares; see docs/cameras.md for its options."""

    def __init__(self, spec: SensorSpec, fitting: SensorSetup) -> None:
        """Raises InputError, also where nothing can render."""
        from mdrive_sumo.sensing.camera.camera_renderer import load_renderer  # only here: it builds all models

        check_option_names(spec, OPTIONS)
        self._model = read_camera_model(spec)
        self._ticks = read_measuring_ticks(spec)
        light = read_choice(spec, "light", SCENARIO_LIGHT, (SCENARIO_LIGHT, *LIGHTS))
        self._light = LIGHTS[LIGHT_OF_WEATHER[fitting.weather.name] if light == SCENARIO_LIGHT else light]
        self._exposure = read_number(spec, "exposure", 1.0, 0.1, 10.0)
        self._noise = read_number(spec, "noise", 0.0, 0.0, 0.5)
        self._blur_s = read_number(spec, "motion_blur_s", 0.0, 0.0, 0.05)
        self._fitting = fitting
        self._renderer = load_renderer()

    def sense(self, scene: SensingFrame, eye: SensorPose) -> CameraImage | None:
        """Return the image of this tick, None in ticks without one."""
        if not self._ticks.is_due(scene.tick):
            return None
        from mdrive_sumo.sensing.camera.camera_renderer import Picture
        from mdrive_sumo.sensing.camera.instances import load_instances
        from mdrive_sumo.sensing.camera.static_scene import load_static_scene

        static = load_static_scene(self._fitting.roads)
        instances = load_instances(scene, static)
        heading = np.array(portable.cos_sin(eye.yaw))
        without, light, exposure = eye.carrier_row, self._light, self._exposure
        pictures = [
            self._renderer.draw(Picture(self._model, view, static, instances, light, heading, without, exposure))
            for view in self._list_views(scene, eye)
        ]
        return self._finish(scene, self._spoil(scene.tick, pictures))

    def _list_views(self, scene: SensingFrame, eye: SensorPose) -> list[CameraView]:
        """Return the pose of the camera, and those during the exposure if motion blurs the image."""
        if not self._blur_s or self._model.kind is not ImageKind.RGB or eye.carrier_row is None:
            return [self._model.find_view(eye.x, eye.y, eye.yaw)]
        (ego,) = [state for row, state in enumerate(scene.egos.values()) if row == eye.carrier_row]
        ages = [self._blur_s * i / BLUR_STEPS for i in range(BLUR_STEPS)]
        cos, sin = portable.cos_sin(eye.yaw)
        return [
            self._model.find_view(
                eye.x - cos * ego.speed * age, eye.y - sin * ego.speed * age, eye.yaw - ego.yaw_rate * age
            )
            for age in ages
        ]

    def _spoil(self, tick: int, pictures: list[npt.NDArray[Any]]) -> npt.NDArray[Any]:
        """Return the mean of the pictures, with noise if it is declared; both in colours only."""
        if self._model.kind is not ImageKind.RGB or (len(pictures) == 1 and not self._noise):
            return pictures[0]
        mean = np.mean(pictures, axis=0, dtype=np.float32)
        if self._noise:
            random = np.random.Generator(np.random.Philox(key=self._fitting.seed, counter=(0, 0, 0, tick)))
            mean += np.float32(255 * self._noise) * random.standard_normal(mean.shape, dtype=np.float32)
        return np.clip(mean + np.float32(0.5), 0, 255).astype(np.uint8)

    def _finish(self, scene: SensingFrame, pixels: npt.NDArray[Any]) -> CameraImage:
        model = self._model
        if model.kind is not ImageKind.INSTANCE:
            return CameraImage(model.kind.value, pixels, model.focal_px)
        carrier, salt = self._fitting.carrier, self._fitting.track_salt
        shown = np.flatnonzero(np.bincount(pixels.reshape(-1))[1:]) + 1
        tag_by_name = {derive_track_name(carrier, scene.boxes.ids[tag - 1], salt): tag for tag in shown.tolist()}
        names = tuple(sorted(tag_by_name))
        index = np.full(len(scene.boxes) + 1, -1, dtype=np.int32)
        index[[tag_by_name[name] for name in names]] = np.arange(len(names))
        return CameraImage(model.kind.value, index[pixels], model.focal_px, names)


def price_camera(spec: SensorSpec) -> float:
    """Return the price of a camera [ms a tick]; several pictures make a blurred image."""
    width, height, every = (
        _read_positive(spec, name, default, most)
        for name, default, most in (("width", 400, MAX_SIDE_PX), ("height", 224, MAX_SIDE_PX), ("every_ticks", 1, 1))
    )
    pictures = BLUR_STEPS if spec.options.get("motion_blur_s") else 1
    return pictures * (CAMERA_MS + CAMERA_PIXEL_MS * width * height) / every


def _read_positive(spec: SensorSpec, name: str, default: float, dearest: float) -> float:
    """Return a number of at least 1; an unusable one counts as the dearest."""
    value = spec.options.get(name, default)
    return float(value) if isinstance(value, int | float) and 1 <= value <= MAX_SIDE_PX else dearest


def find_camera_labels(spec: SensorSpec) -> str:
    """Return by what a camera gives objects; "" for images that do not say what they show."""
    kind = spec.options.get("kind")
    return f"{spec.kind!r} of kind {kind!r}" if kind in LABELLED_IMAGES else ""


def read_camera_model(spec: SensorSpec) -> CameraModel:
    """Return size, field of view and pose that a specification declares. Raises InputError."""
    kind = ImageKind(read_choice(spec, "kind", ImageKind.RGB, [kind.value for kind in ImageKind]))
    width, height = (
        read_whole(spec, name, default, 16, MAX_SIDE_PX) for name, default in (("width", 400), ("height", 224))
    )
    x, y = (read_number(spec, name, default, -10.0, 10.0) for name, default in (("x", 1.3), ("y", 0.0)))
    z = read_number(spec, "z", 2.3, 0.1, 100.0)
    roll, pitch, yaw = (
        math.radians(read_number(spec, f"{name}_deg", 0.0, -180.0, 180.0)) for name in ("roll", "pitch", "yaw")
    )
    fov = read_number(spec, "fov_deg", 100.0, 5.0, 160.0)
    return CameraModel(kind, width, height, fov, CameraMount(x, y, z, roll, pitch, yaw))
