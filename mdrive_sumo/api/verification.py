"""Verify a run folder: drive it again, and compare recordings, results, journal and report with what comes out."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from mdrive_sumo.agent_process.agent_connection import AgentLimits
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.input_files import read_text
from mdrive_sumo.report.run_report import REPORT_FILE, find_report_differences, has_captured_cooperation
from mdrive_sumo.runs.episode_job import replay_language_model
from mdrive_sumo.runs.evaluate import RESULTS_FILE
from mdrive_sumo.runs.foreign_agent import permit_agent
from mdrive_sumo.runs.journal import JOURNAL_FILE
from mdrive_sumo.runs.prepared_run import PreparedRun, declare_all_labels
from mdrive_sumo.runs.rescore import rescored_path
from mdrive_sumo.runs.stored_run import StoredRun
from mdrive_sumo.runs.verify import (
    VerificationResult,
    build_expected_results,
    find_fingerprint_differences,
    find_journal_differences,
    find_results_differences,
    sample_results,
    verify,
)
from mdrive_sumo.scoring import EpisodeKey, Results, ScenarioResult, ScoreMode, load_unchecked_results


@dataclass(frozen=True, slots=True)
class FileVerification:
    """The comparison of one file of a run folder with what the run gives."""

    file: str
    differences: tuple[str, ...]
    """Sentences: place, expected, found."""
    left_out: str = ""
    """What was not compared."""


@dataclass(frozen=True, slots=True)
class Permission:
    """How far the user trusts the agent of a stored run; see `permit_agent`."""

    trusted: bool = False
    sandbox: bool = False
    place: str | None = None
    ask: Callable[[str], bool] | None = None
    limits: AgentLimits | None = None
    """Limits of the agents, for a slower machine; None: those of the run."""

    def apply(self, run: PreparedRun) -> PreparedRun:
        """Return the stored run as it may be executed again. Raises InputError if its agent may not or cannot run."""
        permitted = permit_agent(run, trusted=self.trusted, sandbox=self.sandbox, place=self.place, ask=self.ask)
        if self.limits is None:
            return permitted
        return replace(permitted, config=permitted.config.with_agent_limits(self.limits))


class RunVerification:
    """The verification of a stored run: first `verify_episodes`, then `verify_files`."""

    def __init__(self, stored: StoredRun, permission: Permission, sample: int | None = None) -> None:
        """Prepare it. Raises InputError if the run's agent may not or cannot run."""
        self._stored = stored
        self.run = permission.apply(stored.run)
        self.chosen: Sequence[ScenarioResult] = sample_results(stored.results, sample)
        self._modes = _list_modes(stored.run)
        self._scores: dict[EpisodeKey, Mapping[ScoreMode, ScenarioResult]] = {}

    def verify_episodes(self, workers: int) -> Iterator[VerificationResult]:
        """Drive the chosen scenarios again and yield the comparison of each as it finishes. Raises InputError."""
        for verification in verify(self.run, self.chosen, workers, tuple(self._modes)):
            self._scores[verification.key] = verification.scores
            yield verification

    def verify_files(self) -> Iterator[FileVerification]:
        """Yield the comparison of every file with figures. Raises InputError for one that cannot be read."""
        own = self._stored.run.config.score_mode
        facts = _declare(self.run, self._stored.run)
        for mode, path in self._modes.items():
            results = (
                self._stored.results if mode == own and path.name == RESULTS_FILE else load_unchecked_results(path)
            )
            yield self._verify_results(path.name, results, mode, facts)
        if (again := rescored_path(self._stored.run.folder, own)).is_file():
            yield self._verify_results(again.name, load_unchecked_results(again), own, facts)
        expected = build_expected_results(self._stored.run, self._stored.results, self._scores, own, facts).results
        differences = (
            *find_fingerprint_differences(self._stored.run),
            *find_journal_differences(self._stored.journal, expected),
        )
        yield FileVerification(JOURNAL_FILE, differences)
        yield from self._verify_report(expected)

    def _verify_results(self, name: str, found: Results, mode: ScoreMode, facts: Mapping[str, Any]) -> FileVerification:
        expected = build_expected_results(self._stored.run, found, self._scores, mode, facts)
        return FileVerification(name, tuple(find_results_differences(expected, found)))

    def _verify_report(self, expected: Results) -> Iterator[FileVerification]:
        path = self._stored.run.folder / REPORT_FILE
        if not path.is_file():
            return
        try:
            text = read_text(path)
        except (OSError, ValueError) as error:
            raise InputError(f"{path}: expected a text file, found none ({error})") from None
        left_out = "captured cooperation, which depends on other runs" if has_captured_cooperation(text) else ""
        yield FileVerification(REPORT_FILE, tuple(find_report_differences(expected, text)), left_out)


def _list_modes(run: PreparedRun) -> dict[ScoreMode, Path]:
    """Return the results file of every score mode that a run folder has, the run's own first."""
    own = run.config.score_mode
    others = {mode: rescored_path(run.folder, mode) for mode in ScoreMode if mode != own}
    return {own: run.folder / RESULTS_FILE} | {mode: path for mode, path in others.items() if path.is_file()}


def _declare(run: PreparedRun, stored: PreparedRun) -> dict[str, Any]:
    """Return the labels that follow from the agent, and the one that it declares. Raises InputError.

    run: as it may be executed; stored: as it was, without a box unless it had one.
    """
    agents = [replay_language_model(run.agent, None), *((run.others.agent,) if run.others else ())]
    declared, labels = declare_all_labels(agents, is_sandboxed=stored.config.sandbox)
    return {"labels": labels, "declared_label": declared}
