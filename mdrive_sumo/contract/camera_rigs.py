"""The cameras of the paper's agents (its table of sensor configurations), for `Agent.sensors`."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from mdrive_sumo.contract.sensors import SensorSpec
from mdrive_sumo.core.errors import InputError

TOP_M = 50.0
"""Height of the cameras that look straight down, as `raster_sensor.CAMERA_HEIGHT_M`: the paper gives none."""


@dataclass(frozen=True, slots=True)
class RigCamera:
    """A camera of a rig: pose [m, degrees], x ahead, y left, yaw to the left, and its image [pixels, degrees]."""

    id: str
    size: tuple[int, int]
    fov_deg: float
    x: float = 1.3
    y: float = 0.0
    z: float = 2.3
    yaw_deg: float = 0.0
    pitch_deg: float = 0.0


def _build_four(size: tuple[int, int], sides: tuple[int, int] | None = None) -> tuple[RigCamera, ...]:
    """Return cameras to the front, the rear, the left and the right (yaws of the paper's table)."""
    other = sides or size
    return (
        RigCamera("front", size, 100.0),
        RigCamera("rear", other, 100.0, x=-1.3, yaw_deg=180.0),
        RigCamera("left", other, 100.0, yaw_deg=60.0),
        RigCamera("right", other, 100.0, yaw_deg=-60.0),
    )


def _build_six(size: tuple[int, int]) -> tuple[RigCamera, ...]:
    """Return the six cameras of the nuScenes-style rig; places and yaws are those of Bench2Drive's public agents."""
    return (
        RigCamera("front", size, 70.0, x=0.8, z=1.6),
        RigCamera("front-left", size, 70.0, x=0.27, y=0.55, z=1.6, yaw_deg=55.0),
        RigCamera("front-right", size, 70.0, x=0.27, y=-0.55, z=1.6, yaw_deg=-55.0),
        RigCamera("back", size, 110.0, x=-2.0, z=1.6, yaw_deg=180.0),
        RigCamera("back-left", size, 70.0, x=-0.32, y=0.55, z=1.6, yaw_deg=110.0),
        RigCamera("back-right", size, 70.0, x=-0.32, y=-0.55, z=1.6, yaw_deg=-110.0),
    )


def _build_top(size: int, fov_deg: float) -> RigCamera:
    return RigCamera("top", (size, size), fov_deg, x=0.0, z=TOP_M, pitch_deg=90.0)


RIGS: Mapping[str, tuple[RigCamera, ...]] = MappingProxyType(
    {
        "tcp": (RigCamera("front", (900, 256), 100.0), _build_top(256, 120.0)),
        "uniad": (*_build_six((1600, 900)), _build_top(512, 50.0)),
        "vad": _build_six((800, 450)),
        "lmdrive": _build_four((1200, 900), (400, 300)),
        "codriving": _build_four((1600, 900)),
        "colmdriver": _build_four((3000, 1500)),
        "perception-swap": (RigCamera("front", (800, 600), 100.0), _build_top(800, 90.0)),
        "hitl": _build_four((640, 360)),
    }
)
"""By the paper's agents. Poses that the paper does not give are those of its four-camera rigs."""


def build_camera_rig(name: str, scale: float = 1.0, kind: str = "rgb", every_ticks: int = 1) -> tuple[SensorSpec, ...]:
    """Return the cameras of a rig. scale: of the sides of the images, in (0, 1]. Raises InputError."""
    if name not in RIGS:
        raise InputError(f"camera rig {name!r}: expected one of {', '.join(RIGS)}, found none of that name")
    if not 0.0 < scale <= 1.0:
        raise InputError(f"camera rig {name!r}: scale: expected a number in (0, 1], found {scale}")
    return tuple(_build_spec(camera, scale, kind, every_ticks) for camera in RIGS[name])


def _build_spec(camera: RigCamera, scale: float, kind: str, every_ticks: int) -> SensorSpec:
    width, height = (max(16, round(side * scale)) for side in camera.size)
    pose = {"x": camera.x, "y": camera.y, "z": camera.z, "yaw_deg": camera.yaw_deg, "pitch_deg": camera.pitch_deg}
    image = {"kind": kind, "width": width, "height": height, "fov_deg": camera.fov_deg, "every_ticks": every_ticks}
    return SensorSpec("camera", camera.id, options={**image, **pose})
