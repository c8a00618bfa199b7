"""InterDrive's files: a folder a scenario, an XML a CAV, waypoints in CARLA's frame (y to the right)."""

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from mdrive_sumo.errors import InputError
from mdrive_sumo.geometry import Float
from real2sim.xml_file import number, read_xml


@dataclass(frozen=True, slots=True)
class RouteFile:
    """The route of one CAV. `yaw` is not read: in many files it is one constant (data_formats section 4)."""

    path: Path
    index: int
    """Number at the end of the file name; the CAV's id."""
    town: str
    xy_carla: Float
    """Waypoints (M, 2) [m], M >= 2."""


@dataclass(frozen=True, slots=True)
class RouteFolder:
    """A scenario of InterDrive: CAVs sorted by index, all in one town."""

    name: str
    town: str
    routes: tuple[RouteFile, ...]

    @property
    def category(self) -> str:
        """The name's tail: `ins_c` of `r1_town05_ins_c`."""
        return self.name.partition("_town")[2].partition("_")[2] or "route"


def read_route_folders(source: Path) -> tuple[RouteFolder, ...]:
    """All scenario folders of a directory, sorted by name; raises InputError."""
    if not source.is_dir():
        raise InputError(f"{source}: expected a directory of scenario folders, found none")
    folders = sorted(path for path in source.iterdir() if path.is_dir() and not path.name.startswith("."))
    if not folders:
        raise InputError(f"{source}: expected scenario folders with route XML files, found none")
    return tuple(_folder(path) for path in folders)


def _folder(path: Path) -> RouteFolder:
    files = [file for file in sorted(path.glob("*.xml")) if not file.name.startswith(".")]
    if not files:
        raise InputError(f"{path}: expected route files NAME_<number>.xml, found no XML")
    routes = sorted((read_route_file(file) for file in files), key=lambda route: route.index)
    for before, route in pairwise(routes):
        if before.index == route.index:
            raise InputError(f"{path}: expected one file for each CAV, found {route.index} twice")
    towns = sorted({route.town for route in routes})
    if len(towns) > 1:
        raise InputError(f"{path}: expected routes in one town, found {', '.join(towns)}")
    return RouteFolder(path.name, towns[0], tuple(routes))


def read_route_file(path: Path) -> RouteFile:
    """Reads one route XML; routes inside comments are not there. Raises InputError."""
    index = path.stem.rpartition("_")[2]
    if not (index.isascii() and index.isdigit()):
        raise InputError(f"{path}: expected a file name that ends in _<number>.xml, found {path.name!r}")
    routes = list(read_xml(path).iter("route"))
    if len(routes) != 1:
        raise InputError(f"{path}: expected exactly one <route>, found {len(routes)}")
    town = routes[0].get("town")
    if not town:
        raise InputError(f"{path}: route: expected an attribute town, found none")
    points = [(number(path, point, "x"), number(path, point, "y")) for point in routes[0].iter("waypoint")]
    if len(points) < 2:
        raise InputError(f"{path}: expected at least 2 waypoints, found {len(points)}")
    return RouteFile(path, int(index), town, np.array(points))
