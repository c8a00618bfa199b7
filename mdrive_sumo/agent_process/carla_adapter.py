"""Agents of the CARLA leaderboard, run unchanged: for one vehicle, or one object for all CAVs as in MDrive's challenge.

The module names its class by `get_entry_point()`; then `setup(config, ego_num)`, `sensors()`, `set_global_plan(gps,
world)`, and per tick `run_step(input_data, timestamp)`, which returns a list of controls, one a CAV (protocol 9). An
agent for one vehicle has `setup(config)`, one route in its plan, sensors without a number in `input_data`, and returns
one control.

Everything is told in CARLA's conventions: left-handed, y to the right or south, degrees, yaw clockwise. This runs in
the agent's process.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from inspect import signature
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from mdrive_sumo.agent_process.agent_lookup import load_module_from_file
from mdrive_sumo.agent_process.carla_images import convert_image, make_camera_specs
from mdrive_sumo.agent_process.carla_stubs import Location, RoadOption, Rotation, Transform, call_setup, install_stubs
from mdrive_sumo.contract import Briefing, Control, Observation, Reply, SensorSpec
from mdrive_sumo.core import portable
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import DT
from mdrive_sumo.planning.route_commands import RouteCommand, find_route_commands

EARTH_RADIUS_M = 6_378_137.0
"""Equatorial radius of WGS 84, by which the CARLA leaderboard turns routes into GPS coordinates."""
KINDS = {"sensor.other.gnss": "gnss", "sensor.other.imu": "imu", "sensor.speedometer": "speedometer"}
"""Of which a CAV has one here, at its box centre; several declared ones read the same."""
LIDAR = "sensor.lidar.ray_cast"
CAMERAS = {
    "sensor.camera.rgb": "rgb",
    "sensor.camera.semantic_segmentation": "semantic",
    "sensor.camera.depth": "depth",
    "sensor.camera.instance_segmentation": "instance",
}
"""Kind of image by CARLA's name of the camera."""
SLOW_LIDAR = frozenset({"lmdrive", "TCP", "LAV", "transfuser", "interfuser", "WOR"})
"""Agents (`agent_name`) to which the original gives a LiDAR of 10 Hz."""
ROAD_OPTIONS: Mapping[int, RoadOption] = {
    RouteCommand.FOLLOW: RoadOption.LANEFOLLOW,
    RouteCommand.LEFT: RoadOption.LEFT,
    RouteCommand.RIGHT: RoadOption.RIGHT,
    RouteCommand.CHANGE_LEFT: RoadOption.CHANGELANELEFT,
    RouteCommand.CHANGE_RIGHT: RoadOption.CHANGELANERIGHT,
}
"""CARLA's name of a command. STRAIGHT, which CARLA says in junctions, is never said: a briefing knows none."""


NO_SERVER = ("localhost", 2000, False)
"""Where an agent of the second leaderboard is told that CARLA's server is: host, port, debug. There is none."""


@dataclass(frozen=True, slots=True)
class CarlaSensor:
    """One declared sensor: the agent's name for it, its kind here, and where it sits ahead, to the left, up [m]."""

    id: str
    kind: str
    place: tuple[float, float, float]


