"""Convert InterDrive's route folders and CARLA's towns to a suite."""

from collections.abc import Iterable
from pathlib import Path

from mdrive_sumo.scenario.suite import SuiteFile
from real2sim.authored.suite_converter import convert_authored
from real2sim.carla.conversion_report import ConversionReport
from real2sim.readers.interdrive import describe_omitted_routes, read_interdrive

ABOUT = SuiteFile(name="interdrive-original", title="InterDrive (original routes)")


def convert_interdrive(sources: Iterable[Path], maps: Path, out: Path, name: str | None = None) -> ConversionReport:
    """Write the suite of all scenario folders in `sources` with the town maps in `maps`; raise InputError."""
    scenes = [scene for source in sources for scene in read_interdrive(source, maps)]
    about = ABOUT.model_copy(update={"name": name}) if name else ABOUT
    return convert_authored(scenes, out, about, describe_omitted_routes(scenes))
