"""LiDAR: rays cast on boxes, buildings and the flat ground, with the ray profiles of the paper's wrapper."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from types import MappingProxyType

import numpy as np
import numpy.typing as npt

from mdrive_sumo.contract import PointCloud, SensorSpec
from mdrive_sumo.core import portable
from mdrive_sumo.core.compiled import twin
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Bool, Int
from mdrive_sumo.core.state import DT
from mdrive_sumo.sensing.lidar_cast import HitKeys, cast_rays, pack_keys, unpack_keys
from mdrive_sumo.sensing.lidar_rays import Float32, LidarRays, build_tilted_rays, build_upright_rays, compute_elevations
from mdrive_sumo.sensing.lidar_world import (
    BUILDING_M,
    LidarPose,
    assume_reflectivities,
    assume_vehicle_height,
    load_building_outlines,
    select_boxes,
    select_walls,
)
from mdrive_sumo.sensing.sensing_frame import SensingFrame, SensorPose, SensorSetup, derive_track_name
from mdrive_sumo.sensing.sensor_options import (
    MAX_EVERY_TICKS,
    TICK_OPTIONS,
    check_option_names,
    read_choice,
    read_measuring_ticks,
    read_number,
)

CHANNELS = 64
"""With `RANGE_M` and `FIELD_DEG`, fixed by the paper's wrapper (docs/range-sensors.md)."""
RANGE_M = 85.0
"""[m] Of a clear day; weather shortens it."""
FIELD_DEG = (-30.0, 10.0)
"""Elevation of the lowest and the highest channel."""
ATTENUATION = 0.004
"""Attenuation of intensity [1/m]: exp(-0.004 d), the formula and default of CARLA's ray-cast LiDAR."""
ABOVE_ROOF_M = 1.0
"""Default height above the roof, at the box centre: 2.5 m on a car. The paper gives no pose."""


@dataclass(frozen=True, slots=True)
class RayProfile:
    """Rays per second, and ticks from one full turn to the next."""

    points_per_second: float
    every_ticks: int

    @property
    def columns(self) -> int:
        """Azimuths of a scan: rays per channel and turn, rounded half up as CARLA does."""
        return math.floor(self.points_per_second * self.every_ticks * DT / CHANNELS + 0.5)


PROFILES: Mapping[str, RayProfile] = MappingProxyType({"default": RayProfile(5e5, 1), "lmdrive": RayProfile(6e5, 2)})
"""What the paper's wrapper fixes (its section on agents): a turn every tick at 20 Hz, and at 10 Hz."""
RAY_ATTRIBUTES = (
    *("channels", "range", "range_m", "rotation_frequency", "points_per_second", "upper_fov", "lower_fov"),
    *("horizontal_fov", "sensor_tick", "atmosphere_attenuation_rate"),
    *("dropoff_general_rate", "dropoff_intensity_limit", "dropoff_zero_intensity", "noise_stddev"),
)
"""Options that CARLA agents declare; the paper's wrapper overrides them."""
OPTIONS = (
    *("profile", "x", "y", "z", "roll_deg", "pitch_deg", "yaw_deg", "noise_m", "dropout", "hit_ids"),
    *TICK_OPTIONS,
)

HIT_IDS = "hit_ids"
"""Option that says which object each point lies on: a list of objects by another name."""
RAY_MS, EXTRA_RAY_MS, TILTED_RAY_MS = 2.0e-4, 0.7e-4, 1.0e-3
"""Price of a ray of a LiDAR that stands upright, the addition for names of hits, noise and dropout, and of a ray of one
that leans [ms]; measured 4.7, 6.4 and 23 ms for the 25 024 rays of the default profile, see `price_sensor`."""

NOTHING = 0xFFFFFFFF
"""Owner of a ray that hits nothing; 0 is the ground, then come the boxes and the buildings."""
NOISE, DROPOUT = 0, 1
"""Streams of random numbers."""


@dataclass(frozen=True, slots=True)
class LidarMount:
    """Pose of the sensor relative to the box centre on the ground, right-handed [m, rad]."""

    x: float
    y: float
    z: float
    roll: float
    pitch: float
    yaw: float

    def to_world(self, eye: SensorPose) -> LidarPose:
        """Return the pose in the world for a carrier pose."""
        cos, sin = portable.cos_sin(eye.yaw)
        x, y = eye.x + cos * self.x - sin * self.y, eye.y + sin * self.x + cos * self.y
        return LidarPose(x, y, self.z, eye.yaw + self.yaw)


