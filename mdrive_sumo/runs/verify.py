"""`verify`: execute a run again and compare the digest of every tick with the recording."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.seeding import derive_seed
from mdrive_sumo.core.state import DT
from mdrive_sumo.episode import EpisodeRecord, load_episode
from mdrive_sumo.episode.quantization import from_quanta
from mdrive_sumo.runs.episode_job import EpisodeJob, make_reexecution, reexecute
from mdrive_sumo.runs.prepared_run import PreparedRun
from mdrive_sumo.runs.process_pool import FailureKind, ProcessPool, WorkerFailure
from mdrive_sumo.scoring import Results, ScenarioResult
from mdrive_sumo.v2x.channel import DeliveryStatus

STATE_NAMES = ("x", "y", "yaw", "speed")
CONTROL_NAMES = ("throttle", "brake", "steer")


@dataclass(frozen=True, slots=True)
class VerificationJob:
    """A scenario to execute again, and its final digest, the only reference without a recording."""

    job: EpisodeJob
    digest: str


@dataclass(frozen=True, slots=True)
class VerificationResult:
    """Whether a scenario is reproduced, and a sentence about the comparison."""

    scenario: str
    identical: bool
    text: str


@dataclass(frozen=True, slots=True)
class EpisodeDifference:
    """The first tick in which two episodes differ, and one difference in it."""

    tick: int
    text: str


def sample_results(results: Results, size: int | None) -> tuple[ScenarioResult, ...]:
    """Return the scenarios to verify in the order of the suite: all that are not void, or `size` of them.

    The choice depends only on the run's seed and the scenario ids.
    """
    found = [result for result in results.scenarios if result.status != "void"]
    drawn = sorted(found, key=lambda result: derive_seed(results.run.seed, result.id, "verify"))[:size]
    return tuple(result for result in found if result in drawn)


def verify(run: PreparedRun, chosen: Sequence[ScenarioResult], workers: int) -> Iterator[VerificationResult]:
    """Yield the comparison of every chosen scenario, in the order in which they finish. Raises InputError."""
    scenarios = {scenario.id: scenario for scenario in run.scenarios}
    checks = [VerificationJob(run.make_job(scenarios[result.id]), result.digest) for result in chosen]
    with ProcessPool[VerificationJob, VerificationResult](
        verify_episode, min(workers, max(len(checks), 1)), run.limit_s()
    ) as pool:
        for check, outcome in pool.run(checks):
            if not isinstance(outcome, WorkerFailure):
                yield outcome
            elif outcome.kind is FailureKind.INPUT:
                raise InputError(outcome.reason)
            else:
                yield VerificationResult(check.job.scenario, False, outcome.reason)


def verify_episode(check: VerificationJob) -> VerificationResult:
    """Execute one scenario again and compare it with its recording; runs in a worker."""
    job = check.job
    if job.recording is None:
        again = reexecute(replace(job, logs=None, transcripts=None))
        same = again.digest == check.digest
        text = f"final digest {again.digest}" + ("" if same else f", was {check.digest}") + " (no recording)"
        return VerificationResult(job.scenario, same, text)
    recorded = load_episode(job.recording)
    if recorded.digest != check.digest:
        return VerificationResult(
            job.scenario,
            False,
            f"the recording's digest is {recorded.digest}, that of the results {check.digest}",
        )
    difference = find_first_difference(recorded, reexecute(make_reexecution(job, recorded)))
    if difference is None:
        return VerificationResult(job.scenario, True, f"identical ({recorded.ticks} ticks)")
    seconds = difference.tick * DT
    text = f"first difference at tick {difference.tick} ({seconds:.2f} s): {difference.text}"
    return VerificationResult(job.scenario, False, text)


def find_first_difference(recorded: EpisodeRecord, again: EpisodeRecord) -> EpisodeDifference | None:
    """Return the first difference between two episodes; None if every tick and every ending is the same."""
    ticks = min(recorded.ticks, again.ticks)
    differing = np.flatnonzero((recorded.digests[:ticks] != again.digests[:ticks]).any(axis=1))
    if len(differing):
        tick = int(differing[0])
        return EpisodeDifference(tick, next(_find_details(recorded, again, tick), "the digest differs"))
    if recorded.ticks != again.ticks:
        return EpisodeDifference(ticks, f"the episode has {again.ticks} ticks, had {recorded.ticks}")
    for now, then in zip(again.endings, recorded.endings, strict=True):
        if (now.tick, now.end, now.failed_tick) != (then.tick, then.end, then.failed_tick):
            return EpisodeDifference(
                min(now.tick, then.tick),
                f"{now.ego!r} ends {now.end} in tick {now.tick}, ended {then.end} in tick {then.tick}",
            )
    return None


def _find_details(recorded: EpisodeRecord, again: EpisodeRecord, tick: int) -> Iterator[str]:
    """Yield the differences of one tick: messages, road users, states, controls, signals, contacts."""
    if (heard := _read_arrivals(again, tick)) != (had := _read_arrivals(recorded, tick)):
        yield f"messages that arrive: {heard or 'none'}, were {had or 'none'}"
    yield from _compare_states(_read_states(recorded, tick), _read_states(again, tick))
    yield from _compare_controls(recorded, again, tick)
    if (lights := _read_signal_changes(again, tick)) != (before := _read_signal_changes(recorded, tick)):
        yield f"traffic lights change to {lights}, changed to {before}"
    if (touching := _read_contacts(again, tick)) != (touched := _read_contacts(recorded, tick)):
        yield f"contacts are {touching or 'none'}, were {touched or 'none'}"


def _compare_states(then: Mapping[str, Float], now: Mapping[str, Float]) -> Iterator[str]:
    for name in sorted({*then, *now}):
        if name not in now or name not in then:
            yield f"{name!r} is {'new' if name in now else 'missing'}"
            continue
        for i in np.flatnonzero(then[name] != now[name]):
            yield f"{STATE_NAMES[i]} of {name!r} is {now[name][i]:.4f}, was {then[name][i]:.4f}"


def _compare_controls(recorded: EpisodeRecord, again: EpisodeRecord, tick: int) -> Iterator[str]:
    then, now = recorded.control_values[tick], again.control_values[tick]
    for ego, i in np.argwhere(then != now):
        yield f"{CONTROL_NAMES[i]} of {again.ids[ego]!r} is {now[ego, i]:.4f}, was {then[ego, i]:.4f}"


def _read_states(episode: EpisodeRecord, tick: int) -> dict[str, Float]:
    """Return the state (4,) of every present road user by id."""
    present = np.flatnonzero(episode.valid[tick])
    return {episode.ids[i]: from_quanta(episode.quanta[tick, i]) for i in present}


def _read_signal_changes(episode: EpisodeRecord, tick: int) -> dict[str, str]:
    return {change.light: change.state for change in episode.signals if change.tick == tick}


def _read_arrivals(episode: EpisodeRecord, tick: int) -> list[str]:
    return [
        f"{sent.message.type} of {sent.message.sender!r} from tick {sent.message.tick} at {receiver!r}"
        for sent in episode.messages
        for receiver, fate in sent.deliveries.items()
        if fate == (DeliveryStatus.DELIVERED, tick)
    ]


def _read_contacts(episode: EpisodeRecord, tick: int) -> list[tuple[str, str]]:
    return [(contact.ego, contact.other) for at, contact in episode.contacts if at == tick]
