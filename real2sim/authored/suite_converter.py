"""Convert authored scenes to a suite: networks, scenarios and a report of all changes."""

from collections.abc import Iterable, Sequence
from pathlib import Path

from mdrive_sumo.core.atomic_folder import atomic_folder
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.scenario.statistics import compute_suite_statistics
from mdrive_sumo.scenario.suite import Suite, SuiteFile, save_suite
from real2sim.authored.scenario_builder import OFF_LANE_M, AuthoredScenario, build_scenario
from real2sim.authored.scene_networks import build_scene_networks
from real2sim.carla.conversion_report import ConversionReport, write_conversion_report
from real2sim.carla.town_network import TownNetwork
from real2sim.readers.interdrive import describe_omitted_routes, read_interdrive
from real2sim.source_scene import SourceScene

NETWORKS = "networks"
ABOUT = SuiteFile(name="interdrive-original", title="InterDrive (original routes)")


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