class LidarSensor:
    """LiDAR with the pose that the agent declares and the rays of the paper's wrapper.

    Options: profile, x, y, z [m], roll_deg, pitch_deg, yaw_deg, noise_m, dropout, hit_ids, and those of
    `sensor_options.read_measuring_ticks`; see docs/range-sensors.md.
    """

    def __init__(self, spec: SensorSpec, fitting: SensorSetup) -> None:
        """Raises InputError."""
        _check_rays(spec)
        check_option_names(spec, OPTIONS)
        self._profile = PROFILES[read_choice(spec, "profile", "default", PROFILES)]
        self._ticks = read_measuring_ticks(spec)
        self._mount = _mount(spec, fitting)
        self._noise_m = read_number(spec, "noise_m", 0.0, 0.0, 1.0)
        self._dropout = read_number(spec, "dropout", 0.0, 0.0, 1.0)
        self._names = _read_flag(spec, HIT_IDS)
        self._fitting = fitting
        self._rays = _rays(self._profile.columns, self._mount.roll, self._mount.pitch)
        self._range = RANGE_M * fitting.weather.lidar_range
        self._empty = _cast_on_ground(self._rays, self._mount.z, self._range)

    def sense(self, scene: SensingFrame, eye: SensorPose) -> PointCloud | None:
        """The scan of this tick, None in ticks without one."""
        if scene.tick % self._profile.every_ticks or not self._ticks.is_due(scene.tick):
            return None
        place, boxes = self._mount.to_world(eye), scene.boxes
        around = select_boxes(boxes, eye.carrier_row, place, self._range)
        behind = select_walls(load_building_outlines(self._fitting.roads), place, self._range, 1 + len(boxes.ids))
        return self._cloud(scene, cast_rays(self._rays, around, behind, place.z, self._empty))

    def _cloud(self, scene: SensingFrame, keys: HitKeys) -> PointCloud:
        kept, noise_m = np.zeros(0, dtype=np.bool_), np.zeros(0, dtype=np.float32)
        if self._dropout:
            kept = self._random(scene.tick, DROPOUT).random(len(keys)) >= self._dropout
        if self._noise_m:
            noise = self._random(scene.tick, NOISE).standard_normal(len(keys), dtype=np.float32)
            noise_m = np.float32(self._noise_m) * noise
        reflectivity = assume_reflectivities(scene.boxes, len(self._fitting.roads.buildings))
        points, owner = build_points(self._rays, keys, kept, noise_m, reflectivity)
        hits, names = self._name_hits(scene, owner) if self._names else (np.zeros(0, dtype=np.int32), ())
        return PointCloud(points, hits, names)

    def _random(self, tick: int, stream: int) -> np.random.Generator:
        """Return a counter-based generator that depends on the sensor, the tick and the stream only."""
        return np.random.Generator(np.random.Philox(key=self._fitting.seed, counter=(0, 0, stream, tick)))

    def _name_hits(self, scene: SensingFrame, owner: Int) -> tuple[npt.NDArray[np.int32], tuple[str, ...]]:
        """Return the index of the object that each point lies on, and the names of all objects hit, sorted.

        Any other order would follow the scenario file.
        """
        boxes, buildings = scene.boxes.ids, self._fitting.roads.buildings
        count = np.bincount(owner, minlength=1 + len(boxes) + len(buildings))
        carrier, salt = self._fitting.carrier, self._fitting.track_salt
        number_by_name = {
            derive_track_name(carrier, boxes[i - 1], salt)
            if i <= len(boxes)
            else f"building:{buildings[i - 1 - len(boxes)].id}": i
            for i in (1 + np.flatnonzero(count[1:])).tolist()
        }
        names = tuple(sorted(number_by_name))
        index = np.full(len(count), -1, dtype=np.int32)
        index[[number_by_name[name] for name in names]] = np.arange(len(names))
        return index[owner], names


