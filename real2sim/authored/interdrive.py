"""InterDrive's route folders and CARLA's towns become a suite."""

from pathlib import Path

from mdrive_sumo.scenario.catalog import SuiteFile
from real2sim.authored.suite import convert_authored
from real2sim.carla.report import ConversionReport
from real2sim.readers.interdrive import interdrive_notes, read_interdrive

ABOUT = SuiteFile(name="interdrive-original", title="InterDrive (original routes)")


def convert_interdrive(source: Path, maps: Path, out: Path) -> ConversionReport:
    """Writes the suite of all scenario folders in `source` with the town maps in `maps`; raises InputError."""
    scenes = read_interdrive(source, maps)
    return convert_authored(scenes, out, ABOUT, interdrive_notes(scenes))