class CarlaAgentAdapter:
    """Such an agent behind the calls of `host`."""

    def __init__(self, path: str, config: Mapping[str, Any], cavs: Sequence[str], *, is_single: bool = False) -> None:
        """config: `config` is the file that `setup` is told. is_single: whether it is an agent for one vehicle.

        Raises InputError, and whatever the agent raises.
        """
        install_stubs()
        module = load_module_from_file(Path(path))
        entry: Any = getattr(module, "get_entry_point", None)
        cls: Any = getattr(module, str(entry()), None) if callable(entry) else None
        if not callable(cls):
            raise InputError(f"agent {path}: expected get_entry_point() to name a class of the module, found none")
        self._cavs, self._is_single = tuple(cavs), is_single
        file = str(config.get("config", ""))
        self._agent = _create_agent(cls, file, len(self._cavs), is_single=is_single)
        self._sensors: tuple[CarlaSensor, ...] = ()

    def sensors(self) -> tuple[SensorSpec, ...]:
        """What it declares, in our terms; kinds that do not exist here keep their name and are refused by it."""
        declared: list[Mapping[str, Any]] = list(self._agent.sensors())
        slow = getattr(self._agent, "agent_name", "") in SLOW_LIDAR
        self._sensors = tuple(_read_sensor(row) for row in declared)
        specs: dict[tuple[str, str], SensorSpec] = {}
        for row, sensor in zip(declared, self._sensors, strict=True):
            for spec in _make_specs(row, sensor, slow):
                specs[spec.kind, spec.id] = spec
        return tuple(specs.values())

    def start(self, briefings: Mapping[str, Briefing], gps: Mapping[str, Float]) -> None:
        """Hands over the routes. gps: (N, 3) latitude, longitude [degrees], altitude [m] of their points."""
        told = [find_road_options(briefings[cav]) for cav in self._cavs]
        on_globe = [
            [
                ({"lat": lat, "lon": lon, "z": z}, option)
                for (lat, lon, z), option in zip(gps[cav].tolist(), row, strict=True)
            ]
            for cav, row in zip(self._cavs, told, strict=True)
        ]
        in_world = [
            list(zip(make_transforms(briefings[cav]), row, strict=True))
            for cav, row in zip(self._cavs, told, strict=True)
        ]
        if self._is_single:
            self._agent.set_global_plan(on_globe[0], in_world[0])
        else:
            self._agent.set_global_plan(on_globe, in_world)

    def act(self, seen: Mapping[str, Observation]) -> dict[str, Reply | None]:
        """One step for all CAVs that are asked; the others' controls are not looked at."""
        tick = next(iter(seen.values())).tick
        data = SensorReadings()
        for number, cav in enumerate(self._cavs):
            if cav in seen:
                data.update(_convert_reading(self._sensors, "" if self._is_single else f"_{number}", seen[cav]))
        controls = self._agent.run_step(data, tick * DT)
        if len(self._cavs) == 1 and not isinstance(controls, list | tuple):
            controls = [controls]
        if not isinstance(controls, list | tuple):
            raise TypeError(
                f"run_step(): expected a list of {len(self._cavs)} controls, found {type(controls).__name__}; "
                "docs/carla-agents.md says how an agent for one vehicle is started"
            )
        if len(controls) != len(self._cavs):
            raise TypeError(f"run_step(): expected a list of {len(self._cavs)} controls, found {len(controls)}")
        return {cav: _make_reply(control) for cav, control in zip(self._cavs, controls, strict=True) if cav in seen}


def _create_agent(cls: Any, config: str, vehicles: int, *, is_single: bool) -> Any:
    """Return the agent, set up. The base class of the leaderboard calls `setup` when it is made.

    A class without a constructor does not; that of the second leaderboard is told where CARLA's server is.
    """
    names = [*signature(cls).parameters] if is_single and cls.__init__ is not object.__init__ else []
    has_server = bool(names) and "host" in names[0]
    if cls.__init__ is object.__init__ or has_server:
        agent = cls(*NO_SERVER[: len(names)])
        call_setup(agent, config, vehicles)
        return agent
    return cls(config) if is_single else cls(config, vehicles)


class SensorReadings(dict[str, tuple[int, Any]]):
    """(tick, data) by the sensor's id; asking for another one names those that there are."""

    def __missing__(self, name: str) -> NoReturn:
        raise KeyError(f"{name}: expected a sensor of this tick ({', '.join(self) or 'none'}), found no such sensor")


def _read_sensor(row: Mapping[str, Any]) -> CarlaSensor:
    name, kind = row.get("id"), str(row.get("type"))
    if not isinstance(name, str):
        raise InputError(f"sensors(): expected an id for every sensor, found {name!r} for {kind!r}")
    kind = "lidar" if kind == LIDAR else CAMERAS.get(kind, KINDS.get(kind, kind))
    return CarlaSensor(name, kind, (_read_number(row, "x"), -_read_number(row, "y"), _read_number(row, "z")))


def _read_number(row: Mapping[str, Any], name: str) -> float:
    return float(row.get(name, 0.0))


def _make_specs(row: Mapping[str, Any], sensor: CarlaSensor, slow: bool) -> list[SensorSpec]:
    if sensor.kind in CAMERAS.values():
        return make_camera_specs(row, sensor.id, sensor.kind, _read_pose(row, sensor))
    if sensor.kind == "lidar":
        return [_make_lidar_spec(row, sensor, slow)]
    return [SensorSpec(sensor.kind) if sensor.kind in KINDS.values() else SensorSpec(sensor.kind, sensor.id)]


