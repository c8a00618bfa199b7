"""How long an agent's answers took: the histograms of boxes, added up and drawn."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

WIDTH, HEIGHT, FOOT, HEAD = 640, 190, 34, 18


@dataclass(frozen=True, slots=True)
class HistogramBar:
    """One class of the histogram, in the units of the drawing."""

    x: float
    y: float
    width: float
    height: float
    label: str
    """What times it counts."""
    short: str
    """The same under the bar, where there is little room."""
    count: int


@dataclass(frozen=True, slots=True)
class LatencyHistogram:
    """Ready to be drawn."""

    bars: tuple[HistogramBar, ...]
    total: int
    usual: str
    """In which class the median lies."""
    width: int = WIDTH
    height: int = HEIGHT
    ground: int = HEIGHT - FOOT


def make_histogram(usages: Iterable[Mapping[str, Any] | None]) -> LatencyHistogram | None:
    """The sum of `usage.latency` over scenarios; None where nobody answered.

    Scenarios with other classes than the first are left out.
    """
    ends: list[float] = []
    counts: list[int] = []
    for usage in usages:
        latency = (usage or {}).get("latency")
        if not latency or not latency["counts"] or (ends and latency["ends_ms"] != ends):
            continue
        ends = latency["ends_ms"]
        counts = [a + b for a, b in zip(counts or [0] * len(latency["counts"]), latency["counts"], strict=True)]
    if not sum(counts):
        return None
    labels = _make_labels(ends)
    wide, tall = WIDTH / len(counts), HEIGHT - FOOT - HEAD
    heights = [tall * count / max(counts) for count in counts]
    bars = tuple(
        HistogramBar(
            round(i * wide + 3, 1),
            round(HEIGHT - FOOT - high, 1),
            round(wide - 6, 1),
            round(high, 1),
            label,
            _shorten(label),
            count,
        )
        for i, (high, label, count) in enumerate(zip(heights, labels, counts, strict=True))
    )
    return LatencyHistogram(bars, sum(counts), labels[_find_median_class(counts)])


def _make_labels(ends_ms: list[float]) -> list[str]:
    """≤ 1 ms, ≤ 2 ms, ... ≤ 5 s, > 5 s."""
    return [*(f"≤ {_format_time(end)}" for end in ends_ms), f"> {_format_time(ends_ms[-1])}"]


def _shorten(label: str) -> str:
    return label.removesuffix(" ms")


def _format_time(milliseconds: float) -> str:
    return f"{milliseconds / 1000:g} s" if milliseconds >= 1000 else f"{milliseconds:g} ms"


def _find_median_class(counts: list[int]) -> int:
    seen, half = 0, sum(counts) / 2
    for index, count in enumerate(counts):
        seen += count
        if seen >= half:
            return index
    return len(counts) - 1
