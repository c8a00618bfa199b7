"""The value of a message: execute a recorded episode again without some of its messages."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Bool
from mdrive_sumo.episode import EpisodeRecord, load_episode
from mdrive_sumo.runs.episode_difference import find_first_difference
from mdrive_sumo.runs.episode_job import EpisodeJob, make_reexecution, reexecute, score_job_episode
from mdrive_sumo.runs.prepared_run import PreparedRun
from mdrive_sumo.runs.process_pool import FailureKind, ProcessPool, WorkerFailure
from mdrive_sumo.scoring import ScenarioResult
from mdrive_sumo.scoring.metrics.min_ttc import HORIZON_S
from mdrive_sumo.v2x.channel import DeliveryStatus, SentMessage
from mdrive_sumo.v2x.comm_settings import CommSettings

Mute = tuple[str, ...]
"""Patterns of `CommSettings.mute` that are muted together; () changes nothing."""


@dataclass(frozen=True, slots=True)
class AblationJob:
    """A recorded job to execute again without some messages."""

    job: EpisodeJob
    mute: Mute


@dataclass(frozen=True, slots=True)
class MuteEffect:
    """The episode without those messages."""

    mute: Mute
    messages: int
    """Number of muted messages in the recording."""
    result: ScenarioResult
    parted: int | None
    """The first tick in which a road user's state differs, or the length of the shorter episode; None: no tick."""
    difference: str
    """The first difference of any kind, received messages included; "" if there is none."""


@dataclass(frozen=True, slots=True)
class AblationResult:
    """An episode, and its changes without single senders, types or messages."""

    recorded: ScenarioResult
    effects: tuple[MuteEffect, ...]
    """The largest change of DS first, then of minimum TTC, then the earliest divergence."""


def list_sender_and_type_patterns(messages: Sequence[SentMessage]) -> tuple[str, ...]:
    """Return a pattern for every sender and every type of delivered messages."""
    reached = [sent.message for sent in messages if _was_delivered(sent)]
    senders, types = ({getattr(message, name) for message in reached} for name in ("sender", "type"))
    return (*(f"{sender}/*" for sender in sorted(senders)), *(f"*/{kind}" for kind in sorted(types)))


def list_message_patterns(messages: Sequence[SentMessage], kind: str) -> tuple[str, ...]:
    """Return a pattern for every delivered message of a type; messages of one sender and tick share a pattern."""
    reached = (sent.message for sent in messages if sent.message.type == kind and _was_delivered(sent))
    return tuple(dict.fromkeys(f"{message.sender}/{kind}@{message.tick}" for message in reached))


def _was_delivered(sent: SentMessage) -> bool:
    return any(fate is DeliveryStatus.DELIVERED for fate, _ in sent.deliveries.values())


def ablate(run: PreparedRun, recorded: ScenarioResult, mutes: Sequence[str], workers: int) -> Iterator[MuteEffect]:
    """First the recording unchanged, then each pattern alone, as they finish. Raises InputError.

    The first is to be identical (`MuteEffect.difference` is ""): otherwise the others tell nothing, and are not driven
    if the caller stops there.
    """
    scenario = next(scenario for scenario in run.scenarios if scenario.id == recorded.id)
    job = run.make_job(scenario, recorded.seed)
    with ProcessPool[AblationJob, MuteEffect](ablate_episode, min(workers, max(len(mutes), 1)), run.limit_s()) as pool:
        for wanted in ([AblationJob(job, ())], [AblationJob(job, (mute,)) for mute in mutes]):
            for _, outcome in pool.run(wanted):
                if not isinstance(outcome, WorkerFailure):
                    yield outcome
                elif outcome.kind is FailureKind.INPUT:
                    raise InputError(outcome.reason)
                else:
                    raise InputError(f"{recorded.id}: cannot be executed again: {outcome.reason}")


