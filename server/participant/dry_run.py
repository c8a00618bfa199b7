"""Dry run of a submission: sandboxes, limits and verdicts as on a server, as far as this machine supports them."""

from collections.abc import Generator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from mdrive_sumo.agent_process.sandbox import examine_layers
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.installation_command import format_installation
from mdrive_sumo.core.output_files import make_folder
from mdrive_sumo.core.terminal import echo
from mdrive_sumo.episode.episode_options import EpisodeOptions
from mdrive_sumo.report.result_tables import format_optional
from mdrive_sumo.runs.episode_job import EpisodeJob, run_job
from mdrive_sumo.runs.open_agents import RejectedError
from mdrive_sumo.runs.prepared_run import compute_job_limit_s
from mdrive_sumo.runs.process_pool import FailureKind, ProcessPool, WorkerFailure
from mdrive_sumo.scenario.suite import load_suite
from mdrive_sumo.scoring import Means, ScenarioResult
from mdrive_sumo.scoring.summary import compute_means
from server.enums import ChallengeTrack, ScenarioVerdict, SubmissionState
from server.environments import Environment
from server.participant.check import ask_agent, format_declaration, format_manifest
from server.participant.packaging import UnpackedAgent
from server.submitted_agent import TRACK_BY_LABEL, SubmittedAgent, find_verdict
from server.tracks import COMM_BY_TRACK

if TYPE_CHECKING:
    from server.settings import SandboxSettings


@dataclass(frozen=True, slots=True)
class DryRunOptions:
    """Scenarios of a dry run and how to run them."""

    suite: str
    scenario: str
    seed: int
    workers: int
    out: Path
    """Folder for logs and recordings."""


@dataclass(frozen=True, slots=True)
class RejectedJob:
    """A job whose agent required what is not allowed."""

    why: str


def dry_run(team: UnpackedAgent, environment: Environment, track: ChallengeTrack, course: DryRunOptions) -> bool:
    """Run the scenarios and print verdicts; return whether all have a score. Raises InputError."""
    agent = with_server_limits(team, environment)
    echo(format_manifest(team.manifest))
    told = ask_agent(agent)
    echo(f"{format_declaration(told)}\ntrack        {track}")
    if TRACK_BY_LABEL[told.label] is not track:
        echo(f"note: the label {told.label} corresponds to --track {TRACK_BY_LABEL[told.label]}", err=True)
    _print_missing_layers()
    results: list[ScenarioResult] = []
    ours = 0
    for job, outcome in run_jobs(agent, track, course):
        if isinstance(outcome, RejectedJob):
            raise InputError(f"{SubmissionState.REJECTED}: {job.scenario}: {outcome.why}")
        if isinstance(outcome, WorkerFailure):
            if outcome.kind is FailureKind.INPUT:
                raise InputError(outcome.reason)
            ours += 1
            echo(f"{ScenarioVerdict.FAILED_OURS}: {job.scenario}: {outcome.reason}")
            continue
        results.append(outcome)
        echo(format_result(outcome))
    if results:
        mean = compute_means(results)
        driven_ = f"{len(results)} scenario{'s' if len(results) > 1 else ''}"
        scores = f"DS {mean.ds:.2f}, SR {mean.sr:.2f}, {_format_times(mean)}, RC {mean.rc:.2f}"
        echo(f"{driven_}: {scores}; logs, recordings in {course.out}")
    return not ours


def _print_missing_layers() -> None:
    """Print the sandbox layers that this machine lacks: an agent may pass here and fail on a server."""
    sandbox = _default_sandbox()
    layers = examine_layers(sandbox.choose_backend())
    missing = [layer for layer in layers if layer.name in sandbox.required and not layer.active]
    if missing:
        lacks = "; ".join(f"{layer.name} ({layer.detail})" for layer in missing)
        echo(f"note: sandboxes on this machine lack layers that a server has by default: {lacks}", err=True)


def with_server_limits(team: UnpackedAgent, environment: Environment | None) -> SubmittedAgent:
    """Return the agent with the default limits of a server. Raises InputError."""
    sandbox = _default_sandbox()
    agent = SubmittedAgent(team.manifest, team.folder, environment, sandbox.box_limits(), sandbox.line_limits())
    return agent if environment is None else replace(agent, backend=sandbox.choose_backend())


def _default_sandbox() -> "SandboxSettings":
    try:
        from server.settings import SandboxSettings  # needs the packages of the server
    except ImportError as error:
        raise InputError(f"a dry run needs {error.name}: {format_installation('server')}") from None
    return SandboxSettings()


def run_jobs(
    agent: SubmittedAgent, track: ChallengeTrack, course: DryRunOptions
) -> Generator[tuple[EpisodeJob, ScenarioResult | RejectedJob | WorkerFailure]]:
    """Yield every job with its outcome as it finishes. Raises InputError."""
    suite = load_suite(course.suite)
    scenarios = suite.select(course.scenario)
    logs, recordings = course.out / "logs", course.out / "episodes"
    try:
        for folder in (logs, recordings):
            make_folder(folder)
    except OSError as error:
        raise InputError(f"{course.out}: cannot be written: {error.strerror}") from None
    jobs = [
        EpisodeJob(
            suite.folder.resolve(),
            scenario.id,
            agent.agent_spec(),
            course.seed,
            options=EpisodeOptions(comm=COMM_BY_TRACK[track]),
            recording=recordings / f"{scenario.id}.npz",
            logs=logs,
            checksum=suite.compute_file_checksum(scenario.id),
        )
        for scenario in scenarios
    ]
    most = max(len(scenario.egos) for scenario in scenarios)
    limit_s = compute_job_limit_s(most, (agent.limits,), agent.limits.pace_s)
    with ProcessPool[EpisodeJob, ScenarioResult | RejectedJob](
        run_dry_job, min(course.workers, len(jobs)), limit_s
    ) as pool:
        yield from pool.run(jobs)


def run_dry_job(job: EpisodeJob) -> ScenarioResult | RejectedJob:
    """Run a job in a worker process, whose main thread opens the sandboxes."""
    try:
        return run_job(job)
    except RejectedError as error:
        return RejectedJob(str(error))


def _format_times(scores: Means) -> str:
    return f"efficient SR {format_optional(scores.efficient_sr)}, time ratio {format_optional(scores.time_ratio)}"


def format_result(result: ScenarioResult) -> str:
    """Format a result as one line."""
    verdict, reason = find_verdict(result)
    numbers = f"DS {result.ds:6.2f}  SR {result.sr:6.2f}  RC {result.rc:6.2f}  IP {result.ip:.3f}"
    numbers += f"  {_format_times(result)}"
    why = next((f"  {ego.id}: {ego.reason}" for ego in result.egos if ego.reason), "")
    return f"{verdict}{f' ({reason})' if reason else ''}: {result.id}  {numbers}{why}"
