"""Prices of sensors: the CPU time that the evaluator needs for them, which a competing agent may use within a budget.

Linear models of the time of a call, fitted to `python tests/bench/sensors.py` (two shared cores, 100 road
users and 40 buildings around the car): at most 10 % below the measured medians.
"""

from collections.abc import Sequence

from mdrive_sumo.contract import SensorSpec
from mdrive_sumo.core import portable
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.sensing.camera.camera_sensor import BLUR_STEPS, MAX_SIDE_PX
from mdrive_sumo.sensing.lidar_sensor import CHANNELS, PROFILES
from mdrive_sumo.sensing.raster_sensor import MAX_SIZE
from mdrive_sumo.sensing.raster_sensor import PROFILES as TOP_VIEWS

BUDGET_MS = 40.0
"""Price of all sensors of a CAV together [ms a tick]: a raster of 1024 pixels, a LiDAR and objects cost 37."""
OBJECTS_MS = 1.5
"""Objects within range, whatever its options [ms]; measured 0.8 to 1.5."""
SMALL_MS = 0.05
"""Satellite receiver, inertial unit, speedometer [ms]."""
RASTER_MS, PIXEL_MS = 1.0, 2.8e-5
"""A raster, the sight of its objects included, and each pixel of the image [ms]; measured 29 ms for 1024 x 1024."""
RAY_MS, EXTRA_RAY_MS, TILTED_RAY_MS = 2.0e-4, 0.7e-4, 1.0e-3
"""A ray of a LiDAR that stands upright, the addition for names of hits, noise and dropout, and a ray of one that leans
[ms]; measured 4.7, 6.4 and 23 ms for the 25 024 rays of the default profile."""
CAMERA_MS, CAMERA_PIXEL_MS = 1.2, 2.7e-5
"""An image of a camera, and each of its pixels [ms], drawn by Mesa's software renderer on one core; measured 1.9 ms for
400 x 224 pixels and 4.4 ms for 900 x 256, on a machine that is 1.1 to 1.7 times as fast as that of the other prices."""
EXTRAS = ("hit_ids", "noise_m", "dropout")


def price_sensor(spec: SensorSpec) -> float:
    """Return the price of a sensor in CPU time [ms a tick]. Unusable options cost the most; the sensor refuses them."""
    if spec.kind == "bev":
        return RASTER_MS + PIXEL_MS * portable.square(_read_size(spec))
    if spec.kind == "lidar":
        return _price_lidar(spec)
    if spec.kind == "camera":
        return _price_camera(spec)
    return OBJECTS_MS if spec.kind == "objects" else SMALL_MS


def check_sensor_budget(sensors: Sequence[SensorSpec]) -> None:
    """Raise InputError if the sensors of a CAV cost more than `BUDGET_MS`; the sentence names the dearest one."""
    prices = [price_sensor(spec) for spec in sensors]
    if (total := sum(prices)) <= BUDGET_MS:
        return
    price, dearest = max(zip(prices, sensors, strict=True), key=lambda pair: pair[0])
    raise InputError(
        f"sensors: expected a price of at most {BUDGET_MS:g} ms a tick for each car (docs/sensors.md, prices), found "
        f"{total:.1f} ms for {len(sensors)} sensors, of which {dearest.kind!r} {dearest.id!r:.40} costs {price:.1f} ms"
    )


def _price_lidar(spec: SensorSpec) -> float:
    profile = PROFILES.get(str(spec.options.get("profile", "default")), PROFILES["default"])
    leans = bool(spec.options.get("roll_deg", 0.0)) or bool(spec.options.get("pitch_deg", 0.0))
    ray_ms = TILTED_RAY_MS if leans else RAY_MS
    if any(spec.options.get(name) for name in EXTRAS):
        ray_ms += EXTRA_RAY_MS
    return ray_ms * profile.columns * CHANNELS / profile.every_ticks


def _price_camera(spec: SensorSpec) -> float:
    """Return the price of a camera; several pictures make a blurred image."""
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


def _read_size(spec: SensorSpec) -> float:
    view = TOP_VIEWS.get(str(spec.options.get("profile", "default")), TOP_VIEWS["default"])
    size = spec.options.get("size", view.size)
    return float(size) if isinstance(size, int | float) and 0 <= size <= MAX_SIZE else float(MAX_SIZE)
