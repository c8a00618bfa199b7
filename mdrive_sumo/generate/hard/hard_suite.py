"""Write a suite of the hard tier: scenarios, recipes, networks, reference times and certificates of need.

Certificates are computed for the chosen scenarios alone: with many hidden road users one takes 15 s of processor time.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.generate.generated_suite import write_generated_suite
from mdrive_sumo.generate.hard.hard_selection import ChosenCandidate
from mdrive_sumo.generate.hard.reference_drive import drive_with
from mdrive_sumo.runs.process_pool import ProcessPool, WorkerFailure
from mdrive_sumo.scenario.reference_times import REFERENCE_AGENT, save_reference_times
from mdrive_sumo.scenario.suite import Suite, SuiteFile
from mdrive_sumo.study.need_certificate import NeedCertificate, NeedCertificateFile, certify_need

CERTIFICATE_LIMIT_S = 600.0
"""Wall clock for one certificate: it ends what hangs."""


def certify_chosen(chosen: Sequence[ChosenCandidate], workers: int) -> Mapping[str, NeedCertificate]:
    """Return the certificates of need by id of the scenario. Raises InputError if one cannot be computed."""
    found: dict[str, NeedCertificate] = {}
    with ProcessPool(certify_candidate, min(workers, len(chosen)), CERTIFICATE_LIMIT_S) as pool:
        for one, outcome in pool.run(chosen):
            if isinstance(outcome, WorkerFailure):
                raise InputError(f"scenario {one.scenario.id}: expected a certificate, found none: {outcome.reason}")
            found[one.scenario.id] = outcome
    return found


def certify_candidate(one: ChosenCandidate) -> NeedCertificate:
    """Return the certificate of a scenario, from the drive of `omniscient` with seed 0. Raises WorldError."""
    roads = one.place.load_roads()
    return certify_need(one.scenario, roads, drive_with(REFERENCE_AGENT, one.scenario, roads))


def write_hard_suite(
    about: SuiteFile, chosen: Sequence[ChosenCandidate], need: Mapping[str, NeedCertificate], folder: Path
) -> Suite:
    """Write a sealed suite; the folder appears when everything is written. Raises InputError.

    need: certificates by id of the scenario.
    """
    ticks = {one.scenario.id: one.evaluation.measured.reference_ticks for one in chosen}

    def add_files(sealed: Suite) -> None:
        save_reference_times(sealed, ticks)
        NeedCertificateFile.write(sealed, need)

    networks = {one.place.name: one.place.folder for one in chosen}
    made = [(one.recipe, one.scenario) for one in chosen]
    return write_generated_suite(about, made, folder, add_files, networks)
