"""Published results, to stand on a leaderboard for comparison: marked as such and never ranked.

Source: table 2 of the MDrive paper ("MDrive Benchmark Across Three Scenario Buckets"), measured in CARLA with those
methods' own sensors. Ours are measured in SUMO: the two are not the same experiment.
"""

from typing import NamedTuple

from server.enums import Track
from server.store.queries import Row

BUCKETS = ("InterDrive", "Interaction", "V2XPnP")
"""As scenario files name them."""


class _Published(NamedTuple):
    method: str
    track: Track
    ds: tuple[float, float, float, float]
    """Per bucket, then "Avg", the mean of the three."""
    sr: tuple[float, float, float, float]


_TABLE = (
    _Published("TCP", Track.SINGLE, (83.55, 75.80, 71.02, 76.79), (67.80, 55.25, 58.70, 60.58)),
    _Published("UniAD", Track.SINGLE, (57.48, 53.08, 72.55, 61.04), (26.40, 31.10, 68.48, 41.99)),
    _Published("VAD", Track.SINGLE, (57.49, 48.83, 67.20, 57.84), (23.30, 27.14, 66.30, 38.91)),
    _Published("LMDrive", Track.SINGLE, (56.74, 57.45, 71.56, 61.92), (27.10, 29.08, 69.57, 41.92)),
    _Published("CoDriving", Track.SHARING, (83.99, 79.06, 84.97, 82.67), (66.10, 70.53, 82.84, 73.16)),
    _Published(
        "CoLMDriver (rule-based)", Track.NEGOTIATION, (83.77, 66.70, 77.89, 76.12), (75.10, 53.65, 73.13, 67.29)
    ),
    _Published("CoLMDriver", Track.NEGOTIATION, (85.29, 67.91, 78.27, 77.16), (76.85, 51.93, 75.37, 68.05)),
)


def rows(track: Track | None, bucket: str | None = None, category: str | None = None) -> list[Row]:
    """As `queries.leaderboard`, the best first. The paper has no numbers by category."""
    if category is not None or (bucket is not None and bucket not in BUCKETS):
        return []
    column = len(BUCKETS) if bucket is None else BUCKETS.index(bucket)
    found = [_row(entry, column) for entry in _TABLE if track is None or entry.track is track]
    return sorted(found, key=lambda row: -row.ds)


def _row(entry: _Published, column: int) -> Row:
    ds, sr = entry.ds[column], entry.sr[column]
    figures = {"ds": ds, "sr": sr}
    return Row(None, "MDrive paper", entry.method, entry.track.value, None, ds, figures, None, published=True)
