"""Results that the MDrive paper publishes, driven in CARLA: never ranked beside results of this simulator.

Numbers as printed in the paper's source (mdrive.tex). Its own tables are the only source; nothing here was computed.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.scenario.season import split_suite_name
from mdrive_sumo.scoring import Results

AS_PUBLISHED = "CARLA, as published: not ranked"
"""Heading of published rows in a table."""
MAIN_TABLE_LABEL = "tab:mdrive_results"
BUCKETS = ("InterDrive", "Interaction", "V2XPnP")
"""In the order of the paper's main table."""
SUITES = ("interaction", "interdrive", "mdrive", "v2xpnp")
"""Those of this package that hold buckets of the paper."""
BUCKET_SIZES: Mapping[str, int] = MappingProxyType({"InterDrive": 46, "Interaction": 112, "V2XPnP": 67})
"""Scenarios of each bucket (mdrive.tex, tab:scenario_distribution)."""
PUBLISHED_GAPS: Mapping[str, float] = MappingProxyType(
    {"static-avoidance": 3.54, "dynamic-avoidance": 35.12, "dynamic-coordination": 24.58}
)
"""Multi-agent minus single-agent harmonic mean of DS and SR by level; the text of RQ1 (subsec:rq1) names them."""


@dataclass(frozen=True, slots=True)
class PublishedMethod:
    """A row of the paper's main table: DS and SR [%] by bucket, and its average."""

    method: str
    shares_perception: bool
    negotiates: bool
    scores: Mapping[str, tuple[float, float]]
    average: tuple[float, float]
    """The mean of the three buckets, although the caption says mean over scenarios."""


def _make_method(method: str, flags: str, *numbers: float) -> PublishedMethod:
    """flags: p perception sharing, n negotiation. numbers: DS, SR of each bucket and the average."""
    pairs = list(zip(numbers[::2], numbers[1::2], strict=True))
    scores: dict[str, tuple[float, float]] = dict(zip(BUCKETS, pairs[:-1], strict=True))
    return PublishedMethod(method, "p" in flags, "n" in flags, MappingProxyType(scores), pairs[-1])


PUBLISHED_METHODS = (
    _make_method("TCP", "", 83.55, 67.80, 75.80, 55.25, 71.02, 58.70, 76.79, 60.58),
    _make_method("UniAD", "", 57.48, 26.40, 53.08, 31.10, 72.55, 68.48, 61.04, 41.99),
    _make_method("VAD", "", 57.49, 23.30, 48.83, 27.14, 67.20, 66.30, 57.84, 38.91),
    _make_method("LMDrive", "", 56.74, 27.10, 57.45, 29.08, 71.56, 69.57, 61.92, 41.92),
    _make_method("CoDriving", "p", 83.99, 66.10, 79.06, 70.53, 84.97, 82.84, 82.67, 73.16),
    _make_method("CoLMDriver*", "pn", 83.77, 75.10, 66.70, 53.65, 77.89, 73.13, 76.12, 67.29),
    _make_method("CoLMDriver", "pn", 85.29, 76.85, 67.91, 51.93, 78.27, 75.37, 77.16, 68.05),
)
"""The paper's main table (`MAIN_TABLE_LABEL`), in its order."""


@dataclass(frozen=True, slots=True)
class PublishedDegradation:
    """A row of the paper's RQ5 tables: clean and perturbed DS [%], RC [%], IS (the factor IP) and SR [%].

    The paper's own rounding makes some of its differences deviate by 0.01 from those of these numbers.
    """

    method: str
    ds: tuple[float, float]
    rc: tuple[float, float]
    ip: tuple[float, float]
    sr: tuple[float, float]


PUBLISHED_LATENCY = (
    PublishedDegradation("CoDriving", (92.85, 84.59), (97.10, 86.62), (0.942, 0.912), (88.10, 83.33)),
    PublishedDegradation("CoLMDriver", (79.43, 78.76), (82.57, 81.19), (0.935, 0.936), (71.43, 69.05)),
    PublishedDegradation("CoLMDriver*", (78.79, 72.84), (81.67, 74.12), (0.931, 0.943), (71.43, 64.29)),
)
"""tab:latency_results: 6 ticks of delay and real-time inference, 21 matched V2XPnP scenarios."""
PUBLISHED_POSE_ERROR = (
    PublishedDegradation("CoDriving", (92.85, 92.55), (97.10, 96.28), (0.942, 0.942), (88.10, 88.10)),
    PublishedDegradation("CoLMDriver", (79.43, 75.70), (82.57, 77.21), (0.935, 0.935), (71.43, 57.14)),
    PublishedDegradation("CoLMDriver*", (78.79, 70.63), (81.67, 73.10), (0.931, 0.934), (71.43, 57.14)),
)
"""tab:pose_error_results: 0.6 m and 0.6 degrees, 21 matched V2XPnP scenarios."""


def order_buckets(names: Iterable[str]) -> tuple[str, ...]:
    """Return buckets in the order of the paper's main table, others after them by name."""
    place_by_name = {name: i for i, name in enumerate(BUCKETS)}
    return tuple(sorted(names, key=lambda name: (place_by_name.get(name, len(BUCKETS)), name)))


def check_published_rows(results: Results) -> None:
    """Raise InputError unless results are of whole buckets of the paper in a suite of this package."""
    if split_suite_name(results.run.suite)[0] not in SUITES:
        raise InputError(
            f"--with-published: expected a suite of the paper's buckets ({', '.join(SUITES)}), found"
            f" {results.run.suite_label}"
        )
    for name, bucket in results.buckets.items():
        if bucket.scenarios != BUCKET_SIZES.get(name):
            raise InputError(
                f"--with-published: expected all {BUCKET_SIZES.get(name, 0)} scenarios of {name}, which the published"
                f" rows are means over, found {bucket.scenarios}"
            )
