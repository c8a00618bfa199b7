"""Things that appear inside others begin later, shrink, or go: each with an entry in the report."""

from dataclasses import replace

import numpy as np
from testing.log_truth import DT, made

from mdrive_sumo.core.geometry import Float
from real2sim.clean import clean_recording
from real2sim.clean.cleaning_report import ChangeReason, TrackChange
from real2sim.clean.overlap_resolution import resolve_overlaps
from real2sim.hd_map import HdMap
from real2sim.recording import ObjectCategory, ObserverView, RecordedTrack, Recording
from real2sim.tracks.reconstruct import reconstruct_tracks
from real2sim.tracks.track_contacts import find_contacts

T = np.arange(60) * DT
HERE = np.zeros(60)


def car(number: int, x: Float, y: float = 0.0, category: ObjectCategory = ObjectCategory.CAR) -> RecordedTrack:
    return made(number, category, (x, HERE + y, HERE.copy()))


def late(track: RecordedTrack, frame: int) -> RecordedTrack:
    valid = np.arange(60) >= frame
    columns = {name: np.where(valid, getattr(track, name), np.nan) for name in ("x", "y", "yaw", "length", "width")}
    return replace(track, valid=valid, **columns)


def settled(
    *tracks: RecordedTrack, cavs: tuple[str, ...] = ()
) -> tuple[tuple[RecordedTrack, ...], tuple[TrackChange, ...]]:
    kept, changes = resolve_overlaps(tracks, cavs, DT)
    assert find_contacts(reconstruct_tracks(kept, DT), 0.1).spawn_overlaps == ()
    return kept, changes


def test_objects_without_overlap_are_unchanged() -> None:
    tracks = (car(0, 8 * T), car(1, 8 * T + 6.0), replace(car(2, HERE, 3.0), parked=True))
    assert settled(*tracks) == (tracks, ())


def test_a_track_that_is_badly_seen_at_first_begins_later() -> None:
    second = late(car(1, 8 * T + np.clip(3.0 + 6.0 * (T - 2.2), 3.0, 9.0)), 20)
    (_, kept), changes = settled(car(0, 8 * T), second)
    assert {(change.reason, change.track) for change in changes} == {(ChangeReason.OVERLAP, second.id)}
    assert kept.valid_frames[0] == 20 + sum(change.frames for change in changes)
    assert 22 < kept.valid_frames[0] <= 33


def test_boxes_a_little_too_large_become_smaller() -> None:
    parked = [replace(car(n, HERE + 4.3 * n), parked=True) for n in (0, 1)]
    kept, (change,) = settled(*parked)
    assert change.reason is ChangeReason.OVERLAP
    assert "95%" in change.detail
    assert np.allclose([track.length[0] for track in kept], 0.95 * 4.6)


def test_a_track_inside_another_is_dropped_with_a_reason() -> None:
    ghost = late(car(1, 8 * T + 1.5, 0.3), 10)
    (kept,), (change,) = settled(car(0, 8 * T), ghost)
    assert kept.id == "100"
    assert (change.reason, change.track, change.frames) == (ChangeReason.INSIDE, ghost.id, 50)


def test_a_connected_vehicle_stays_whichever_came_first() -> None:
    cav = late(car(1, 8 * T + 1.5, 0.3), 10)
    (kept,), (change,) = settled(car(0, 8 * T), cav, cavs=(cav.id,))
    assert kept.id == cav.id
    assert change.track == "100"


def test_cleaning_reports_overlaps_and_dropped_tracks() -> None:
    walker = made(1, ObjectCategory.PEDESTRIAN, (8 * T + 0.5, HERE, HERE))
    view = ObserverView("log", (car(0, 8 * T), walker))
    cleaned = clean_recording(Recording("made", "made", DT, 60, (view,), HdMap()))
    assert [track.id for track in cleaned.tracks] == ["100"]
    assert cleaned.report.drop_reason_by_track == {"101": "overlaps 100 in 60 of 60 frames: left out"}
