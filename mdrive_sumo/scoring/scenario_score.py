"""Score of one scenario, a pure function of its recorded episode."""

from collections import Counter
from collections.abc import Sequence

from mdrive_sumo.contract import REASON
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.reference_times import NO_REFERENCE, ReferenceTicks
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scoring.criteria import compute_time_limit_ticks
from mdrive_sumo.scoring.efficiency import apply_reference_times
from mdrive_sumo.scoring.metrics import EgoRecord, ScoredEpisode, build_ego_records, list_scalar_metrics
from mdrive_sumo.scoring.results import BusyRatioSummary, EgoResult, Infraction, ScenarioResult, SentRate, Speeding
from mdrive_sumo.scoring.score_mode import ScoreMode, compute_driving_score, compute_mean, compute_scenario_means
from mdrive_sumo.v2x.message_counts import (
    compute_message_rates,
    count_deliveries,
    count_exchanged,
    count_malformed,
)
from mdrive_sumo.v2x.services.sending_rate import SendingRate

DROPPED = "(dropped)"


def score_episode(
    episode: EpisodeRecord,
    scenario: Scenario,
    roads: RoadMap,
    mode: ScoreMode,
    seed: int,
    reference: ReferenceTicks = NO_REFERENCE,
) -> ScenarioResult:
    """Return the score of an episode; the same numbers for a finished and a loaded one.

    reference: the times of `omniscient` in this scenario; without them time ratio and efficient SR are undefined.
    Raises InputError for an episode of another scenario, and in mode `hard` without reference; EpisodeMismatch for an
    episode that contradicts itself.
    """
    scored = ScoredEpisode(episode, scenario, roads)
    records = build_ego_records(scored, mode)
    scalars = {metric.name: metric.compute(scored) for metric in list_scalar_metrics()}
    result = ScenarioResult(
        id=scenario.id,
        bucket=scenario.bucket,
        category=scenario.category,
        place=scenario.network,
        seed=seed,
        status="ok",
        reason="",
        **_means(records, mode),
        min_ttc=scalars.pop("min_ttc"),
        scalars=scalars,
        digest=episode.digest,
        ticks=episode.ticks,
        egos=tuple(_ego_result(record) for record in records),
        comm=count_deliveries(episode.messages),
        exchanged=count_exchanged(episode.messages, episode.ego_ids),
        sent_rates=_compute_sent_rates(episode),
        busy_ratio=_summarize_busy_ratios(episode),
        malformed=count_malformed(episode.messages),
        sensing_track=episode.sensing_track,
        notes=_count_notes(episode),
    )
    return apply_reference_times(result, reference, mode, compute_time_limit_ticks(scenario))


def make_void_result(scenario: Scenario, seed: int, reason: str) -> ScenarioResult:
    """Return the result of a run that failed in the benchmark or SUMO: DS 0 in every mode, reported separately.

    The original leaves such runs out of its means (protocol 8.3): a documented deviation.
    """
    return ScenarioResult(
        id=scenario.id,
        bucket=scenario.bucket,
        category=scenario.category,
        place=scenario.network,
        seed=seed,
        status="void",
        reason=reason,
        ds=0.0,
        sr=0.0,
        rc=0.0,
        ip=0.0,
        min_ttc=None,
        digest="",
        ticks=0,
        egos=(),
    )


def _count_notes(episode: EpisodeRecord) -> dict[str, int]:
    """Count notes by kind, and those that were not kept as `DROPPED`, which no agent can use as a kind.

    Notes of kind `REASON` are no events: every drive has them.
    """
    counts = dict(Counter(record.note.kind for record in episode.notes if record.note.kind != REASON))
    return counts | ({DROPPED: episode.dropped_notes} if episode.dropped_notes else {})


def _compute_sent_rates(episode: EpisodeRecord) -> dict[str, SentRate]:
    """Return what was sent in a second by type, of an episode whose stations do not send at fixed intervals."""
    if episode.about.get("v2x_rate", SendingRate.FIXED) == SendingRate.FIXED:
        return {}
    rates = compute_message_rates(episode.messages, episode.ticks)
    return {name: SentRate(**rate._asdict()) for name, rate in rates.items()}


def _summarize_busy_ratios(episode: EpisodeRecord) -> BusyRatioSummary | None:
    """Return what the CAVs measured on a radio; None on another channel. Road-side units do not count."""
    ratios = [one.ratio for one in episode.busy_ratios if one.station in episode.ego_ids]
    return BusyRatioSummary(mean=compute_mean(ratios), greatest=max(ratios)) if ratios else None


def _means(records: Sequence[EgoRecord], mode: ScoreMode) -> dict[str, float]:
    return compute_scenario_means(records, mode).model_dump()


def _ego_result(record: EgoRecord) -> EgoResult:
    ending = record.ending
    return EgoResult(
        id=record.id,
        outcome=ending.end,
        reason=": ".join(part for part in (ending.failure or "", ending.text) if part),
        ds=compute_driving_score(record),
        rc=record.rc,
        ip=record.ip,
        ticks=ending.tick,
        infractions=tuple(
            Infraction(
                kind=i.kind, tick=i.tick, x=i.x, y=i.y, factor=i.factor, other=i.other, impact_speed=i.impact_speed
            )
            for i in record.infractions
        ),
        speeding=Speeding(share=record.speed_excess.share, greatest=record.speed_excess.greatest),
    )
