"""Does the order of agents in open loop foretell their order in closed loop? Rank correlations with intervals (RQ3)."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.statistics import (
    RESAMPLES,
    ConfidenceInterval,
    Counts,
    Label,
    compute_kendall,
    compute_spearman,
    count_effective,
    draw_nested_counts,
    make_interval,
    sum_resamples,
)
from mdrive_sumo.open_loop import OpenLoopResults, OpenLoopScenario
from mdrive_sumo.open_loop.results import OpenLoopMetrics, combine_metrics
from mdrive_sumo.scoring import EpisodeKey, Results, ScenarioResult
from mdrive_sumo.study.paper.paper_study import REFERENCE

CHUNK = 500
"""Resamples whose precision curves are in memory at once."""
OPEN_METRICS: Mapping[str, int] = {"ap50": 1, "ade": -1, "fde": -1, "cr": -1, "cr_mdrive": -1, "overlap": -1}
"""Open-loop metrics, with 1 where more is better; the paper's figure has AP50 and ADE."""
CLOSED_METRICS = ("ds", "sr")
MIN_AGENTS = 3
"""Least number of agents for a correlation: two are always in one order or the other."""
MIN_DEFINED_SHARE = 0.5
"""Least share of the resamples in which a correlation exists, i.e. not all agents are tied, for an interval."""


def resample_metric(recordings: Sequence[OpenLoopScenario], metric: str, counts: Counts) -> Float:
    """Return an open-loop metric (R,) where recording j counts `counts[r, j]` times; NaN where it is undefined.

    As in `combine_metrics`, each frame has the same weight; for the collision rate `cr` each recording.
    """
    if metric == "ap50":
        chunks = [counts[place : place + CHUNK] for place in range(0, len(counts), CHUNK)]
        return np.concatenate([100.0 * _compute_precision(recordings, chunk) for chunk in chunks])
    values = [getattr(recording, metric) for recording in recordings]
    frames = [1 if metric == "cr" else recording.frames for recording in recordings]
    weights = np.array([0 if value is None else count for value, count in zip(values, frames, strict=True)])
    defined = np.array([0.0 if value is None else value for value in values])
    sums = sum_resamples(counts, np.stack((weights * defined, weights), axis=-1))
    return _divide(sums[:, 0], sums[:, 1])


def _compute_precision(recordings: Sequence[OpenLoopScenario], counts: Counts) -> Float:
    """Return average precision in [0, 1] (R,): area under the interpolated curve of precision over recall."""
    tables = [recording.count_detections() for recording in recordings]
    scores = sorted({score for table in tables for score in table.by_score}, reverse=True)
    cells = np.array([[table.by_score.get(score, (0, 0)) for score in scores] for table in tables], dtype=float)
    if not scores:
        return np.full(len(counts), np.nan)
    sums = sum_resamples(counts, cells)
    matched, accepted = (np.cumsum(sums[:, :, part], axis=1) for part in (0, 1))
    truths = sum_resamples(counts, np.array([table.truths for table in tables], dtype=float))
    recall = _divide(
        np.pad(matched, ((0, 0), (1, 0))), np.broadcast_to(truths[:, None], (len(counts), len(scores) + 1))
    )
    precision = np.nan_to_num(_divide(matched, accepted))
    best_after = np.maximum.accumulate(precision[:, ::-1], axis=1)[:, ::-1]
    return (np.diff(recall, axis=1) * best_after).sum(axis=1)


def _divide(numerator: Float, denominator: Float) -> Float:
    """Return the quotient; NaN where the denominator is 0."""
    return np.divide(numerator, denominator, out=np.full(numerator.shape, np.nan), where=denominator > 0)


@dataclass(frozen=True, slots=True)
class OpenClosedLine:
    """One agent in both loops, over the same recordings and scenarios."""

    agent: str
    open: OpenLoopMetrics
    ds: float
    sr: float
    is_reference: bool
    """Whether open loop compares the agent with its own drives."""


@dataclass(frozen=True, slots=True)
class RankCorrelation:
    """Correlation of an open-loop metric with a closed-loop score over the agents that have both."""

    metric: str
    score: str
    agents: tuple[str, ...]
    spearman: ConfidenceInterval | None
    """+1: what is better in open loop is better in closed loop. None: too few agents, or all are tied."""
    kendall: ConfidenceInterval | None


