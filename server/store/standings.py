"""The numbers of a finished submission, and what of them stands on the leaderboards."""

import hashlib
import json
import math
from collections.abc import Iterator
from typing import Any, TypedDict

from sqlalchemy import delete, select
from sqlalchemy.orm import Session

from server.enums import State
from server.store.tables import Standing, Submission

OVERALL = "overall"
ENVIRONMENT = "environment"
"""The part of `Submission.evaluator` that is of the agent, not of what measures it: the packages it was driven with."""

Figures = dict[str, Any]
"""`ds` [%] and what else there is to say: sr, confidence intervals, ..."""


class Summary(TypedDict):
    """`Submission.summary`. Every `Figures` in it has `ds`."""

    overall: Figures
    buckets: dict[str, Figures]
    categories: dict[str, Figures]


def slice_of(bucket: str | None = None, category: str | None = None) -> str:
    """The key of a leaderboard: of one bucket, of one category, or overall."""
    if bucket is not None and category is not None:
        raise ValueError(f"expected a bucket or a category, found bucket {bucket!r} and category {category!r}")
    if bucket is not None:
        return f"bucket:{bucket}"
    return OVERALL if category is None else f"category:{category}"


def rank(session: Session, submission: Submission) -> None:
    """Finds anew what of its team stands on the leaderboards: the best of those done, shown and alike in evaluator."""
    session.flush()
    evaluator = digest(submission.evaluator)
    of_group = (
        Standing.phase == submission.phase,
        Standing.track == submission.track,
        Standing.team == submission.team,
    )
    session.execute(delete(Standing).where(*of_group, Standing.evaluator == evaluator))
    done = select(Submission).where(
        Submission.phase == submission.phase,
        Submission.track == submission.track,
        Submission.team == submission.team,
        Submission.state == State.DONE,
        Submission.shown,
    )
    best: dict[str, Standing] = {}
    for candidate in session.scalars(done.order_by(Submission.created_us, Submission.id)):
        if digest(candidate.evaluator) != evaluator:
            continue
        for standing in _standings(candidate, evaluator):
            if standing.slice not in best or standing.ds > best[standing.slice].ds:
                best[standing.slice] = standing
    session.add_all(best.values())
    session.flush()


def ds_of(figures: Figures) -> float:
    """DS to the 6 decimals of results, so that what prints as equal ties."""
    ds = round(float(figures["ds"]), 6)
    if not math.isfinite(ds):
        raise ValueError(f"expected a finite ds, found {ds}")
    return ds


def digest(evaluator: dict[str, Any]) -> str:
    """Of what evaluated: results under different ones are not comparable.

    Agents of different environments are: a team chooses its environment as it chooses its code.
    """
    measure = {name: value for name, value in evaluator.items() if name != ENVIRONMENT}
    return hashlib.sha256(json.dumps(measure, sort_keys=True).encode()).hexdigest()[:16]


def _standings(submission: Submission, evaluator: str) -> Iterator[Standing]:
    summary = submission.summary
    if summary is None:
        return
    slices = {OVERALL: summary["overall"]}
    slices |= {slice_of(bucket=name): figures for name, figures in summary["buckets"].items()}
    slices |= {slice_of(category=name): figures for name, figures in summary["categories"].items()}
    for slice_, figures in slices.items():
        yield Standing(
            phase=submission.phase,
            slice=slice_,
            track=submission.track,
            team=submission.team,
            evaluator=evaluator,
            submission=submission.id,
            method=submission.name,
            created_us=submission.created_us,
            ds=ds_of(figures),
            figures=figures,
        )