def ablate_episode(ablation: AblationJob) -> MuteEffect:
    """Execute one episode again, as `verify` does: failures, think times and transcripts are replayed."""
    job = ablation.job
    assert job.recording is not None
    recorded = load_episode(job.recording)
    again = reexecute(_mute(make_reexecution(job, recorded), ablation.mute))
    difference = find_first_difference(recorded, again)
    muted = CommSettings(mute=ablation.mute).mute_filter
    return MuteEffect(
        mute=ablation.mute,
        messages=sum(muted.matches(s.message.sender, s.message.type, s.message.tick) for s in recorded.messages),
        result=score_job_episode(job, again),
        parted=find_divergence_tick(recorded, again),
        difference=f"tick {difference.tick}: {difference.text}" if difference else "",
    )


def rank_effects(recorded: ScenarioResult, effects: Sequence[MuteEffect]) -> AblationResult:
    """Return the effects sorted by size."""

    def sort_key(effect: MuteEffect) -> tuple[float, float, float, Mute]:
        was, now = (HORIZON_S if result.min_ttc is None else result.min_ttc for result in (recorded, effect.result))
        parted = np.inf if effect.parted is None else effect.parted
        return (-abs(effect.result.ds - recorded.ds), -abs(now - was), parted, effect.mute)

    return AblationResult(recorded, tuple(sorted(effects, key=sort_key)))


def compute_ttc_change(recorded: ScenarioResult, again: ScenarioResult) -> float | None:
    """Return the change of minimum TTC [s]; None if either was never within the horizon."""
    if recorded.min_ttc is None or again.min_ttc is None:
        return None
    return again.min_ttc - recorded.min_ttc


def find_divergence_tick(recorded: EpisodeRecord, again: EpisodeRecord) -> int | None:
    """Return the first tick in which states differ, regardless of received messages; None if there is none.

    Where one episode is longer, it is the length of the other.
    """
    ticks = min(recorded.ticks, again.ticks)
    differing = np.zeros(ticks, dtype=np.bool_)
    for name in {*recorded.ids, *again.ids}:
        differing |= _differs(recorded, again, name, ticks)
    ticks_apart = np.flatnonzero(differing)
    if len(ticks_apart):
        return int(ticks_apart[0])
    return None if recorded.ticks == again.ticks else ticks


def _differs(recorded: EpisodeRecord, again: EpisodeRecord, name: str, ticks: int) -> Bool:
    """Return a mask (ticks,) of the ticks in which a road user's state differs."""
    if name not in recorded.ids or name not in again.ids:
        only = recorded if name in recorded.ids else again
        return only.valid[:ticks, only.ids.index(name)]
    i, j = recorded.ids.index(name), again.ids.index(name)
    present, present_again = recorded.valid[:ticks, i], again.valid[:ticks, j]
    moved = (recorded.quanta[:ticks, i] != again.quanta[:ticks, j]).any(axis=1)
    return (present != present_again) | (present & moved)


def _mute(job: EpisodeJob, mute: Mute) -> EpisodeJob:
    comm = job.options.comm
    return replace(job, options=replace(job.options, comm=replace(comm, mute=(*comm.mute, *mute))))


def choose_mutes(
    messages: Sequence[SentMessage], given: Sequence[str], each: str | None = None, most: int = 100
) -> tuple[str, ...]:
    """Return the patterns to mute one by one: `given` ones and `each` message of a type, or every sender and type.

    Raises InputError for patterns that fit no message, and for more than `most` runs.
    """
    if not messages:
        raise InputError("ablate: expected an episode in which something is said, found no message in it")
    for pattern in given:
        muted = CommSettings(mute=(pattern,)).mute_filter
        if not any(muted.matches(s.message.sender, s.message.type, s.message.tick) for s in messages):
            raise InputError(f"ablate: --mute: expected a pattern that fits a message, found {pattern!r}")
    mutes = (*dict.fromkeys(given), *(list_message_patterns(messages, each) if each else ()))
    if each and len(mutes) == len(set(given)):
        raise InputError(f"ablate: --each-message: expected a type of message that reached a receiver, found {each!r}")
    mutes = mutes or list_sender_and_type_patterns(messages)
    if not mutes:
        raise InputError("ablate: expected an episode in which a message reached a receiver, found none")
    if len(mutes) > most:
        raise InputError(
            f"ablate: expected at most {most} runs, found {len(mutes)}; --max-runs {len(mutes)} allows them"
        )
    return mutes