@dataclass(frozen=True, slots=True)
class OpenClosedComparison:
    """The numbers of RQ3."""

    scenarios: int
    """Different scenarios that every agent has in both loops, none void."""
    lines: tuple[OpenClosedLine, ...]
    correlations: tuple[RankCorrelation, ...]


def compare_open_with_closed(
    opened: Mapping[str, OpenLoopResults], closed: Mapping[str, Results]
) -> OpenClosedComparison:
    """Return every agent's metrics in both loops, and the rank correlations between them.

    opened, closed: by agent, of the same agents; only episodes that all have in both loops count. The reference is in
    no correlation, because it is compared with its own drives.
    """
    shown = {name: {result.key: result for result in results.scenarios} for name, results in opened.items()}
    driven = {
        name: {result.key: result for result in closed[name].scenarios if result.status == "ok"} for name in opened
    }  # void episodes have no score
    first = next(iter(shown.values()), {})
    keys = [key for key in first if all(key in table[name] for table in (shown, driven) for name in opened)]
    if not keys:
        return OpenClosedComparison(0, (), ())
    lines = tuple(_make_line(name, keys, shown[name], driven[name]) for name in opened)
    labels = [next(iter(driven.values()))[key].label for key in keys]
    correlations = [
        result for metric in OPEN_METRICS for result in _correlate(metric, lines, shown, driven, keys, labels)
    ]
    return OpenClosedComparison(len({name for name, _ in keys}), lines, tuple(correlations))


def _make_line(
    agent: str,
    keys: Sequence[EpisodeKey],
    shown: Mapping[EpisodeKey, OpenLoopScenario],
    driven: Mapping[EpisodeKey, ScenarioResult],
) -> OpenClosedLine:
    ds, sr = (float(np.mean([getattr(driven[key], score) for key in keys])) for score in CLOSED_METRICS)
    return OpenClosedLine(agent, combine_metrics([shown[key] for key in keys]), ds, sr, agent == REFERENCE)


def _correlate(
    metric: str,
    lines: Sequence[OpenClosedLine],
    shown: Mapping[str, Mapping[EpisodeKey, OpenLoopScenario]],
    driven: Mapping[str, Mapping[EpisodeKey, ScenarioResult]],
    keys: Sequence[EpisodeKey],
    labels: Sequence[Label],
) -> Iterator[RankCorrelation]:
    """Yield the correlation of an open-loop metric with each closed-loop score."""
    compared = [line for line in lines if not line.is_reference and getattr(line.open, metric) is not None]
    agents = tuple(line.agent for line in compared)
    if len(agents) < MIN_AGENTS:
        yield from (RankCorrelation(metric, score, agents, None, None) for score in CLOSED_METRICS)
        return
    counts = draw_nested_counts(labels)
    opened = [resample_metric([shown[agent][key] for key in keys], metric, counts) for agent in agents]
    x = OPEN_METRICS[metric] * np.stack(opened, axis=-1)
    usable = ~np.isnan(x).any(axis=-1)  # a resample may lack all recordings in which an agent has a plan
    for score in CLOSED_METRICS:
        closed = np.array([[getattr(driven[agent][key], score) for agent in agents] for key in keys])
        rho, tau = correlate_ranks(x[usable], closed, counts[usable], labels)
        yield RankCorrelation(metric, score, agents, rho, tau)


def correlate_ranks(
    x: Float, scores: Float, counts: Counts, labels: Sequence[Label]
) -> tuple[ConfidenceInterval | None, ConfidenceInterval | None]:
    """Return Spearman's and Kendall's correlation over agents with their intervals; None where they are undefined.

    x: (R, N) what N agents have in each resample, the sample itself first. scores: (M, N) of M episodes. counts:
    (R, M) how often an episode counts. labels: of the episodes.
    """
    y = sum_resamples(counts, scores) / counts.sum(axis=1, keepdims=True)
    rho, tau = (_summarize(correlate(x, y), labels) for correlate in (compute_spearman, compute_kendall))
    return rho, tau


def _summarize(values: Float, labels: Sequence[Label]) -> ConfidenceInterval | None:
    """Return the first value with the interval of the others; None if it or most of the others are undefined."""
    defined = values[1:][~np.isnan(values[1:])]
    if not len(values) or np.isnan(values[0]) or len(defined) < MIN_DEFINED_SHARE * RESAMPLES:
        return None
    return make_interval(float(values[0]), defined, len({label[0] for label in labels}), count_effective(labels))
