"""Windows: a part of a long log."""

from dataclasses import replace

from mdrive_sumo.core.errors import InputError
from real2sim.recording import Recording, Track, View

Window = tuple[float, float]
"""Start and end [s] since the first frame of the log; the frames at both are part of it."""


def windowed(where: str, recording: Recording, window: Window | None) -> Recording:
    """The part of a recording within a window, without the tracks that are not there; raises InputError."""
    if window is None:
        return recording
    rows = _rows(where, recording, window)
    views = tuple(_view(view, rows) for view in recording.views)
    if not any(view.tracks for view in views):
        raise InputError(f"{where}: expected a window with at least one track, found none from {_text(window)}")
    there = {name for view in views for name in (view.observer, *(track.id for track in view.tracks))}
    cavs = tuple(cav for cav in recording.cavs if cav in there)
    return replace(recording, views=views, frames=rows.stop - rows.start, cavs=cavs)


def _rows(where: str, recording: Recording, window: Window) -> slice:
    end_s = (recording.frames - 1) * recording.dt_s
    if not 0.0 <= window[0] < window[1] <= end_s + recording.dt_s / 2:
        raise InputError(f"{where}: expected a window within 0 s to {end_s:g} s, found {_text(window)}")
    first, last = (round(time / recording.dt_s) for time in window)
    return slice(first, last + 1)


def _text(window: Window) -> str:
    return f"{window[0]:g} s to {window[1]:g} s"


def _view(view: View, rows: slice) -> View:
    tracks = (_track(track, rows) for track in view.tracks)
    return replace(view, tracks=tuple(track for track in tracks if track.valid.any()), pose=view.pose[rows])


def _track(track: Track, rows: slice) -> Track:
    columns = ("valid", "x", "y", "yaw", "length", "width")
    return track.with_rows(**{name: getattr(track, name)[rows] for name in columns})
