"""Reference: the recorded drives that agents see in open loop, and with which their plans are compared."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.private_paths import hide_locator
from mdrive_sumo.core.suggestion import describe_unknown
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.recording_check import check_recordings
from mdrive_sumo.runs.run_config import RunConfig
from mdrive_sumo.runs.run_paths import EPISODES_FOLDER
from mdrive_sumo.runs.stored_run import StoredRun, load_stored_run
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.suite import LOG_FILE, Suite, load_suite
from mdrive_sumo.scoring import EpisodeKey

REFERENCE_AGENT = "omniscient"
DEFAULT_SUITE = "interdrive"
LOG = "log"
"""The name of logs as a reference, and what drove their CAVs in place of an agent."""


@dataclass(frozen=True, slots=True)
class Reference:
    """Recordings of a run or of logs, whatever drove them."""

    config: RunConfig
    """Suite, scenarios and seeds of the recordings, and what drove."""
    suite: Suite
    recordings: Mapping[EpisodeKey, Path]
    folder: Path
    """The run or the suite that holds them."""

    @property
    def name(self) -> str:
        """What drove: an agent, of a file without its folder, or "log"."""
        return hide_locator(self.config.agent.name)

    @property
    def scenarios(self) -> tuple[Scenario, ...]:
        """The scenarios with a recording."""
        recorded = {name for name, _ in self.recordings}
        return tuple(scenario for scenario in self.suite.scenarios if scenario.id in recorded)


def find_reference(
    name: str,
    drive: Callable[[RunConfig], Path],
    *,
    suite: str | None = None,
    pattern: str = "*",
    seed: int | None = None,
) -> Reference:
    """Return the reference of a name: "omniscient", "log", or the folder of a finished run.

    drive: drives a run unless it is finished, and returns its folder. suite: None: InterDrive, or that of the run.
    pattern: globs of the scenarios. seed: None: 0, or all of the run. Raises InputError.
    """
    if name == LOG:
        if seed:
            raise InputError(f"--seed: expected 0 with --reference {LOG}, found {seed}: what happened has no seed")
        return open_log_reference(suite or DEFAULT_SUITE, pattern)
    if name == REFERENCE_AGENT:
        config = RunConfig(suite=suite or DEFAULT_SUITE, scenario=pattern, agent=AgentSpec(name), seeds=(seed or 0,))
        return open_run_reference(load_stored_run(drive(config)))
    folder = Path(name)
    if not folder.exists():
        also = "or the folder of a finished run"
        raise InputError(f"--reference: {describe_unknown(name, (REFERENCE_AGENT, LOG), also)}")
    stored = load_stored_run(folder)
    if suite is not None and load_suite(suite).checksum() != stored.results.run.suite_checksum:
        raise InputError(
            f"--reference {name}: expected a run of the suite {suite}, found one of {stored.run.suite.name}"
        )
    return open_run_reference(stored, pattern, seed)


def open_run_reference(stored: StoredRun, pattern: str = "*", seed: int | None = None) -> Reference:
    """Return the recordings of a finished run: of any agent, or of a human.

    pattern: globs of the scenarios to take, as `Suite.select` reads them. seed: the only one to take; None: all.
    Raises InputError if recordings are missing or changed, or if nothing is left to show.
    """
    run = stored.run
    chosen = {scenario.id for scenario in run.suite.select(pattern)}
    keys = [run.find_key(result) for result in stored.results.scenarios if result.status == "ok"]
    keys = [key for key in keys if key[0] in chosen and seed in (None, key[1])]
    if not keys:
        seeds = ", ".join(map(str, run.config.seeds))
        raise InputError(
            f"{run.folder}: expected scored episodes of {pattern!r}{'' if seed is None else f', seed {seed}'}, found"
            f" none; it has {run.config.scenario!r} with seed {seeds}"
        )
    recordings = {key: run.find_recording(key) for key in keys}
    if missing := [key for key, path in recordings.items() if not path.is_file()]:
        raise InputError(
            f"{run.folder / EPISODES_FOLDER}: expected the recordings of the run, found none of"
            f" {run.name_episode(missing[0])}; eval without --no-record makes them"
        )
    check_recordings(run, keys, stored.journal.recordings)
    return Reference(replace(run.config, scenario=pattern), run.suite, recordings, run.folder)


def open_log_reference(suite: str, pattern: str = "*") -> Reference:
    """Return the logs that scenarios were converted from. Raises InputError if one of them has none."""
    loaded = load_suite(suite)
    scenarios = loaded.select(pattern)
    recordings = {(one.id, 0): loaded.find_folder(one.id) / one.id / LOG_FILE for one in scenarios}
    missing = [(key, path) for key, path in recordings.items() if not path.is_file()]
    if missing:
        (name, _), path = missing[0]
        raise InputError(
            f"--reference {LOG}: expected {path}, the log of {name}, found no file"
            f" ({len(missing)} of {len(scenarios)} scenarios have none); `mdrive-sumo convert` writes it for scenarios"
            " of real logs"
        )
    config = RunConfig(suite=suite, scenario=pattern, agent=AgentSpec(LOG))
    return Reference(config, loaded, recordings, loaded.folder)
