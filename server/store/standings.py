"""Figures of finished submissions, and the standings derived from them."""

import hashlib
import json
import math
from collections.abc import Iterator
from typing import Any, TypedDict

from sqlalchemy import delete, select
from sqlalchemy.orm import Session

from mdrive_sumo.contract import SensingTrack
from server.enums import SubmissionState
from server.store.tables import PhaseRow, StandingRow, SubmissionRow

OVERALL = "overall"
HIDDEN_DS_DECIMALS = 1
"""Decimals of a driving score [%] in a hidden phase: 1001 values, which carry at most 10 bits."""
ENVIRONMENT = "environment"
"""The key of `SubmissionRow.evaluator` that belongs to the agent, not to the evaluation: its packages."""

FiguresData = dict[str, Any]
"""`ds` [%] and other figures: sr, confidence intervals, ..."""


class SummaryData(TypedDict):
    """`SubmissionRow.summary`. Every `FiguresData` in it has `ds`."""

    overall: FiguresData
    buckets: dict[str, FiguresData]
    categories: dict[str, FiguresData]
    sensing_track: str
    """sensor if all its episodes are, object if any is, "" if some do not say it: then it is ranked as object."""
    results_sha256: str
    """Checksum of the results of its scenarios."""


def slice_key(bucket: str | None = None, category: str | None = None) -> str:
    """Return the key of a leaderboard: of one bucket, of one category, or overall."""
    if bucket is not None and category is not None:
        raise ValueError(f"expected a bucket or a category, found bucket {bucket!r} and category {category!r}")
    if bucket is not None:
        return f"bucket:{bucket}"
    return OVERALL if category is None else f"category:{category}"


def update_standings(session: Session, submission: SubmissionRow) -> None:
    """Recompute the standings of the submission's team: the best of those done, shown and of the same evaluator."""
    session.flush()
    evaluator = evaluator_digest(submission.evaluator)
    of_group = (
        StandingRow.phase == submission.phase,
        StandingRow.track == submission.track,
        StandingRow.team == submission.team,
    )
    session.execute(delete(StandingRow).where(*of_group, StandingRow.evaluator == evaluator))
    done = select(SubmissionRow).where(
        SubmissionRow.phase == submission.phase,
        SubmissionRow.track == submission.track,
        SubmissionRow.team == submission.team,
        SubmissionRow.state == SubmissionState.DONE,
        SubmissionRow.shown,
    )
    phase = session.get(PhaseRow, submission.phase)
    is_public = phase is not None and phase.public
    best: dict[tuple[str, str], StandingRow] = {}
    for candidate in session.scalars(done.order_by(SubmissionRow.created_us, SubmissionRow.id)):
        if evaluator_digest(candidate.evaluator) != evaluator:
            continue
        for standing in make_standings(candidate, evaluator, is_public):
            line = standing.slice, standing.sensing_track
            if line not in best or standing.ds > best[line].ds:
                best[line] = standing
    session.add_all(best.values())
    session.flush()


def round_ds(figures: FiguresData) -> float:
    """Return DS rounded to the 6 decimals of results, so that equal printed values tie."""
    ds = round(float(figures["ds"]), 6)
    if not math.isfinite(ds):
        raise ValueError(f"expected a finite ds, found {ds}")
    return ds


def round_score(ds: float, is_public: bool) -> float:
    """Return the score that ranks a result: of hidden phases only the digits that are disclosed.

    Ranks by more digits would disclose those, by comparison with other submissions of the same team.
    """
    return ds if is_public else round(ds, HIDDEN_DS_DECIMALS)


def refresh_scores(session: Session) -> None:
    """Set the scores of all standings anew: phases change between public and hidden, and so do rules of rounding."""
    public = {phase.id: phase.public for phase in session.scalars(select(PhaseRow))}
    for standing in session.scalars(select(StandingRow)):
        score = round_score(round_ds(standing.figures), public[standing.phase])
        if standing.ds != score:
            standing.ds = score
    session.flush()


def evaluator_digest(evaluator: dict[str, Any]) -> str:
    """Return a digest of the evaluator: results under different ones are not comparable.

    It ignores the agent's environment, which the team chooses like its code.
    """
    measure = {name: value for name, value in evaluator.items() if name != ENVIRONMENT}
    return hashlib.sha256(json.dumps(measure, sort_keys=True).encode()).hexdigest()[:16]


def make_standings(submission: SubmissionRow, evaluator: str, is_public: bool) -> Iterator[StandingRow]:
    """Yield the lines that a done submission has on leaderboards if it is its team's best."""
    summary = submission.summary
    if summary is None:
        return
    slices = {OVERALL: summary["overall"]}
    slices |= {slice_key(bucket=name): figures for name, figures in summary["buckets"].items()}
    slices |= {slice_key(category=name): figures for name, figures in summary["categories"].items()}
    for slice_, figures in slices.items():
        yield StandingRow(
            phase=submission.phase,
            slice=slice_,
            track=submission.track,
            sensing_track=summary["sensing_track"] or SensingTrack.OBJECT.value,
            team=submission.team,
            evaluator=evaluator,
            submission=submission.id,
            method=submission.name,
            created_us=submission.created_us,
            ds=round_score(round_ds(figures), is_public),
            figures=figures,
        )
