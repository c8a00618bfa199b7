"""Leaderboards as the API returns them, read from the database."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from server.api import schemas, submission_views
from server.api.schemas import to_datetime
from server.enums import ChallengeTrack
from server.store import phases, published_results, queries, tables


@dataclass(frozen=True, slots=True)
class BoardKey:
    """Identifies one leaderboard."""

    phase: str
    track: ChallengeTrack | None
    """None: all tracks in which every CAV decides for itself."""
    bucket: str | None
    category: str | None


@dataclass(frozen=True, slots=True)
class PhaseParts:
    """Buckets and categories of a phase that have a leaderboard of their own."""

    buckets: tuple[str, ...]
    categories: tuple[str, ...]


def read_leaderboard(session: Session, key: BoardKey) -> schemas.LeaderboardOut:
    """Return a leaderboard. Raises NotFound for an unknown phase."""
    phase = phases.get(session, key.phase)
    entries = queries.find_leaderboard(session, phase.id, key.track, key.bucket, key.category)
    is_overall = key.bucket is None and key.category is None
    published = published_results.list_published(key.track, key.bucket, key.category)
    return schemas.LeaderboardOut(
        phase=key.phase,
        track=key.track,
        bucket=key.bucket,
        category=key.category,
        rows=[
            _to_row(entry, submission_views.visible_figures(phase, _find_summary(session, phase, entry), entry.figures))
            for entry in entries
            if is_overall or _is_disclosable(session, phase, key, entry)
        ],
        published=[_to_row(entry, schemas.FiguresOut.model_validate(entry.figures)) for entry in published],
    )


def list_parts(session: Session, phase_id: str) -> PhaseParts:
    """Return the buckets and categories whose figures may be disclosed. Raises NotFound."""
    phase = phases.get(session, phase_id)
    scenarios = func.max(tables.StandingRow.figures["scenarios"].as_integer())
    slices = select(tables.StandingRow.slice, scenarios).where(tables.StandingRow.phase == phase.id)
    found = session.execute(slices.group_by(tables.StandingRow.slice).order_by(tables.StandingRow.slice)).all()
    figures_by_part: dict[str, dict[str, dict[str, int]]] = {"bucket": {}, "category": {}}
    for name, count in found:
        kind, _, part = name.partition(":")
        figures_by_part.setdefault(kind, {})[part] = {"scenarios": count or 0}
    buckets, categories = (
        submission_views.disclosable_parts(phase, figures_by_part[kind]) for kind in ("bucket", "category")
    )
    return PhaseParts(
        tuple(name for name in figures_by_part["bucket"] if name in buckets),
        tuple(name for name in figures_by_part["category"] if name in categories),
    )


def list_boards(session: Session) -> list[tuple[int, int, BoardKey]]:
    """Return the times at which its phase opens and closes [us since 1970], and the key, of every leaderboard."""
    found: list[tuple[int, int, BoardKey]] = []
    for phase in phases.list_phases(session):
        parts = list_parts(session, phase.id)
        overall = [BoardKey(phase.id, track, None, None) for track in (None, *ChallengeTrack)]
        buckets = [BoardKey(phase.id, None, bucket, None) for bucket in parts.buckets]
        categories = [BoardKey(phase.id, None, None, category) for category in parts.categories]
        found += [(phase.opens_us, phase.closes_us, key) for key in (*overall, *buckets, *categories)]
    return found


def _is_disclosable(session: Session, phase: tables.PhaseRow, key: BoardKey, entry: queries.LeaderboardEntry) -> bool:
    """Return whether a bucket's or category's row may be shown: it depends on the other parts of the submission."""
    summary = _find_summary(session, phase, entry)
    if summary is None:
        return phase.public
    parts = summary["buckets" if key.bucket is not None else "categories"]
    return (key.bucket or key.category) in submission_views.disclosable_parts(phase, parts)


def _find_summary(
    session: Session, phase: tables.PhaseRow, entry: queries.LeaderboardEntry
) -> Mapping[str, Any] | None:
    """Return the summary of an entry's submission in a hidden phase; None in a public one, which needs none."""
    submission = session.get(tables.SubmissionRow, entry.submission) if not phase.public else None
    return submission.summary if submission is not None else None


def _to_row(entry: queries.LeaderboardEntry, figures: schemas.FiguresOut) -> schemas.RowOut:
    return schemas.RowOut(
        rank=entry.rank,
        team=entry.team,
        method=entry.method,
        track=ChallengeTrack(entry.track),
        submission=entry.submission,
        figures=figures,
        created=to_datetime(entry.created_us) if entry.created_us is not None else None,
        published=entry.published,
    )
