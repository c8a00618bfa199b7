"""A submission driven here: boxes, limits and verdicts as on a server, as far as this machine has the layers for it."""

from collections.abc import Generator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mdrive_sumo.agent_process.sandbox import examine_layers
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.runs.agent_spec import RejectedError
from mdrive_sumo.runs.job import EpisodeJob, run_job
from mdrive_sumo.runs.process_pool import FailureKind, ProcessPool, WorkerFailure
from mdrive_sumo.scenario.catalog import load_suite
from mdrive_sumo.scoring import ScenarioResult
from mdrive_sumo.scoring.summary import means
from mdrive_sumo.v2x.comm import format_comm_json
from server.enums import State, Track, Verdict
from server.environments import Environment
from server.participant.check import ask, declared, described
from server.participant.packaging import Team
from server.submitted_agent import TRACKS, Entrant, verdict_of
from server.tracks import COMM

if TYPE_CHECKING:
    from server.settings import Sandbox

SIMULATION_S = 600.0
"""Wall clock for all but the agents of a scenario."""


@dataclass(frozen=True, slots=True)
class Course:
    """What is to be driven, and how."""

    suite: str
    scenario: str
    seed: int
    workers: int
    out: Path
    """For logs and recordings."""


@dataclass(frozen=True, slots=True)
class Rejected:
    """What the agent asked for while it was driven."""

    why: str


def dry_run(team: Team, environment: Environment, track: Track, course: Course) -> bool:
    """Drives and tells verdicts; True if all scenarios have a score. Raises InputError."""
    entrant = as_on_the_server(team, environment)
    click.echo(described(team.manifest))
    found = ask(entrant)
    click.echo(f"{declared(found)}\ntrack        {track}")
    if TRACKS[found.label] is not track:
        click.echo(f"note: an agent that says {found.label} means --track {TRACKS[found.label]}", err=True)
    _say_what_is_missing()
    results: list[ScenarioResult] = []
    ours = 0
    for job, outcome in driven(entrant, track, course):
        if isinstance(outcome, Rejected):
            raise InputError(f"{State.REJECTED}: {job.scenario}: {outcome.why}")
        if isinstance(outcome, WorkerFailure):
            if outcome.kind is FailureKind.INPUT:
                raise InputError(outcome.reason)
            ours += 1
            click.echo(f"{Verdict.FAILED_OURS}: {job.scenario}: {outcome.reason}")
            continue
        results.append(outcome)
        click.echo(told(outcome))
    if results:
        mean = means(results)
        driven_ = f"{len(results)} scenario{'s' if len(results) > 1 else ''}"
        click.echo(f"{driven_}: DS {mean.ds:.2f}, SR {mean.sr:.2f}, RC {mean.rc:.2f}; logs, recordings in {course.out}")
    return not ours


def _say_what_is_missing() -> None:
    """An agent may pass here that a server's boxes would end, so the difference is told."""
    required = _of_a_server().required
    if lacks := "; ".join(
        f"{each.name} ({each.detail})" for each in examine_layers() if each.name in required and not each.active
    ):
        click.echo(f"note: boxes here lack what a server's have by default: {lacks}", err=True)


def as_on_the_server(team: Team, environment: Environment | None) -> Entrant:
    """With the limits that a server has unless it says otherwise. Raises InputError."""
    sandbox = _of_a_server()
    limits = sandbox.line_limits()
    return Entrant(team.manifest, team.folder, environment, sandbox.box_limits(), limits, sandbox.backend)


def _of_a_server() -> "Sandbox":
    try:
        from server.settings import Sandbox  # needs the packages of the server
    except ImportError as error:
        raise InputError(f"a dry run needs {error.name}: pip install 'mdrive-sumo[server]'") from None
    return Sandbox()


def driven(
    entrant: Entrant, track: Track, course: Course
) -> Generator[tuple[EpisodeJob, ScenarioResult | Rejected | WorkerFailure]]:
    """Every scenario with its outcome, as they finish. Raises InputError."""
    suite = load_suite(course.suite)
    scenarios = suite.matching(course.scenario)
    logs, recordings = course.out / "logs", course.out / "episodes"
    try:
        for folder in (logs, recordings):
            folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{course.out}: cannot be written: {error.strerror}") from None
    comm = format_comm_json(COMM[track])
    jobs = [
        replace(
            entrant.job(suite.folder.resolve(), one.id, course.seed, str(recordings / f"{one.id}.npz"), str(logs)),
            comm=comm,
        )
        for one in scenarios
    ]
    most = max(len(one.egos) for one in scenarios)
    limit_s = SIMULATION_S + most * (2 * entrant.limits.start_s + entrant.limits.episode_s)
    with ProcessPool[EpisodeJob, ScenarioResult | Rejected](drive, min(course.workers, len(jobs)), limit_s) as pool:
        yield from pool.run(jobs)


def drive(job: EpisodeJob) -> ScenarioResult | Rejected:
    """In a worker process, whose main thread opens the boxes."""
    try:
        return run_job(job)
    except RejectedError as error:
        return Rejected(str(error))


def told(result: ScenarioResult) -> str:
    """One scenario in a line."""
    verdict, reason = verdict_of(result)
    numbers = f"DS {result.ds:6.2f}  SR {result.sr:6.2f}  RC {result.rc:6.2f}  IP {result.ip:.3f}"
    why = next((f"  {ego.id}: {ego.reason}" for ego in result.egos if ego.reason), "")
    return f"{verdict}{f' ({reason})' if reason else ''}: {result.id}  {numbers}{why}"
