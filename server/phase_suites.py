"""The suites of the phases: which jobs a submission has, and what evaluates it."""

from threading import Lock
from typing import Any, Protocol

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.runs.fingerprint import compute_code_checksum, read_versions
from mdrive_sumo.scenario.suite import Suite, load_suite
from server import environments
from server.enums import MIN_HIDDEN_SCENARIOS
from server.settings import ServerSettings
from server.store.standings import ENVIRONMENT
from server.store.tables import PhaseRow


class PhaseSuites(Protocol):
    """What taking in a submission has to know of a phase's suite."""

    def jobs(self, phase: PhaseRow) -> list[tuple[str, int]]:
        """Scenario and seed of each. Raises InputError for a suite that cannot be read or is too small to be hidden."""
        ...

    def evaluator(self, phase: PhaseRow, environment: str) -> dict[str, Any]:
        """What `Submission.evaluator` is for an agent of this environment."""
        ...


class LoadedPhaseSuites:
    """Suites of this machine, each read once: a server is restarted to take another version of one."""

    def __init__(self, settings: ServerSettings) -> None:
        self._settings = settings
        self._lock = Lock()
        self._known: dict[str, tuple[Suite, str]] = {}
        self._code = read_versions() | {"code": compute_code_checksum()}

    def jobs(self, phase: PhaseRow) -> list[tuple[str, int]]:
        """By scenario, then seed. Raises InputError, see `Suites`."""
        suite, _ = self._loaded(phase.suite)
        if not phase.public and (found := len(suite.scenarios)) < MIN_HIDDEN_SCENARIOS:
            why = "so that their mean says nothing about single ones"
            raise InputError(
                f"phase {phase.id}: expected at least {MIN_HIDDEN_SCENARIOS} hidden scenarios, {why}; found {found}"
            )
        return [(scenario.id, seed) for scenario in suite.scenarios for seed in range(phase.seeds)]

    def evaluator(self, phase: PhaseRow, environment: str) -> dict[str, Any]:
        """Versions, checksums of code and suite, what the settings demand of boxes, and what the environment holds.

        That one is looked at every time: it may be imported anew while a server runs.
        """
        _, checksum = self._loaded(phase.suite)
        boxes = self._settings.sandbox.model_dump(mode="json", exclude={"log_bytes"})
        holds = environments.compute_digest(environment, self._settings.environments)
        return {**self._code, "suite": checksum, "seeds": phase.seeds, "sandbox": boxes, ENVIRONMENT: holds}

    def suite(self, phase: PhaseRow) -> Suite:
        """The suite itself."""
        return self._loaded(phase.suite)[0]

    def _loaded(self, name: str) -> tuple[Suite, str]:
        with self._lock:
            if name not in self._known:
                suite = load_suite(name)
                self._known[name] = suite, suite.checksum()
            return self._known[name]
