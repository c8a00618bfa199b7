"""The suites of the phases: which jobs a submission has, and what evaluates it."""

from threading import Lock
from typing import Any, Protocol

from mdrive_sumo.scenario.catalog import Suite, load_suite
from mdrive_sumo.suite.fingerprint import code_checksum, versions
from server.settings import Settings
from server.store.models import Phase


class Suites(Protocol):
    """What taking in a submission has to know of a phase's suite."""

    def jobs(self, phase: Phase) -> list[tuple[str, int]]:
        """Scenario and seed of each. Raises InputError for a suite that cannot be read."""
        ...

    def evaluator(self, phase: Phase) -> dict[str, Any]:
        """What `Submission.evaluator` is: results under different ones are not compared."""
        ...


class LoadedSuites:
    """Suites of this machine, each read once: a server is restarted to take another version of one."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._lock = Lock()
        self._known: dict[str, tuple[Suite, str]] = {}
        self._code: dict[str, str] = {}

    def jobs(self, phase: Phase) -> list[tuple[str, int]]:
        """By scenario, then seed."""
        suite, _ = self._loaded(phase.suite)
        return [(scenario.id, seed) for scenario in suite.scenarios for seed in range(phase.seeds)]

    def evaluator(self, phase: Phase) -> dict[str, Any]:
        """Versions, checksums of code and suite, what the settings demand of boxes."""
        _, checksum = self._loaded(phase.suite)
        sandbox = self._settings.sandbox
        with self._lock:
            self._code = self._code or versions() | {"code": code_checksum()}
        boxes = sandbox.model_dump(mode="json", exclude={"log_bytes"})
        return {**self._code, "suite": checksum, "seeds": phase.seeds, "sandbox": boxes}

    def suite(self, phase: Phase) -> Suite:
        """The suite itself."""
        return self._loaded(phase.suite)[0]

    def _loaded(self, name: str) -> tuple[Suite, str]:
        with self._lock:
            if name not in self._known:
                suite = load_suite(name)
                self._known[name] = suite, suite.checksum()
            return self._known[name]
