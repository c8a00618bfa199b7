"""The format of `open_loop.json`."""

import math
from collections.abc import Sequence
from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from mdrive_sumo.contract import TrackName, join_sensing_tracks
from mdrive_sumo.core.setting import Scalar
from mdrive_sumo.open_loop.detection_precision import DetectionCounts, compute_average_precision
from mdrive_sumo.open_loop.drive_open_loop import OpenLoopSamples
from mdrive_sumo.scoring.results import EpisodeKey
from mdrive_sumo.scoring.summary import compute_mean_of_known

FORMAT = "mdrive-sumo/open-loop/1"
Number = Annotated[float, AfterValidator(lambda value: round(value, 6) + 0.0)]


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class OpenLoopMetrics(_Part):
    """Metrics over scored frames; null where there is none."""

    ap50: Number | None
    """Average precision at an intersection over union of 0.5, in percent."""
    ade: Number | None
    """[m]"""
    fde: Number | None
    """[m]"""
    cr: Number | None
    """Share of the scenarios in percent with a frame in which TTC < 0.9 s and lateral < 3.5 m."""
    cr_frames: Number | None
    """Share of such frames in percent."""
    cr_mdrive: Number | None
    """Share of the frames in percent that the original's rule flags."""
    overlap: Number | None
    """Share of the frames in percent whose plan overlaps another box."""
    frames: int
    """Frames with a scored plan."""
    detections: int
    truths: int


class OpenLoopScenario(OpenLoopMetrics):
    """One recording."""

    id: str
    bucket: str
    category: str
    seed: int
    skipped: dict[str, int]
    """Number of replies without a score, by reason."""
    failures: dict[str, str]
    """Why agents failed, by CAV."""
    sensing_track: TrackName = Field(default="", exclude_if=lambda track: not track)
    """Sensing track of the scenario, as in `results.json`."""
    digest: str
    """Digest of the recording."""
    precision_counts: tuple[tuple[float, int, int], ...] | None
    """Score, number of true detections and number of detections with that score; null if no agent replied any."""

    @property
    def key(self) -> EpisodeKey:
        """What the recording is found by in its run."""
        return self.id, self.seed

    def count_detections(self) -> DetectionCounts:
        """Return the counts that average precision follows from."""
        rows = self.precision_counts or ()
        return DetectionCounts(self.truths, {round(1000 * score): (true, count) for score, true, count in rows})


class OpenLoopRunInfo(_Part):
    """What was compared with what."""

    agent: str
    labels: tuple[str, ...] = ()
    """Such as "privileged" or "unsandboxed", as in `results.json`."""
    sensing_track: TrackName = Field(default="", exclude_if=lambda track: not track)
    """sensor or object, as in `results.json`; follows from the scenarios."""
    agent_config: str
    suite: str
    suite_checksum: str
    seeds: tuple[int, ...]
    reference: str
    """What drove: an agent, or "log"."""
    versions: dict[str, str]
    options: dict[str, Scalar]
    """Channel, sensing and so on, as in the journal of a run."""


class OpenLoopResults(_Part):
    """The whole file."""

    format: Literal["mdrive-sumo/open-loop/1"] = FORMAT
    run: OpenLoopRunInfo
    overall: OpenLoopMetrics
    buckets: dict[str, OpenLoopMetrics]
    scenarios: tuple[OpenLoopScenario, ...]


def compute_metrics(samples: OpenLoopSamples) -> OpenLoopMetrics:
    """Return the metrics of one recording."""
    errors, counts = samples.errors, samples.detections
    return OpenLoopMetrics(
        ap50=_compute_ap50(counts),
        ade=compute_mean_of_known(one.ade for one in errors),
        fde=compute_mean_of_known(one.fde for one in errors),
        cr=100.0 * any(one.near for one in errors) if errors else None,
        cr_frames=compute_mean_of_known(100.0 * one.near for one in errors),
        cr_mdrive=compute_mean_of_known(100.0 * one.near_mdrive for one in errors),
        overlap=compute_mean_of_known(100.0 * one.overlaps for one in errors),
        frames=len(errors),
        detections=counts.detections if counts else 0,
        truths=counts.truths if counts else 0,
    )


def summarize_open_loop(run: OpenLoopRunInfo, scenarios: Sequence[OpenLoopScenario]) -> OpenLoopResults:
    """Return the results of all recordings; means over frames, the collision rate CR over scenarios."""
    buckets = dict.fromkeys(sorted(scenario.bucket for scenario in scenarios))
    track = join_sensing_tracks(scenario.sensing_track for scenario in scenarios)
    return OpenLoopResults(
        run=run.model_copy(update={"sensing_track": track}),
        overall=combine_metrics(scenarios),
        buckets={name: combine_metrics([one for one in scenarios if one.bucket == name]) for name in buckets},
        scenarios=tuple(scenarios),
    )


def combine_metrics(scenarios: Sequence[OpenLoopScenario]) -> OpenLoopMetrics:
    """Return the metrics of several recordings: each frame has the same weight, and for CR each recording."""
    counts = DetectionCounts()
    for scenario in scenarios:
        counts.add(scenario.count_detections())
    means = {name: _mean_over_frames(scenarios, name) for name in ("ade", "fde", "cr_frames", "cr_mdrive", "overlap")}
    return OpenLoopMetrics(
        ap50=_compute_ap50(counts if any(one.precision_counts is not None for one in scenarios) else None),
        cr=compute_mean_of_known(one.cr for one in scenarios),
        frames=sum(one.frames for one in scenarios),
        detections=counts.detections,
        truths=counts.truths,
        **means,
    )


def _mean_over_frames(scenarios: Sequence[OpenLoopScenario], name: str) -> float | None:
    rows = [(getattr(one, name), one.frames) for one in scenarios if one.frames]
    frames = sum(count for _, count in rows)
    return math.fsum(value * count for value, count in rows) / frames if frames else None


def _compute_ap50(counts: DetectionCounts | None) -> float | None:
    value = compute_average_precision(counts) if counts else None
    return None if value is None else 100.0 * value
