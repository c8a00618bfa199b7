"""Published results, shown beside a leaderboard for comparison: marked as such and never ranked.

Source: table 2 of the MDrive paper ("MDrive Benchmark Across Three Scenario Buckets"), measured in CARLA with those
methods' own sensors. Ours are measured in SUMO: the two are not the same experiment.
"""

from typing import NamedTuple

from server.enums import ChallengeTrack
from server.store.queries import LeaderboardEntry

BUCKETS = ("InterDrive", "Interaction", "V2XPnP")
"""Buckets as scenario files name them."""


class _PublishedResult(NamedTuple):
    method: str
    track: ChallengeTrack
    ds: tuple[float, float, float, float]
    """DS [%] per bucket, then "Avg", the mean of the three."""
    sr: tuple[float, float, float, float]


_TABLE = (
    _PublishedResult("TCP", ChallengeTrack.SINGLE, (83.55, 75.80, 71.02, 76.79), (67.80, 55.25, 58.70, 60.58)),
    _PublishedResult("UniAD", ChallengeTrack.SINGLE, (57.48, 53.08, 72.55, 61.04), (26.40, 31.10, 68.48, 41.99)),
    _PublishedResult("VAD", ChallengeTrack.SINGLE, (57.49, 48.83, 67.20, 57.84), (23.30, 27.14, 66.30, 38.91)),
    _PublishedResult("LMDrive", ChallengeTrack.SINGLE, (56.74, 57.45, 71.56, 61.92), (27.10, 29.08, 69.57, 41.92)),
    _PublishedResult("CoDriving", ChallengeTrack.SHARING, (83.99, 79.06, 84.97, 82.67), (66.10, 70.53, 82.84, 73.16)),
    _PublishedResult(
        "CoLMDriver (rule-based)",
        ChallengeTrack.NEGOTIATION,
        (83.77, 66.70, 77.89, 76.12),
        (75.10, 53.65, 73.13, 67.29),
    ),
    _PublishedResult(
        "CoLMDriver", ChallengeTrack.NEGOTIATION, (85.29, 67.91, 78.27, 77.16), (76.85, 51.93, 75.37, 68.05)
    ),
)


def list_published(
    track: ChallengeTrack | None, bucket: str | None = None, category: str | None = None
) -> list[LeaderboardEntry]:
    """Return the published entries, the best first. The paper has no numbers by category."""
    if category is not None or (bucket is not None and bucket not in BUCKETS):
        return []
    column = len(BUCKETS) if bucket is None else BUCKETS.index(bucket)
    found = [_to_entry(entry, column) for entry in _TABLE if track is None or entry.track is track]
    return sorted(found, key=lambda row: -row.ds)


def _to_entry(entry: _PublishedResult, column: int) -> LeaderboardEntry:
    ds, sr = entry.ds[column], entry.sr[column]
    figures = {"ds": ds, "sr": sr}
    return LeaderboardEntry(
        None, "MDrive paper", entry.method, entry.track.value, None, ds, figures, None, published=True
    )
