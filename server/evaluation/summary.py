"""Figures of a finished submission: overall, per bucket and per category, with confidence intervals."""

from collections import Counter
from collections.abc import Callable, Sequence

from sqlalchemy.orm import Session

from mdrive_sumo.contract import join_sensing_tracks
from mdrive_sumo.core.statistics import bootstrap_nested
from mdrive_sumo.scoring import Means, ScenarioResult, compute_bucket_means, compute_category_means, compute_overall
from mdrive_sumo.scoring.summary import compute_scalar_means
from server.evaluation.thinking_times import record_thinking_flag
from server.store import Store, submissions
from server.store.audit import compute_results_checksum
from server.store.standings import FiguresData, SummaryData
from server.store.tables import JobRow

INTERVAL_SCORES = ("ds", "sr")
"""What has an interval; the places of each bucket are drawn anew on their own."""


def summarise(jobs: Sequence[JobRow]) -> SummaryData:
    """Overall numbers are means over the buckets, as the paper's are."""
    results = [ScenarioResult.model_validate(job.result) for job in jobs]
    of_bucket = {name: [each for each in results if each.bucket == name] for name in compute_bucket_means(results)}
    of_category = {
        name: [each for each in results if each.category == name] for name in compute_category_means(results)
    }
    return {
        "overall": _compute_figures(compute_overall(results).bucket_mean, list(of_bucket.values())),
        "buckets": {
            name: _compute_figures(means, [of_bucket[name]]) for name, means in compute_bucket_means(results).items()
        },
        "categories": {
            name: _compute_figures(means, [of_category[name]])
            for name, means in compute_category_means(results).items()
        },
        "sensing_track": join_sensing_tracks(each.sensing_track for each in results),
        "results_sha256": compute_results_checksum(jobs),
    }


def _compute_figures(means: Means, groups: Sequence[Sequence[ScenarioResult]]) -> FiguresData:
    figures: FiguresData = {name: getattr(means, name) for name in ("ds", "sr", "rc", "ip", "time_ratio")}
    results = [result for group in groups for result in group]
    labels, strata = [result.label for result in results], [str(i) for i, group in enumerate(groups) for _ in group]
    for name in INTERVAL_SCORES:
        interval = bootstrap_nested([getattr(result, name) for result in results], labels, strata)
        low, high = (round(end, 6) for end in interval.ends) if interval.ends else (None, None)
        figures[f"{name}_low"], figures[f"{name}_high"] = low, high
    is_referenced = all(result.efficient_sr is not None for result in results)
    figures["efficient_sr"] = means.efficient_sr if is_referenced else None  # else over other scenarios than SR
    figures["timed"] = len({result.id for result in results if result.time_ratio is not None})
    encounters = (result.min_ttc for result in results if result.min_ttc is not None)  # without any it is undefined
    figures["scalars"] = {"min_ttc": min(encounters, default=None), **compute_scalar_means(results)}
    kinds = Counter(interval.kind for result in results for ego in result.egos for interval in ego.infractions)
    return figures | {"scenarios": len({result.id for result in results}), "infractions": dict(sorted(kinds.items()))}


OnDone = Callable[[Session, str], None]
"""What else to do in the transaction that marks a submission done."""


def write_summary(store: Store, submission: str, clock: Callable[[], int], on_done: OnDone) -> None:
    """Write the summary of a complete submission; it is computed before the write transaction begins.

    Does nothing for a submission that is not complete, or that another worker has finished. Raises StoreUnavailable.
    """
    with store.read() as session:
        if not submissions.is_complete(session, submission):
            return
        summary = summarise(submissions.list_finished_jobs(session, submission))
    with store.write() as session:
        if submissions.finish_if_complete(session, submission, summary, clock()):
            on_done(session, submission)  # first: the hash of the entry `submission-done` draws the spot checks
            record_thinking_flag(session, submission, clock())


def write_left_over_summaries(store: Store, clock: Callable[[], int], on_done: OnDone) -> None:
    """Write the summaries that another worker died before writing. Raises StoreUnavailable."""
    with store.read() as session:
        complete = submissions.list_complete(session)
    for submission in complete:
        write_summary(store, submission, clock, on_done)
