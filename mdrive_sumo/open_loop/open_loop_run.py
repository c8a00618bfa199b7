"""OpenLoopRun: an open-loop evaluation that is ready to start."""

from dataclasses import dataclass, replace
from pathlib import Path

from mdrive_sumo.agents.registry import HUMAN_AGENTS
from mdrive_sumo.core.checksum import compute_file_checksum
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.private_paths import hide_locator
from mdrive_sumo.episode.episode_options import EpisodeOptions
from mdrive_sumo.open_loop.open_loop_job import OpenLoopJob
from mdrive_sumo.open_loop.reference import Reference
from mdrive_sumo.open_loop.results import OpenLoopRunInfo
from mdrive_sumo.runs.agent_boxing import box_agent, list_hidden_folders
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.episode_job import EpisodeJob
from mdrive_sumo.runs.fingerprint import compute_fingerprint, read_versions
from mdrive_sumo.runs.journal import Fingerprint
from mdrive_sumo.runs.prepared_run import check_agent_name, compute_limit_s, declare_labels
from mdrive_sumo.runs.run_config import RUNS_FOLDER, RunConfig
from mdrive_sumo.runs.run_paths import LOGS_FOLDER
from mdrive_sumo.scoring.results import EpisodeKey


@dataclass(frozen=True, slots=True)
class OpenLoopRun:
    """Recorded drives, and the agent that sees them."""

    reference: Reference
    agent: AgentSpec
    """The agent as a worker starts it."""
    options: EpisodeOptions
    folder: Path
    workers: int
    info: OpenLoopRunInfo
    fingerprint: Fingerprint

    @property
    def episodes(self) -> tuple[EpisodeKey, ...]:
        """Scenario and seed of every recording."""
        return tuple(self.reference.recordings)

    def find_logs(self, key: EpisodeKey) -> Path:
        """Return the folder for the output of third-party agents."""
        return self.folder / LOGS_FOLDER / f"seed{key[1]}"

    def make_job(self, key: EpisodeKey) -> OpenLoopJob:
        """Return the job of one recording."""
        name, seed = key
        job = EpisodeJob(
            suite_folder=self.reference.suite.folder.resolve(),
            scenario=name,
            agent=self.agent,
            seed=seed,
            options=self.options,
            logs=None if self.agent.is_builtin else self.find_logs(key),
            checksum=self.reference.suite.compute_file_checksum(name),
        )
        return OpenLoopJob(job, self.reference.recordings[key].resolve())

    def limit_s(self) -> float:
        """Return the wall clock after which a recording counts as hung [s]."""
        return compute_limit_s((self.agent,), self.reference.scenarios)


def prepare_open_loop(
    reference: Reference,
    agent: AgentSpec,
    options: EpisodeOptions,
    folder: Path | None = None,
    workers: int = 1,
    *,
    sandbox: bool = False,
) -> OpenLoopRun:
    """Return the open-loop evaluation of an agent on recorded drives, after creating the agent once.

    folder: for results and journal; None: a folder of runs/ that is named after agent and reference. sandbox: whether a
    third-party agent runs in boxes that hide suite and recordings. Raises InputError for whatever the user has to mend.
    """
    config = replace(reference.config, agent=agent, options=options, sandbox=sandbox, record=True, out=None)
    out = folder or _name_folder(config, reference)
    check_agent_name(agent)
    if agent.name in HUMAN_AGENTS:
        raise InputError(
            f"agent {agent.name!r}: expected an agent that replies plans, found controls; a take is a reference:"
            " --reference RUN"
        )
    located = agent.resolve()
    if sandbox:
        hidden = list_hidden_folders(reference.suite.folder, reference.folder, RUNS_FOLDER)
        located = box_agent(located, hidden, out)
    _, labels = declare_labels(located, is_sandboxed=located.box is not None)
    info = OpenLoopRunInfo(
        agent=hide_locator(agent.name, out),
        labels=labels,
        agent_config=agent.config_hash(),
        suite=reference.suite.name,
        suite_checksum=reference.suite.checksum(),
        seeds=tuple(sorted({seed for _, seed in reference.recordings})),
        reference=reference.name,
        versions=read_versions((agent,)),
        options=options.to_dict(),
    )
    return OpenLoopRun(
        reference, located, options, out, workers, info, _compute_fingerprint(replace(config, out=out), reference)
    )


def _compute_fingerprint(config: RunConfig, reference: Reference) -> Fingerprint:
    """Return what identifies an evaluation: that of a run, and the recordings."""
    recordings = {
        f"recording of {name}, seed {seed}": compute_file_checksum(path)
        for (name, seed), path in reference.recordings.items()
    }
    run = compute_fingerprint(config, reference.suite, reference.scenarios)
    return {**run, "reference": reference.name, **recordings}


def _name_folder(config: RunConfig, reference: Reference) -> Path:
    """Return the folder of an evaluation that names none: the same for the same one, another one for another."""
    place = reference.name if reference.folder == reference.suite.folder else reference.folder.name
    return RUNS_FOLDER / f"open-{config.default_folder(reference.suite.name).name}-on-{place}"
