"""CARLA route files (InterDrive, MDrive), one <route> of waypoints each.

Documented by the CARLA leaderboard and MDrive; contents of real files: spec/data_formats section 4.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float
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
