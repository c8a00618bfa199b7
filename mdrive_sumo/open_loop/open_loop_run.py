"""OpenLoopRun: an open-loop evaluation that is ready to start."""

from dataclasses import dataclass, replace
from pathlib import Path

from mdrive_sumo.core.checksum import compute_file_checksum
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.loop import EpisodeOptions
from mdrive_sumo.open_loop.open_loop_job import OpenLoopJob
from mdrive_sumo.open_loop.results import OpenLoopRunInfo
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.fingerprint import compute_fingerprint, read_versions
from mdrive_sumo.runs.journal import Fingerprint
from mdrive_sumo.runs.prepared_run import EPISODES_FOLDER, LOGS_FOLDER, PreparedRun
from mdrive_sumo.runs.run_config import RUNS_FOLDER
from mdrive_sumo.runs.stored_run import StoredRun
from mdrive_sumo.scoring.results import EpisodeKey


@dataclass(frozen=True, slots=True)
class OpenLoopRun:
    """The recordings of a finished run, and the agent that sees them."""

    reference: PreparedRun
    """The run that made the recordings."""
    episodes: tuple[EpisodeKey, ...]
    """Those of its episodes that have a recording."""
    agent: AgentSpec
    options: EpisodeOptions
    folder: Path
    workers: int
    info: OpenLoopRunInfo
    fingerprint: Fingerprint

    def find_logs(self, key: EpisodeKey) -> Path:
        """Return the folder for the output of third-party agents."""
        return self.folder / LOGS_FOLDER / f"seed{key[1]}"

    def make_job(self, key: EpisodeKey) -> OpenLoopJob:
        """Return the job of one recording."""
        logs = None if self.agent.is_builtin else self.find_logs(key)
        driven = self.reference.make_job(self.reference.episodes[key], key[1])
        job = replace(
            driven, agent=self.agent.resolve(), options=self.options, recording=None, transcripts=None, logs=logs
        )
        return OpenLoopJob(job, self.reference.find_recording(key).resolve())


def prepare_open_loop(
    stored: StoredRun, agent: AgentSpec, options: EpisodeOptions, folder: Path | None, workers: int
) -> OpenLoopRun:
    """Return the open-loop evaluation of an agent on the recordings of a finished run.

    folder: for results and journal; None: a folder of runs/ that is named after agent and reference. Raises InputError
    if the run has no recordings.
    """
    run = stored.run
    episodes = tuple(run.find_key(result) for result in stored.results.scenarios if result.status == "ok")
    missing = [key for key in episodes if not run.find_recording(key).is_file()]
    if missing or not episodes:
        raise InputError(
            f"{run.folder / EPISODES_FOLDER}: expected the recordings of the run, found none of "
            f"{run.name_episode(missing[0]) if missing else 'any scenario'}; eval without --no-record makes them"
        )
    recordings = {
        f"recording of {key[0]}, seed {key[1]}": compute_file_checksum(run.find_recording(key)) for key in episodes
    }
    fingerprint = {
        **compute_fingerprint(replace(run.config, agent=agent, options=options), run.suite, run.scenarios),
        "reference": run.config.agent.name,
        **recordings,
    }
    info = OpenLoopRunInfo(
        agent=agent.name,
        agent_config=agent.config_hash(),
        suite=run.suite.name,
        suite_checksum=run.suite.checksum(),
        seeds=run.config.seeds,
        reference=run.config.agent.name,
        versions=read_versions(),
        options=options.to_dict(),
    )
    out = folder or RUNS_FOLDER / f"open-{agent.name.replace('/', '_')}-on-{run.folder.name}"
    return OpenLoopRun(run, episodes, agent, options, out, workers, info, fingerprint)
