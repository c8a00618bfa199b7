"""Leaderboards as the API returns them: read from the database, with published results beside them, never ranked.

Source of the published ones: table 2 of the MDrive paper ("MDrive Benchmark Across Three Scenario Buckets"), measured
in CARLA with those methods' own sensors. Ours are measured in SUMO: the two are not the same experiment.
"""

from dataclasses import dataclass
from typing import NamedTuple

from sqlalchemy import select
from sqlalchemy.orm import Session

from mdrive_sumo.contract import SensingTrack
from mdrive_sumo.report.published_results import BUCKETS, PUBLISHED_METHODS, PublishedMethod
from server.api import submission_views
from server.api.schemas.leaderboards import LeaderboardOut, RowOut
from server.api.schemas.parameters import to_datetime
from server.api.schemas.submissions import FiguresOut
from server.enums import ChallengeTrack
from server.store import phases, queries, tables
from server.store.queries import LeaderboardEntry


@dataclass(frozen=True, slots=True)
class BoardKey:
    """Identifies one leaderboard."""

    phase: str
    track: ChallengeTrack | None
    """None: all tracks in which every CAV decides for itself."""
    bucket: str | None
    category: str | None
    sensing_track: SensingTrack | None = None
    """None: both tracks are shown, each with ranks of its own."""


@dataclass(frozen=True, slots=True)
class PhaseParts:
    """Buckets and categories of a phase that have a leaderboard of their own."""

    buckets: tuple[str, ...]
    categories: tuple[str, ...]


def read_leaderboard(session: Session, key: BoardKey) -> LeaderboardOut:
    """Return a leaderboard. Raises NotFound for an unknown phase."""
    phase = phases.get(session, key.phase)
    entries = queries.find_leaderboard(session, phase.id, key.track, key.bucket, key.category, key.sensing_track)
    is_overall = key.bucket is None and key.category is None
    published = list_published(key.track, key.bucket, key.category)
    return LeaderboardOut(
        phase=key.phase,
        track=key.track,
        bucket=key.bucket,
        category=key.category,
        sensing_track=key.sensing_track,
        rows=[
            _to_row(entry, submission_views.visible_figures(phase, entry.figures))
            for entry in entries
            if is_overall or phase.public
        ],
        published=[_to_row(entry, FiguresOut.model_validate(entry.figures)) for entry in published],
    )


def list_parts(session: Session, phase_id: str) -> PhaseParts:
    """Return the buckets and categories whose figures may be disclosed: none in a hidden phase. Raises NotFound."""
    phase = phases.get(session, phase_id)
    names: dict[str, list[str]] = {"bucket": [], "category": []}
    if phase.public:
        slices = select(tables.StandingRow.slice).where(tables.StandingRow.phase == phase.id).distinct()
        for slice_ in session.scalars(slices.order_by(tables.StandingRow.slice)):
            kind, _, part = slice_.partition(":")
            names.setdefault(kind, []).append(part)
    return PhaseParts(tuple(names["bucket"]), tuple(names["category"]))


class PhaseBoard(NamedTuple):
    """A leaderboard, and when its phase is open."""

    opens_us: int
    """Time at which the phase opens [us since 1970]."""
    closes_us: int
    """Time at which it closes [us since 1970]."""
    key: BoardKey


def list_boards(session: Session) -> list[PhaseBoard]:
    """Return every leaderboard."""
    boards: list[PhaseBoard] = []
    for phase in phases.list_phases(session):
        parts = list_parts(session, phase.id)
        overall = [BoardKey(phase.id, track, None, None) for track in (None, *ChallengeTrack)]
        overall += [BoardKey(phase.id, None, None, None, sensing) for sensing in SensingTrack]
        buckets = [BoardKey(phase.id, None, bucket, None) for bucket in parts.buckets]
        categories = [BoardKey(phase.id, None, None, category) for category in parts.categories]
        boards += [PhaseBoard(phase.opens_us, phase.closes_us, key) for key in (*overall, *buckets, *categories)]
    return boards


def _to_row(entry: queries.LeaderboardEntry, figures: FiguresOut) -> RowOut:
    return RowOut(
        rank=entry.rank,
        team=entry.team,
        method=entry.method,
        track=ChallengeTrack(entry.track),
        sensing_track=SensingTrack(entry.sensing_track) if entry.sensing_track else None,
        submission=entry.submission,
        figures=figures,
        created=to_datetime(entry.created_us) if entry.created_us is not None else None,
        published=entry.published,
    )


def list_published(
    track: ChallengeTrack | None, bucket: str | None = None, category: str | None = None
) -> list[LeaderboardEntry]:
    """Return the published entries, the best first. The paper has no numbers by category."""
    if category is not None or (bucket is not None and bucket not in BUCKETS):
        return []
    entries = [_to_entry(method, bucket) for method in PUBLISHED_METHODS if track in (None, _find_track(method))]
    return sorted(entries, key=lambda row: -row.ds)


def _find_track(method: PublishedMethod) -> ChallengeTrack:
    if method.negotiates:
        return ChallengeTrack.NEGOTIATION
    return ChallengeTrack.SHARING if method.shares_perception else ChallengeTrack.SINGLE


def _to_entry(method: PublishedMethod, bucket: str | None) -> LeaderboardEntry:
    ds, sr = method.average if bucket is None else method.scores[bucket]
    figures = {"ds": ds, "sr": sr}
    name = method.method.replace("*", " (rule-based)")
    return LeaderboardEntry(
        None, "MDrive paper", name, _find_track(method).value, None, None, ds, figures, None, published=True
    )
