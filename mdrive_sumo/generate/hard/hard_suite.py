"""Write a suite of the hard tier: scenarios, recipes, networks, reference times and certificates of need."""

from collections.abc import Sequence
from pathlib import Path

from mdrive_sumo.generate.generated_suite import write_generated_suite
from mdrive_sumo.generate.hard.hard_selection import ChosenCandidate
from mdrive_sumo.scenario.reference_times import save_reference_times
from mdrive_sumo.scenario.suite import Suite, SuiteFile
from mdrive_sumo.study.need_certificate import NeedCertificateFile


def write_hard_suite(about: SuiteFile, chosen: Sequence[ChosenCandidate], folder: Path) -> Suite:
    """Write a sealed suite; the folder appears when everything is written. Raises InputError."""
    figures = {one.scenario.id: one.evaluation.measured for one in chosen}

    def add_files(sealed: Suite) -> None:
        save_reference_times(sealed, {name: found.reference_ticks for name, found in figures.items()})
        NeedCertificateFile.write(sealed, {name: found.need for name, found in figures.items()})

    networks = {one.place.name: one.place.folder for one in chosen}
    made = [(one.recipe, one.scenario) for one in chosen]
    return write_generated_suite(about, made, folder, add_files, networks)
