"""StoredRun: a finished run, loaded again for `verify`, `rescore`, `show` and `view`."""

from dataclasses import dataclass, replace
from pathlib import Path

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.runs.evaluate import RESULTS_FILE
from mdrive_sumo.runs.fingerprint import compute_code_checksum, read_versions
from mdrive_sumo.runs.journal import JOURNAL_FILE, read_fingerprint
from mdrive_sumo.runs.prepared_run import PreparedRun
from mdrive_sumo.runs.run_config import RunConfig
from mdrive_sumo.scenario.suite import load_suite
from mdrive_sumo.scoring import Results, load_results


@dataclass(frozen=True, slots=True)
class StoredRun:
    """A finished run with its results."""

    run: PreparedRun
    results: Results

    def describe_version_changes(self) -> str:
        """Return what differs between the run and this installation, as far as results depend on it; "" if nothing."""
        now = read_versions() | {"code": compute_code_checksum()}
        then = self.run.fingerprint
        changes = [
            name if name == "code" else f"{name} {then.get(name)}" for name in now if now[name] != then.get(name)
        ]
        return ", ".join(changes)


def load_stored_run(folder: Path, suite: str | None = None) -> StoredRun:
    """Load a run's configuration and results. suite: the suite's place now if it has moved. Raises InputError."""
    results = load_results(folder / RESULTS_FILE)
    fingerprint = read_fingerprint(folder)
    try:
        config = replace(RunConfig.from_dict(fingerprint), out=folder)
    except (KeyError, ValueError, TypeError) as error:
        raise InputError(
            f"{folder / JOURNAL_FILE}: expected the fingerprint of a run, found a corrupt one ({error})"
        ) from None
    loaded = load_suite(suite or config.suite)
    if loaded.checksum() != results.run.suite_checksum:
        raise InputError(
            f"suite {loaded.name}: expected the checksum of {folder}, {results.run.suite_checksum},"
            f" found {loaded.checksum()}"
        )
    ids = {result.id for result in results.scenarios}
    scenarios = tuple(scenario for scenario in loaded.scenarios if scenario.id in ids)
    return StoredRun(PreparedRun(config, loaded, scenarios, folder, results.run, fingerprint), results)
