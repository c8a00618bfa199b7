"""Picture: what is drawn, and the numbers of it that all shaders read."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mdrive_sumo.core.geometry import Float, Int
from mdrive_sumo.sensing.camera.camera_model import CameraModel, CameraView, ImageKind
from mdrive_sumo.sensing.camera.instances import SceneInstances
from mdrive_sumo.sensing.camera.lighting import Lighting
from mdrive_sumo.sensing.camera.shaders import FOG_STEPS
from mdrive_sumo.sensing.camera.static_scene import StaticScene

MAP_PX, MAP_PIXEL_M = 384, 0.2
"""Pixels along a side of the light map, and what each covers [m]: about what one of an image shows 30 m away, and 38 m
away the ground of a flat scene has 12 rows of an image 224 pixels high left to the horizon."""


@dataclass(frozen=True, slots=True)
class Picture:
    """What is drawn: a camera in a scene, with road users and light."""

    model: CameraModel
    view: CameraView
    scene: StaticScene
    instances: SceneInstances
    light: Lighting
    heading: Float
    """(2,) direction of the head lamps."""
    middle: Float
    """(2,) place in the world [m] around which there are shadows: that of the car, the same for all its cameras."""
    without: int | None = None
    """Row of the road user that carries the camera."""
    exposure: float = 1.0

    @property
    def is_wet(self) -> bool:
        """Whether the ground mirrors what stands on it, in colours."""
        return self.light.wet > 0.0 and self.model.kind is ImageKind.RGB

    @property
    def map_cell(self) -> Int:
        """Lower left pixel (2,) of the light map, counted from the world's origin: shadows do not flicker."""
        return np.floor(self.middle / MAP_PIXEL_M).astype(np.int64) - MAP_PX // 2


def pack_view(picture: Picture) -> npt.NDArray[np.float32]:
    """Return the uniform block of the shaders: the matrix, columns first, and rows of four."""
    light, exposure, origin = picture.light, picture.exposure, picture.scene.origin
    fog = light.fog_per_m / FOG_STEPS
    rows = (
        (*(picture.view.place - origin), 0.0),
        (*picture.view.axes[:, 0], light.wet),
        (*origin, exposure),
        (*light.to_sun, 0.0),
        (*light.sun, 0.0),
        (*light.ambient, 0.0),
        (*(exposure * value for value in light.horizon), fog),
        (*(exposure * value for value in light.zenith), 0.0),
        (*picture.heading, 0.0, 0.0),
        (*(picture.map_cell * MAP_PIXEL_M - origin[:2]), 1.0 / (MAP_PX * MAP_PIXEL_M), light.street),
    )
    clip = picture.model.build_clip_matrix(picture.view, origin)
    return np.concatenate((clip.T.reshape(-1), np.array(rows).reshape(-1))).astype(np.float32)
