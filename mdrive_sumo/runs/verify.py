"""`verify`: execute a run again, compare every tick with the recording, and score it anew."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.seeding import derive_seed
from mdrive_sumo.core.state import DT
from mdrive_sumo.episode import EpisodeRecord, load_episode
from mdrive_sumo.runs.episode_difference import find_content_difference, find_first_difference
from mdrive_sumo.runs.episode_job import EpisodeJob, make_reexecution, make_silent_job, reexecute, score_job_episode
from mdrive_sumo.runs.prepared_run import PreparedRun
from mdrive_sumo.runs.process_pool import FailureKind, ProcessPool, WorkerFailure
from mdrive_sumo.runs.transcript import EXCHANGE
from mdrive_sumo.scoring import EpisodeKey, Results, ScenarioResult, ScoreMode


@dataclass(frozen=True, slots=True)
class VerificationJob:
    """A scenario to execute again, and its final digest, the only reference without a recording."""

    job: EpisodeJob
    digest: str
    modes: tuple[ScoreMode, ...] = ()
    """Score modes of which the run folder has results."""


@dataclass(frozen=True, slots=True)
class VerificationResult:
    """Whether a scenario is reproduced, and a sentence about the comparison."""

    scenario: str
    """Its id, with the seed in a run of several."""
    identical: bool
    """Whether the episode is the recorded one, tick by tick."""
    text: str
    scores: Mapping[ScoreMode, ScenarioResult] = field(default_factory=lambda: {})
    """The scores of the second execution by score mode; empty if it failed."""
    key: EpisodeKey = ("", 0)
    """Scenario and seed."""
    replayed: str = ""
    """What was taken from the recording because it cannot be repeated, e.g. "1 agent failure"; "" if nothing was."""


def sample_results(results: Results, size: int | None) -> tuple[ScenarioResult, ...]:
    """Return the scenarios to verify in the order of the suite: all that are not void, or `size` of them.

    The choice depends only on the seeds and the scenario ids.
    """
    finished = [result for result in results.scenarios if result.status != "void"]
    drawn = sorted(finished, key=lambda result: derive_seed(result.seed, result.id, "verify"))[:size]
    return tuple(result for result in finished if result in drawn)


def verify(
    run: PreparedRun, chosen: Sequence[ScenarioResult], workers: int, modes: Sequence[ScoreMode] = ()
) -> Iterator[VerificationResult]:
    """Yield the comparison of every chosen scenario, in the order in which they finish. Raises InputError.

    modes: the score modes to score each of them in. Third-party agents run: see `permit_agent`.
    """
    scenarios = {scenario.id: scenario for scenario in run.scenarios}
    checks = [
        VerificationJob(run.make_job(scenarios[key[0]], key[1]), result.digest, tuple(modes))
        for result in chosen
        if (key := run.find_key(result)) in run.episodes
    ]
    with ProcessPool[VerificationJob, VerificationResult](
        verify_episode, min(workers, max(len(checks), 1)), run.limit_s()
    ) as pool:
        for check, outcome in pool.run(checks):
            key = (check.job.scenario, check.job.seed)
            if not isinstance(outcome, WorkerFailure):
                yield replace(outcome, scenario=run.name_episode(key), key=key)
            elif outcome.kind is FailureKind.INPUT:
                raise InputError(outcome.reason)
            else:
                yield VerificationResult(run.name_episode(key), False, outcome.reason, key=key)


def verify_episode(check: VerificationJob) -> VerificationResult:
    """Execute one scenario again, compare it with its recording and score it; runs in a worker."""
    job = check.job
    if job.recording is None:
        again = reexecute(make_silent_job(job))
        same = again.digest == check.digest
        text = f"final digest {again.digest}" + ("" if same else f", was {check.digest}") + " (no recording)"
        return VerificationResult(job.scenario, same, text, _score(check, again))
    recorded = load_episode(job.recording)
    again = reexecute(make_reexecution(job, recorded))
    text = _compare(check, recorded, again)
    identical = not text
    text = text or f"identical ({recorded.ticks} ticks)"
    replayed = _describe_replayed(recorded)
    return VerificationResult(job.scenario, identical, text, _score(check, again), replayed=replayed)


def _compare(check: VerificationJob, recorded: EpisodeRecord, again: EpisodeRecord) -> str:
    """Return a sentence about the first difference; "" if there is none."""
    if recorded.digest != check.digest:
        return f"the recording's digest is {recorded.digest}, that of the results {check.digest}"
    difference = find_first_difference(recorded, again) or find_content_difference(recorded, again)
    if difference is None:
        return ""
    return f"first difference at tick {difference.tick} ({difference.tick * DT:.2f} s): {difference.text}"


def _score(check: VerificationJob, again: EpisodeRecord) -> dict[ScoreMode, ScenarioResult]:
    return {mode: score_job_episode(replace(check.job, score_mode=mode), again) for mode in check.modes}


def _describe_replayed(recorded: EpisodeRecord) -> str:
    """Return what a second execution takes from the recording; a run's word is taken for these alone."""
    counts = {
        "agent failures": sum(ending.failure is not None for ending in recorded.endings),
        "thinking times": len(recorded.thinking),
        "answers of a language model": sum(record.note.kind == EXCHANGE for record in recorded.notes),
    }
    return ", ".join(f"{count} {name}" for name, count in counts.items() if count)
