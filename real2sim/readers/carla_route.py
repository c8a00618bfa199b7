"""CARLA route files (InterDrive, MDrive), one <route> of waypoints each, and CARLA's frame: y to the right, degrees.

Documented by the CARLA leaderboard and MDrive; contents of real files: spec/data_formats section 4.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float, wrap_angle
from real2sim.xml_file import Element, read_number, read_xml

WEATHER_ATTRIBUTES = ("sun_altitude_angle", "cloudiness", "precipitation", "fog_density")
"""Weather attributes that are read: degrees above the horizon, and percent."""


@dataclass(frozen=True, slots=True)
class RouteFile:
    """The route of one road user."""

    path: Path
    town: str
    xy_carla: Float
    """Waypoints (M, 2) [m], M >= 1."""
    yaw_carla_deg: Float
    """(M,), clockwise from above; NaN where the file gives none. In InterDrive's files it is often constant."""
    times_s: Float | None = None
    """(M,); None unless every waypoint has a time."""
    has_point_speeds: bool = False
    """Whether waypoints have speeds of their own. They are ignored: actors have one target speed."""
    weather: Mapping[str, float] = field(default_factory=dict[str, float])
    """Values of `WEATHER_ATTRIBUTES` in the `<weather>` child."""
    attributes: Mapping[str, str] = field(default_factory=dict[str, str])
    """All attributes of `<route>`."""

    @property
    def id(self) -> str:
        """The route's id; "" if there is none."""
        return self.attributes.get("id", "")


def read_route_file(path: Path, at_least: int = 1) -> RouteFile:
    """Read a route XML with `at_least` waypoints; commented-out routes are ignored. Raises InputError."""
    routes = list(read_xml(path).iter("route"))
    if len(routes) != 1:
        raise InputError(f"{path}: expected exactly one <route>, found {len(routes)}")
    route = routes[0]
    town = route.get("town")
    if not town:
        raise InputError(f"{path}: route: expected an attribute town, found none")
    weather = next(route.iterfind("weather"), Element("weather"))
    waypoints = list(route.iter("waypoint"))
    if len(waypoints) < at_least:
        raise InputError(f"{path}: expected at least {at_least} waypoint(s), found {len(waypoints)}")
    return RouteFile(
        path=path,
        town=town,
        xy_carla=np.array([(read_number(path, point, "x"), read_number(path, point, "y")) for point in waypoints]),
        yaw_carla_deg=np.array([read_number(path, p, "yaw") if p.get("yaw") else np.nan for p in waypoints]),
        times_s=_read_times(path, waypoints),
        has_point_speeds=any("speed" in point.attrib for point in waypoints),
        weather={name: read_number(path, weather, name) for name in WEATHER_ATTRIBUTES if name in weather.attrib},
        attributes=dict(route.attrib),
    )


def parse_ego_index(path: Path) -> int | None:
    """Return the index at the end of a CAV's file name; None if there is none."""
    index = path.stem.rpartition("_")[2]
    return int(index) if index.isascii() and index.isdigit() else None


def _read_times(path: Path, waypoints: list[Element]) -> Float | None:
    names = ["time" if "time" in point.attrib else "t" for point in waypoints]
    if not all(name in point.attrib for name, point in zip(names, waypoints, strict=True)):
        return None
    return np.array([read_number(path, point, name) for name, point in zip(names, waypoints, strict=True)])


@dataclass(frozen=True, slots=True)
class CarlaFrame:
    """Pose of CARLA's origin in the map's frame after y is flipped: x, y [m] and yaw [rad] counter-clockwise.

    A CARLA town is its own map and needs only the flip. Logs of V2XPnP need `UCLA_FRAME`.
    """

    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0

    def to_map_xy(self, xy_carla: Float) -> Float:
        """Return points (N, 2) [m] in the map's frame."""
        flipped = xy_carla * np.array((1.0, -1.0))
        if self.yaw:
            c, s = math.cos(self.yaw), math.sin(self.yaw)
            flipped = flipped @ np.array(((c, s), (-s, c)))
        return flipped + np.array((self.x, self.y))

    def to_map_yaw(self, yaw_carla_deg: float) -> float:
        """Return an angle [rad] in the map's frame."""
        return wrap_angle(self.yaw - math.radians(yaw_carla_deg))


UCLA_FRAME = CarlaFrame(502.5, -201.0)
"""CARLA's `ucla_v2` in the frame of V2XPnP's logs and vector maps, as published by MDriveBench (data_formats 1.4)."""
