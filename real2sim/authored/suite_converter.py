"""Convert authored scenes to a suite: networks, scenarios and a report of all changes."""

import math
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np

from mdrive_sumo.core.atomic_folder import atomic_folder
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float, build_polyline
from mdrive_sumo.roads.network_file import read_network_file
from mdrive_sumo.scenario.scripted_actor import PathMotion, ReplayMotion
from mdrive_sumo.scenario.statistics import compute_suite_statistics
from mdrive_sumo.scenario.suite import Suite, SuiteFile, save_suite
from real2sim.authored.scenario_builder import OFF_LANE_M, AuthoredScenario, build_scenario
from real2sim.carla.conversion_report import ConversionReport, write_conversion_report
from real2sim.carla.town_network import TownNetwork, build_town_network
from real2sim.hd_map import HdMap
from real2sim.network import build_network
from real2sim.readers.interdrive import describe_omitted_routes, read_interdrive
from real2sim.source_scene import SourceScene, TownMap

DT_S = 0.1
"""[s] Interval of the motions that vote for directions and speeds: that of V2XPnP's logs."""
ASSUMED_MPS = 8.0
"""[m/s] Assumed speed on paths without times; it only determines the spacing of votes for lane directions."""
MAX_CHORD_M = 12.0
"""[m] Points further apart do not define the path between them."""
NETWORKS = "networks"
ABOUT = SuiteFile(name="interdrive-original", title="InterDrive (original routes)")


def build_scene_networks(scenes: Sequence[SourceScene], folder: Path) -> list[TownNetwork]:
    """Build the network of each scene in `folder`/NAME, once per map; raise InputError.

    An HD map is named after the first scene on it.
    """
    made: dict[str | int, TownNetwork] = {}
    for scene in scenes:
        key = _get_map_key(scene)
        if key in made:
            continue
        if isinstance(scene.map, TownMap):
            made[key] = build_town_network(scene.map.name, scene.map.map_folder, folder / scene.map.name)
        else:
            alike = [other for other in scenes if other.map is scene.map]
            made[key] = _build_from_hd_map(scene.map, alike, folder / scene.id)
    return [made[_get_map_key(scene)] for scene in scenes]


def _get_map_key(scene: SourceScene) -> str | int:
    return scene.map.name if isinstance(scene.map, TownMap) else id(scene.map)


def _build_from_hd_map(map: HdMap, scenes: Sequence[SourceScene], folder: Path) -> TownNetwork:
    motions = [motion for scene in scenes for motion in _collect_motions(scene)]
    fit = build_network(map, motions, folder, folder.name, DT_S).deviation
    about = read_network_file(folder)
    source = f"HD map of {len(map.lanes)} lanes, centre lines within {fit.mean:.2f} m (mean)"
    signs = None if about.stop_signs is None else len(about.stop_signs)
    return TownNetwork(folder.name, folder, about.offset, source, signs, (), math.nan)


def _collect_motions(scene: SourceScene) -> Iterator[Float]:
    """Yield the known motions of its vehicles: (N, 3) x, y, yaw every `DT_S`."""
    ways = [route.waypoints for route in scene.routes]
    for actor in scene.actors:
        if actor.kind != "vehicle":
            continue
        if isinstance(actor.motion, ReplayMotion):
            yield _sample_poses(np.array(actor.motion.poses))
        elif isinstance(actor.motion, PathMotion):
            ways.append(np.array(actor.motion.points))
    for path in ways:
        yield from (_sample_path(piece) for piece in _split_at_long_chords(path))


def _sample_poses(poses: Float) -> Float:
    times = np.arange(poses[0, 0], poses[-1, 0] + 1e-6, DT_S)
    x, y, yaw = (np.interp(times, poses[:, 0], column) for column in (poses[:, 1], poses[:, 2], np.unwrap(poses[:, 3])))
    return np.column_stack((x, y, yaw))


def _split_at_long_chords(path: Float) -> Iterator[Float]:
    far = np.flatnonzero(np.hypot(*np.diff(path, axis=0).T) > MAX_CHORD_M) + 1
    return (piece for piece in np.split(path, far) if len(piece) > 1)


def _sample_path(path: Float) -> Float:
    line = build_polyline(path)
    stations = np.arange(0.0, line.length, ASSUMED_MPS * DT_S)
    return np.array([(*line.at(s), line.yaw_at(s)) for s in stations])


def convert_authored(
    scenes: Sequence[SourceScene], out: Path, about: SuiteFile, notes: Sequence[str] = ()
) -> ConversionReport:
    """Write scenes as a suite with its networks and `conversion.{json,md}`; raise InputError.

    `out` must be new or empty and appears only when everything is converted. The suite's description consists of
    `notes` and the networks whose signs are unknown.
    """
    _check_unique(scenes)
    with atomic_folder(out) as draft:
        maps = build_scene_networks(scenes, draft / NETWORKS)
        converted = [build_scenario(scene, town.folder) for scene, town in zip(scenes, maps, strict=True)]
        report = _build_report(about, notes, maps, converted)
        described = about.model_copy(update={"description": " ".join(report.notes)})
        save_suite(Suite(described, draft, tuple(part.scenario for part in converted)))
        write_conversion_report(report, draft)
    return report


def _build_report(
    about: SuiteFile, notes: Sequence[str], maps: Sequence[TownNetwork], converted: Sequence[AuthoredScenario]
) -> ConversionReport:
    towns = {town.name: town for town in sorted(maps, key=lambda town: town.name)}
    unknown = [town.name for town in towns.values() if town.stop_signs is None]
    signs = [f"Stop signs: signs unknown for {', '.join(unknown)}."] if unknown else []
    return ConversionReport(
        source=about.title,
        notes=(*notes, *signs),
        statistics=compute_suite_statistics([part.scenario for part in converted]),
        waypoints=sum(part.waypoints for part in converted),
        towns=tuple(towns.values()),
        shifts=tuple(shift for part in converted for shift in part.shifts),
        left_out=tuple(out for part in converted for out in part.left_out),
        off_lane_threshold_m=OFF_LANE_M,
        off_lane=tuple(off for part in converted for off in part.off_lane),
        scenario_notes={part.scenario.id: part.scenario.notes for part in converted if part.scenario.notes},
    )


def _check_unique(scenes: Sequence[SourceScene]) -> None:
    ids = [scene.id for scene in scenes]
    twice = sorted({id_ for id_ in ids if ids.count(id_) > 1})
    if not ids or twice:
        raise InputError(
            f"expected scenarios of different names, found {', '.join(twice) + ' twice' if ids else 'none'}"
        )


def convert_interdrive(sources: Iterable[Path], maps: Path, out: Path, name: str | None = None) -> ConversionReport:
    """Write the suite of all scenario folders in `sources` with the town maps in `maps`; raise InputError."""
    scenes = [scene for source in sources for scene in read_interdrive(source, maps)]
    about = ABOUT.model_copy(update={"name": name}) if name else ABOUT
    return convert_authored(scenes, out, about, describe_omitted_routes(scenes))
