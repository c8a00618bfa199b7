"""Crop a recording to a time window."""

from dataclasses import replace

from mdrive_sumo.core.errors import InputError
from real2sim.recording import ObserverView, RecordedTrack, Recording

TimeWindow = tuple[float, float]
"""Start and end [s] since the first frame of the log, both inclusive."""


def crop_recording(where: str, recording: Recording, window: TimeWindow | None) -> Recording:
    """Return the part of a recording within a window, without absent tracks; raise InputError."""
    if window is None:
        return recording
    rows = _select_frames(where, recording, window)
    views = tuple(_crop_view(view, rows) for view in recording.views)
    if not any(view.tracks for view in views):
        raise InputError(
            f"{where}: expected a window with at least one track, found none from {_format_window(window)}"
        )
    there = {name for view in views for name in (view.observer, *(track.id for track in view.tracks))}
    cavs = tuple(cav for cav in recording.cavs if cav in there)
    return replace(recording, views=views, frame_count=rows.stop - rows.start, cavs=cavs)


def _select_frames(where: str, recording: Recording, window: TimeWindow) -> slice:
    end_s = (recording.frame_count - 1) * recording.dt_s
    if not 0.0 <= window[0] < window[1] <= end_s + recording.dt_s / 2:
        raise InputError(f"{where}: expected a window within 0 s to {end_s:g} s, found {_format_window(window)}")
    first, last = (round(time / recording.dt_s) for time in window)
    return slice(first, last + 1)


def _format_window(window: TimeWindow) -> str:
    return f"{window[0]:g} s to {window[1]:g} s"


def _crop_view(view: ObserverView, rows: slice) -> ObserverView:
    tracks = (_crop_track(track, rows) for track in view.tracks)
    return replace(view, tracks=tuple(track for track in tracks if track.valid.any()), pose=view.pose[rows])


def _crop_track(track: RecordedTrack, rows: slice) -> RecordedTrack:
    columns = ("valid", "x", "y", "yaw", "length", "width")
    return track.replace_columns(**{name: getattr(track, name)[rows] for name in columns})
