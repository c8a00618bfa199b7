"""Published results, shown beside a leaderboard for comparison: marked as such and never ranked.

Source: table 2 of the MDrive paper ("MDrive Benchmark Across Three Scenario Buckets"), measured in CARLA with those
methods' own sensors. Ours are measured in SUMO: the two are not the same experiment.
"""

from mdrive_sumo.report.published_results import BUCKETS, PUBLISHED_METHODS, PublishedMethod
from server.enums import ChallengeTrack
from server.store.queries import LeaderboardEntry


def list_published(
    track: ChallengeTrack | None, bucket: str | None = None, category: str | None = None
) -> list[LeaderboardEntry]:
    """Return the published entries, the best first. The paper has no numbers by category."""
    if category is not None or (bucket is not None and bucket not in BUCKETS):
        return []
    found = [_to_entry(method, bucket) for method in PUBLISHED_METHODS if track in (None, _find_track(method))]
    return sorted(found, key=lambda row: -row.ds)


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
