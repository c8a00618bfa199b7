"""InterDrive: read folders of scenarios with one route XML per CAV and no other road users."""

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

from mdrive_sumo.core.errors import InputError
from real2sim.readers.carla_frame import CarlaFrame
from real2sim.readers.carla_route import RouteFile, parse_ego_index, read_route_file
from real2sim.source_scene import CavRoute, SourceScene, TownMap

BUCKET = "InterDrive"
TWO_CAV_CATEGORIES = frozenset({"ins_c", "ins_ss", "ins_sl", "ins_sr"})
"""Categories with two CAVs in the original run list, inferred from its 163 files (protocol 1.1)."""


def read_interdrive(source: Path, towns: Path) -> tuple[SourceScene, ...]:
    """Read all scenario folders of a directory, sorted by name; `towns` contains the maps. Raises InputError."""
    if not source.is_dir():
        raise InputError(f"{source}: expected a directory of scenario folders, found none")
    folders = sorted(path for path in source.iterdir() if path.is_dir() and not path.name.startswith("."))
    if not folders:
        raise InputError(f"{source}: expected scenario folders with route XML files, found none")
    return tuple(_read_scene(path, towns) for path in folders)


def describe_omitted_routes(scenes: Sequence[SourceScene]) -> tuple[str, ...]:
    """Describe which routes of these scenarios the original code does not drive."""
    files = sum(len(scene.routes) for scene in scenes)
    third = [scene for scene in scenes if scene.category in TWO_CAV_CATEGORIES and len(scene.routes) > 2]
    left = sum(len(scene.routes) - 2 for scene in third)
    if not third:
        return ()
    return (
        f"The original code drives {files - left} of the {files} files: its run list has two CAVs for"
        f" {len(third)} folders that hold a third file ({', '.join(scene.id for scene in third)})."
        f" This suite follows the files and drives all {files}.",
    )


def _read_scene(folder: Path, towns: Path) -> SourceScene:
    files = [file for file in sorted(folder.glob("*.xml")) if not file.name.startswith(".")]
    if not files:
        raise InputError(f"{folder}: expected route files NAME_<number>.xml, found no XML")
    routes = sorted((_read_numbered_route(file) for file in files), key=lambda numbered: numbered[0])
    for (before, _), (index, _) in pairwise(routes):
        if before == index:
            raise InputError(f"{folder}: expected one file for each CAV, found {index} twice")
    names = sorted({route.town for _, route in routes})
    if len(names) > 1:
        raise InputError(f"{folder}: expected routes in one town, found {', '.join(names)}")
    return SourceScene(
        id=folder.name,
        source="interdrive",
        bucket=BUCKET,
        category=folder.name.partition("_town")[2].partition("_")[2] or "route",
        map=TownMap(names[0], towns),
        routes=tuple(CavRoute(str(index), CarlaFrame().to_map_xy(route.xy_carla)) for index, route in routes),
        description=f"InterDrive {folder.name}, converted from its {len(routes)} route files",
    )


def _read_numbered_route(path: Path) -> tuple[int, RouteFile]:
    index = parse_ego_index(path)
    if index is None:
        raise InputError(f"{path}: expected a file name that ends in _<number>.xml, found {path.name!r}")
    return index, read_route_file(path, at_least=2)
