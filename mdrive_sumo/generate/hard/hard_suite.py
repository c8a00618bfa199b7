"""Write the suite of the hard tier: scenarios, recipes, reference times and certificates of need."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from mdrive_sumo.generate.generated_suite import write_generated_suite
from mdrive_sumo.generate.hard.hard_selection import ChosenElite
from mdrive_sumo.scenario.reference_times import save_reference_times
from mdrive_sumo.scenario.suite import Suite, SuiteFile
from mdrive_sumo.study.need_certificate import NeedCertificate, NeedCertificateFile, save_need


def write_hard_suite(
    about: SuiteFile, chosen: Sequence[ChosenElite], need: Mapping[str, NeedCertificate], folder: Path
) -> Suite:
    """Write a sealed suite; the folder appears when everything is written. Raises InputError.

    need: certificates by scenario id.
    """

    def add_files(sealed: Suite) -> None:
        ticks = {one.scenario.id: one.evaluation.measured.reference_ticks for one in chosen}
        save_reference_times(sealed, ticks)
        found = tuple(need[scenario.id] for scenario in sealed.scenarios)
        save_need(sealed.folder, NeedCertificateFile(suite_checksum=sealed.checksum(), certificates=found))

    made = [(one.evaluation.recipe, one.scenario) for one in chosen]
    return write_generated_suite(about, made, folder, add_files)
