"""Suites of the phases: the jobs of a submission and the description of its evaluator."""

from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from threading import Lock
from typing import Any, Protocol

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.runs.fingerprint import compute_code_checksum, read_versions
from mdrive_sumo.scenario.season import read_stored_name
from mdrive_sumo.scenario.suite import Suite, load_suite
from server import environments
from server.enums import MIN_HIDDEN_SCENARIOS
from server.settings import ServerSettings
from server.store.standings import ENVIRONMENT
from server.store.tables import PhaseRow


class PhaseSuites(Protocol):
    """What accepting a submission needs of a phase's suite."""

    def jobs(self, phase: PhaseRow) -> list[tuple[str, int]]:
        """Return (scenario, seed) of each job.

        Raises InputError for an unreadable suite, and for one that a hidden phase must not have: too small or packaged.
        """
        ...

    def evaluator(self, phase: PhaseRow, environment: str) -> dict[str, Any]:
        """Return `SubmissionRow.evaluator` for an agent of this environment."""
        ...

    def find_checksum(self, phase: PhaseRow, scenario: str) -> str:
        """Return the checksum that the file of a scenario had when the suite was read; "": not known."""
        ...


@dataclass(frozen=True, slots=True)
class _LoadedSuite:
    suite: Suite
    checksum: str
    scenario_checksums: Mapping[str, str]
    """Checksum of the file of each scenario, by the scenario's id."""


class LoadedPhaseSuites:
    """Suites on this machine, each read once: a changed suite needs a restart."""

    def __init__(self, settings: ServerSettings) -> None:
        self._settings = settings
        self._lock = Lock()
        self._suites: dict[str, _LoadedSuite] = {}
        self._code = read_versions() | {"code": compute_code_checksum()}

    def jobs(self, phase: PhaseRow) -> list[tuple[str, int]]:
        """See `PhaseSuites`; by scenario, then seed."""
        suite = self._load(phase.suite).suite
        if not phase.public:
            self._check_hidden(phase, suite)
        return [(scenario.id, seed) for scenario in suite.scenarios for seed in range(phase.seeds)]

    def evaluator(self, phase: PhaseRow, environment: str) -> dict[str, Any]:
        """Return versions, checksums of code and suite, sandbox settings, and a digest of the environment.

        The digest is read every time: an environment can be imported again while the server runs.
        """
        checksum = self._load(phase.suite).checksum
        unjudged = {"log_bytes", "pace_s", "hidden_on_shared_kernel"}  # change no result
        sandbox = self._settings.sandbox.model_dump(mode="json", exclude=unjudged)
        digest = environments.compute_digest(environment, self._settings.environments)
        return {**self._code, "suite": checksum, "seeds": phase.seeds, "sandbox": sandbox, ENVIRONMENT: digest}

    def suite(self, phase: PhaseRow) -> Suite:
        """Return the suite of a phase."""
        return self._load(phase.suite).suite

    def find_checksum(self, phase: PhaseRow, scenario: str) -> str:
        """See `PhaseSuites`."""
        return self._load(phase.suite).scenario_checksums.get(scenario, "")

    def _check_hidden(self, phase: PhaseRow, suite: Suite) -> None:
        if (count := len(suite.scenarios)) < MIN_HIDDEN_SCENARIOS:
            why = "so that their mean does not disclose single ones"
            raise InputError(
                f"phase {phase.id}: expected at least {MIN_HIDDEN_SCENARIOS} hidden scenarios, {why}; found {count}"
            )
        if any(each.id == phase.id and each.packaged_suite for each in self._settings.phases):
            return
        packaged = Path(str(files("mdrive_sumo"))).resolve()
        for scenario in suite.scenarios:
            if (folder := suite.find_folder(scenario.id).resolve()).is_relative_to(packaged):
                raise InputError(
                    f"phase {phase.id}: expected hidden scenarios that only the organisers have, found"
                    f" {scenario.id} of the packaged suite {folder.name}, which everyone can read; name a"
                    " folder of your own as its suite, or set packaged_suite = true in its section for a trial"
                )

    def _load(self, name: str) -> _LoadedSuite:
        with self._lock:
            if name not in self._suites:
                suite = load_suite(read_stored_name(name))
                checksums = {scenario.id: suite.compute_file_checksum(scenario.id) for scenario in suite.scenarios}
                self._suites[name] = _LoadedSuite(suite, suite.checksum(), checksums)
            return self._suites[name]