@twin
def build_points(
    rays: LidarRays, keys: HitKeys, kept: Bool, noise_m: Float32, reflectivity: Float32, /
) -> tuple[Float32, Int]:
    """Return the points (N, 4) of a scan as in `PointCloud`, and what each lies on (N,).

    keys: hits (rays,). kept: (rays,) mask of the rays that do not drop out, or empty. noise_m: (rays,) errors of
    distance [m], or empty. reflectivity: by owner.
    """
    across, owner = unpack_keys(keys)
    distance, hit = across * rays.stretch, owner != NOTHING
    if len(noise_m):
        distance = np.maximum(distance + noise_m, np.float32(0))
    rows = np.flatnonzero(hit & kept if len(kept) else hit)
    distance, owner = distance[rows], owner[rows]
    points = np.empty((len(rows), 4), dtype=np.float32)
    np.multiply(rays.local[rows], distance[:, None], out=points[:, :3])
    np.multiply(reflectivity[owner], portable.exp(np.float32(-ATTENUATION) * distance), out=points[:, 3])
    return points, owner


def price_lidar(spec: SensorSpec) -> float:
    """Return the price of a LiDAR [ms a tick]."""
    profile = PROFILES.get(str(spec.options.get("profile", "default")), PROFILES["default"])
    leans = bool(spec.options.get("roll_deg", 0.0)) or bool(spec.options.get("pitch_deg", 0.0))
    ray_ms = TILTED_RAY_MS if leans else RAY_MS
    if any(spec.options.get(name) for name in (HIT_IDS, "noise_m", "dropout")):
        ray_ms += EXTRA_RAY_MS
    every = spec.options.get("every_ticks", 1)
    ticks = round(every) if isinstance(every, int | float) and 1 <= every <= MAX_EVERY_TICKS else 1
    return ray_ms * profile.columns * CHANNELS / math.lcm(profile.every_ticks, ticks)


def find_lidar_labels(spec: SensorSpec) -> str:
    """Return by what a LiDAR gives objects; "" for bare points."""
    return f"{spec.kind!r} with {HIT_IDS}" if spec.options.get(HIT_IDS, False) else ""


def _cast_on_ground(rays: LidarRays, height: float, reach: float) -> HitKeys:
    """Return the hits of the rays on empty ground."""
    ground = height / np.maximum(-rays.slope, 1e-9)
    limit = reach / rays.stretch.astype(np.float64)
    return np.where(ground <= limit, pack_keys(ground, np.array(0)), pack_keys(limit, np.array(NOTHING)))


@lru_cache(maxsize=8)
def _rays(columns: int, roll: float, pitch: float) -> LidarRays:
    elevation = compute_elevations(CHANNELS, *FIELD_DEG)
    return (
        build_tilted_rays(columns, elevation, roll, pitch) if roll or pitch else build_upright_rays(columns, elevation)
    )


def _check_rays(spec: SensorSpec) -> None:
    for name in spec.options:
        if name in RAY_ATTRIBUTES:
            raise InputError(
                f"sensor 'lidar': option {name!r}: expected the pose only (x, y, z, roll_deg, pitch_deg, yaw_deg), "
                "found a ray attribute, which the benchmark fixes by its profile as the paper's wrapper does"
            )
    if spec.range_m != SensorSpec("lidar").range_m:
        raise InputError(
            f"sensor 'lidar': range_m: expected none, for only the pose is honoured and the range is {RANGE_M:g} m, "
            f"found {spec.range_m}"
        )


def _mount(spec: SensorSpec, fitting: SensorSetup) -> LidarMount:
    car = None if fitting.briefing is None else fitting.briefing.vehicle
    roof = assume_vehicle_height(car.length if car is not None else 0.0)
    x, y = (read_number(spec, name, 0.0, -10.0, 10.0) for name in ("x", "y"))
    z = read_number(spec, "z", roof + ABOVE_ROOF_M, 0.05, BUILDING_M - 0.5)
    if car is not None and abs(x) <= car.length / 2 and abs(y) <= car.width / 2 and z <= roof:
        raise InputError(
            f"sensor 'lidar': pose: expected a place outside of the car's body "
            f"({car.length:g} x {car.width:g} x {roof:g} m), found x = {x:g}, y = {y:g}, z = {z:g} inside it"
        )
    roll, pitch, yaw = (
        math.radians(read_number(spec, f"{name}_deg", 0.0, -180, 180)) for name in ("roll", "pitch", "yaw")
    )
    return LidarMount(x, y, z, roll, pitch, yaw)


def _read_flag(spec: SensorSpec, name: str) -> bool:
    value = spec.options.get(name, False)
    if not isinstance(value, bool):
        raise InputError(f"sensor {spec.kind!r}: option {name!r}: expected true or false, found {value!r}")
    return value
