"""The figures of issue C on every real log, and on INTERACTION in windows of 20 s over the whole recording."""

from collections.abc import Callable
from functools import cache, partial
from pathlib import Path

import pytest
from testing.real_logs import READ, SHORT_LOGS, read_window
from testing.sampling import sampled

from real2sim.clean import clean_recording
from real2sim.hd_map import LaneKind
from real2sim.quality import ReconstructedLog, ReconstructionQuality, assess_reconstruction
from real2sim.quality.lane_segment_index import LaneSegmentIndex
from real2sim.recording import Recording
from real2sim.tracks.reconstruct import reconstruct_tracks

READERS: dict[str, Callable[[], Recording]] = {
    **{name: READ[name] for name in SHORT_LOGS},
    **{f"interaction-{start}": partial(read_window, start) for start in range(0, 300, 20)},
}
SAMPLE = ("peach", "interaction-260")


@cache
def converted(name: str) -> tuple[ReconstructionQuality, Recording]:
    recording = READERS[name]()
    cleaned = clean_recording(recording)
    tracks = reconstruct_tracks(cleaned.tracks, cleaned.dt_s)
    raw = {track.id: track for track in cleaned.tracks}
    driving = [lane for lane in recording.map.lanes.values() if lane.kind is LaneKind.DRIVING]
    lanes = LaneSegmentIndex.from_centre_lines(
        [lane.centre for lane in driving], [lane.directed for lane in driving], [lane.width for lane in driving]
    )
    return assess_reconstruction(
        ReconstructedLog(name, cleaned.dt_s, tracks, raw, lanes, cleaned.report.drop_reason_by_track)
    ), recording


@pytest.mark.slow
@pytest.mark.parametrize("name", sampled(READERS, SAMPLE))
def test_the_figures_of_the_issue_hold(name: str, shared_data: Path) -> None:
    quality, _ = converted(name)
    assert quality.moving_vehicles >= 3
    assert quality.moving_passed_share >= 0.95, quality.failures
    assert quality.error_median is not None and quality.error_median <= 0.3
    assert quality.error_p95 is not None and quality.error_p95 <= 1.0
    assert (quality.wrong_way_frames, quality.teleports) == (0, 0)
    assert (quality.spawn_overlaps, quality.duplicates) == ((), ())
    assert quality.jerk_p95 <= 5.0


@pytest.mark.parametrize("name", sampled(READERS, SAMPLE))
def test_nothing_is_lost_without_a_reason(name: str, shared_data: Path) -> None:
    """Sources with one view name every thing once: each name is a track, part of one, or listed as lost."""
    quality, recording = converted(name)
    cleaned = clean_recording(recording)
    told = {change.track for change in cleaned.report.changes} | {actor.id for actor in quality.actors}
    details = " ".join(change.detail for change in cleaned.report.changes)
    names = {track.id for view in recording.views for track in view.tracks if track.valid.any()}
    assert [name for name in sorted(names) if name not in told and name not in details] == []
    assert all(reason for reason in quality.lost.values())
