"""InterDrive's route folders and CARLA's towns become a suite."""

import shutil
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mdrive_sumo.errors import InputError
from mdrive_sumo.geometry import Float
from mdrive_sumo.roads import RoadMap, load
from mdrive_sumo.scenario.catalog import Suite, SuiteFile, save_suite
from mdrive_sumo.scenario.part import Pose
from mdrive_sumo.scenario.spec import Ego, Scenario
from mdrive_sumo.scenario.statistics import statistics
from real2sim.conversion_report import ConversionReport, LeftOut, OffLane, Point, Shift, write_report
from real2sim.dense import route_of, start_pose
from real2sim.matching import REACH_M, Match, match_waypoints
from real2sim.route_file import RouteFile, RouteFolder, read_route_folders
from real2sim.separation import Legs, moved, moved_apart
from real2sim.towns import Town, build_town

BUCKET = "InterDrive"
SUITE = "interdrive-original"
OFF_LANE_M = 0.5
TWO_CAV_CATEGORIES = frozenset({"ins_c", "ins_ss", "ins_sl", "ins_sr"})
"""Categories of which the original run list has two CAVs: inferred from its 163 files (protocol 1.1)."""


@dataclass(frozen=True, slots=True)
class _Converted:
    scenario: Scenario
    shifts: tuple[Shift, ...]
    left_out: tuple[LeftOut, ...]
    off_lane: tuple[OffLane, ...]


def convert_interdrive(source: Path, maps: Path, out: Path) -> ConversionReport:
    """Writes the suite of all scenario folders in `source` with the town maps in `maps`; raises InputError.

    All or nothing: `out`, which must be new or empty, appears only when everything is converted.
    """
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise InputError(f"{out}: expected a new or empty folder to write to, found something there")
    folders = read_route_folders(source)
    out.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=out.parent) as scratch:
        draft = Path(scratch) / "suite"
        names = sorted({folder.town for folder in folders})
        towns = {name: build_town(name, maps, draft / "networks" / name) for name in names}
        converted = [_converted(folder, towns[folder.town]) for folder in folders]
        report = _report(source, folders, towns, converted)
        about = SuiteFile(name=SUITE, title="InterDrive (original routes)", description=" ".join(report.notes))
        save_suite(Suite(about, draft, tuple(part.scenario for part in converted)))
        write_report(report, draft)
        shutil.copytree(draft, out, dirs_exist_ok=True)
    return report


def _converted(folder: RouteFolder, town: Town) -> _Converted:
    roads = load(town.folder)
    matches = [_match(roads, town, route) for route in folder.routes]
    shifts = _shifts(folder, roads, matches)
    cavs = list(zip(folder.routes, matches, shifts, strict=True))
    return _Converted(
        scenario=Scenario(
            id=folder.name,
            bucket=BUCKET,
            category=folder.category,
            network=folder.town,
            description=f"InterDrive {folder.name}, converted from its {len(cavs)} route files",
            egos=tuple(_ego(route, roads, moved(roads, match.legs, shift)) for route, match, shift in cavs),
        ),
        shifts=tuple(Shift(folder.name, str(route.index), shift) for route, _, shift in cavs if shift),
        left_out=tuple(out for route, match, _ in cavs for out in _left_out(route, match, roads, town)),
        off_lane=tuple(off for route, match, _ in cavs for off in _off_lane(route, match, roads, town)),
    )


def _match(roads: RoadMap, town: Town, route: RouteFile) -> Match:
    try:
        return match_waypoints(roads, _to_network(route.xy_carla, town))
    except InputError as error:
        raise InputError(f"{route.path}: {error}") from None


def _shifts(folder: RouteFolder, roads: RoadMap, matches: Sequence[Match]) -> tuple[float, ...]:
    try:
        return moved_apart(roads, [match.legs for match in matches])
    except InputError as error:
        raise InputError(f"{folder.name}: {error}") from None


def _to_network(xy_carla: Float, town: Town) -> Float:
    """CARLA's frame has y to the right: SUMO x = x + offset x, SUMO y = -y + offset y."""
    return xy_carla * np.array((1.0, -1.0)) + np.array(town.offset)


def _ego(route: RouteFile, roads: RoadMap, legs: Legs) -> Ego:
    dense = route_of(roads, legs)
    x, y, yaw = start_pose(roads, legs)
    xy, yaws = dense.xy.round(3), dense.yaw.round(4)  # as the file is written: the report counts what is in it
    points = zip(xy[:, 0].tolist(), xy[:, 1].tolist(), yaws.tolist(), strict=True)
    return Ego(id=str(route.index), start=Pose(x=x, y=y, yaw=yaw), lanes=dense.lanes, route=tuple(points))


def _off_lane(route: RouteFile, match: Match, roads: RoadMap, town: Town) -> Iterator[OffLane]:
    for foot in match.feet:
        if abs(foot.d) > OFF_LANE_M:
            nearest, distance = _nearest(route, foot.waypoint, roads, town)
            yield OffLane(_point(route, foot.waypoint), foot.lane, round(abs(foot.d), 3), nearest, round(distance, 3))


def _left_out(route: RouteFile, match: Match, roads: RoadMap, town: Town) -> Iterator[LeftOut]:
    for i in match.left_out:
        nearest, distance = _nearest(route, i, roads, town)
        reason = f"no lane within {REACH_M:g} m" if distance > REACH_M else "no way to it and on from it (behind?)"
        yield LeftOut(_point(route, i), nearest, round(distance, 3), reason)


def _nearest(route: RouteFile, waypoint: int, roads: RoadMap, town: Town) -> tuple[str, float]:
    found = roads.nearest(_to_network(route.xy_carla[waypoint : waypoint + 1], town))
    return roads.driving[found.lane[0]].id, float(found.distance[0])


def _point(route: RouteFile, waypoint: int) -> Point:
    x, y = route.xy_carla[waypoint].tolist()
    return Point(route.path.parent.name, str(route.index), waypoint, x, y)


def _report(
    source: Path, folders: Sequence[RouteFolder], towns: Mapping[str, Town], converted: Sequence[_Converted]
) -> ConversionReport:
    return ConversionReport(
        source=source.name,
        notes=_notes(folders, towns),
        statistics=statistics([part.scenario for part in converted]),
        waypoints=sum(len(route.xy_carla) for folder in folders for route in folder.routes),
        towns=tuple(towns.values()),
        shifts=tuple(shift for part in converted for shift in part.shifts),
        left_out=tuple(out for part in converted for out in part.left_out),
        off_lane_threshold_m=OFF_LANE_M,
        off_lane=tuple(off for part in converted for off in part.off_lane),
    )


def _notes(folders: Sequence[RouteFolder], towns: Mapping[str, Town]) -> tuple[str, ...]:
    files = sum(len(folder.routes) for folder in folders)
    third = [f for f in folders if f.category in TWO_CAV_CATEGORIES and len(f.routes) > 2]
    left = sum(len(folder.routes) - 2 for folder in third)
    unknown = [town.name for town in towns.values() if town.stop_signs is None]
    notes: list[str] = []
    if third:
        notes.append(
            f"The original code drives {files - left} of the {files} files: its run list has two CAVs for"
            f" {len(third)} folders that hold a third file ({', '.join(folder.name for folder in third)})."
            f" This suite follows the files and drives all {files}."
        )
    if unknown:
        notes.append(f"Stop signs: signs unknown for {', '.join(unknown)}.")
    return tuple(notes)