def _read_pose(row: Mapping[str, Any], sensor: CarlaSensor) -> dict[str, float]:
    """Mirrored: y, yaw and pitch change their sign."""
    x, y, z = sensor.place
    roll, pitch, yaw = (_read_number(row, name) for name in ("roll", "pitch", "yaw"))
    return {"x": x, "y": y, "z": z, "roll_deg": roll, "pitch_deg": -pitch, "yaw_deg": -yaw}


def _make_lidar_spec(row: Mapping[str, Any], sensor: CarlaSensor, slow: bool) -> SensorSpec:
    """Only its pose is honoured, as in the original."""
    profile = "lmdrive" if slow else "default"
    return SensorSpec("lidar", sensor.id, options={**_read_pose(row, sensor), "profile": profile})


def _convert_reading(sensors: Sequence[CarlaSensor], ending: str, seen: Observation) -> dict[str, tuple[int, Any]]:
    """What one CAV's sensors read: (tick, data) by the sensor's id with the ending of the CAV behind it."""
    read = {f"{sensor.id}{ending}": READERS[sensor.kind](sensor, seen) for sensor in sensors}
    return {name: (seen.tick, data) for name, data in read.items() if data is not None}


def _convert_points(sensor: CarlaSensor, seen: Observation) -> Any:
    """(N, 4) float32: x ahead, y to the right, z up [m], intensity; None between two scans."""
    if sensor.id not in seen.lidar:
        return None
    points = seen.lidar[sensor.id].points.copy()
    points[:, 1] *= -1.0
    return points


def _convert_gnss(sensor: CarlaSensor, seen: Observation) -> Any:
    """Latitude, longitude [degrees], altitude [m] of the receiver where it was put: ours is at the box centre."""
    assert seen.gnss is not None
    ahead, left, up = sensor.place
    cos, sin = portable.cos_sin(seen.own.yaw)
    east, north = cos * ahead - sin * left, sin * ahead + cos * left
    latitude = math.radians(seen.gnss.latitude_deg)
    return np.array(
        (
            seen.gnss.latitude_deg + math.degrees(north / EARTH_RADIUS_M * portable.cos(latitude)),
            seen.gnss.longitude_deg + math.degrees(east / EARTH_RADIUS_M),
            seen.gnss.altitude_m + up,
        )
    )


def _convert_imu(_: CarlaSensor, seen: Observation) -> Any:
    """Acceleration [m/s2], angular rate [rad/s], compass [rad]. Mirrored: a polar and an axial vector."""
    assert seen.imu is not None
    (ax, ay, az), (gx, gy, gz) = seen.imu.acceleration, seen.imu.angular_rate
    return np.array((ax, -ay, az, -gx, gy, -gz, seen.imu.compass))


def _convert_speed(_: CarlaSensor, seen: Observation) -> dict[str, float]:
    """[m/s]"""
    assert seen.speedometer is not None
    return {"speed": seen.speedometer}


def _convert_image(sensor: CarlaSensor, seen: Observation) -> Any:
    return convert_image(sensor.id, seen)


READERS: Mapping[str, Callable[[CarlaSensor, Observation], Any]] = {
    **dict.fromkeys(CAMERAS.values(), _convert_image),
    "lidar": _convert_points, "gnss": _convert_gnss, "imu": _convert_imu, "speedometer": _convert_speed
}  # fmt: skip


def make_transforms(briefing: Briefing) -> list[Transform]:
    """The route's points."""
    poses = zip(briefing.route_xy.tolist(), np.degrees(briefing.route_yaw).tolist(), strict=True)
    return [Transform(Location(x, -y, 0.0), Rotation(yaw=-yaw)) for (x, y), yaw in poses]


def find_road_options(briefing: Briefing) -> list[RoadOption]:
    """Return what the route does at each of its points."""
    return [ROAD_OPTIONS[command] for command in find_route_commands(briefing.route_xy, briefing.route_yaw).tolist()]


def _make_reply(control: Any) -> Reply | None:
    """A VehicleControl; cut to its range as CARLA does. There is no reverse gear here: its throttle does nothing."""
    if control is None:
        return None
    throttle = 0.0 if getattr(control, "reverse", False) else _clip_number(control.throttle, 0.0)
    brake = 1.0 if getattr(control, "hand_brake", False) else _clip_number(control.brake, 0.0)
    return Reply(control=Control(throttle, brake, -_clip_number(control.steer, -1.0)))


def _clip_number(value: Any, low: float) -> float:
    number = float(value)
    return number if math.isnan(number) else min(max(number, low), 1.0)
