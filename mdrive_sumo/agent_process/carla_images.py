"""Images of cameras as CARLA gives them to agents: (H, W, 4) bytes in the order blue, green, red, alpha."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from mdrive_sumo.contract import CameraImage, Observation, SensorSpec

Image = npt.NDArray[np.uint8]
DEPTH_SCALE = (256**3 - 1) / 1000.0
"""Units of CARLA's depth image in a metre."""
CLASSES_BESIDE = "/classes"
"""Behind the id of an instance camera: the semantic camera beside it, whose classes CARLA puts into the same image."""


def make_camera_specs(row: Mapping[str, Any], name: str, kind: str, pose: Mapping[str, float]) -> list[SensorSpec]:
    """Return what a declared camera needs here. pose: options of the sensor `camera`; CARLA's size is 800 x 600."""
    options = {
        **pose,
        "width": row.get("width", 800),
        "height": row.get("height", 600),
        "fov_deg": float(row.get("fov", 90.0)),
    }
    kinds = {name: kind} if kind != "instance" else {name: kind, name + CLASSES_BESIDE: "semantic"}
    return [SensorSpec("camera", id, options={**options, "kind": of}) for id, of in kinds.items()]


def convert_image(name: str, seen: Observation) -> Image | None:
    """Return the image of a camera; None in ticks without one."""
    if name not in seen.cameras:
        return None
    image = seen.cameras[name]
    if image.kind == "rgb":
        return _join(image.pixels[..., 2], image.pixels[..., 1], image.pixels[..., 0])
    if image.kind == "semantic":
        return _join(0, 0, image.pixels)
    if image.kind == "depth":
        units = np.rint(np.minimum(image.pixels, 1000.0).astype(np.float64) * DEPTH_SCALE).astype(np.uint32)
        return _join(units >> 16, (units >> 8) & 255, units & 255)
    return _join_instances(image, seen.cameras[name + CLASSES_BESIDE])


def _join_instances(image: CameraImage, classes: CameraImage) -> Image:
    """Return the class in red, and in green and blue a number that an object keeps from tick to tick, 0 for none."""
    numbers = np.array([0, *(1 + int(name.removeprefix("t"), 16) % 65535 for name in image.names)], dtype=np.uint32)
    number = numbers[image.pixels.astype(np.int64) + 1]
    return _join(number >> 8, number & 255, classes.pixels)


def _join(blue: Any, green: Any, red: npt.NDArray[Any]) -> Image:
    joined = np.full((*red.shape, 4), 255, dtype=np.uint8)
    for channel, values in enumerate((blue, green, red)):
        joined[..., channel] = values
    return joined
