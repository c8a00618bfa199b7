"""Put tracks that a log samples at uneven times on a grid of equal steps, and cut a recording to a window of time.

A step that is far longer than the others is a gap: frames are missing there. Every track is absent in the frames of a
gap; cleaning interpolates across gaps of at most 2 s by motion (`clean.track_joining.MAX_GAP_S`) and reports them.
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Bool, Float
from real2sim.readers.input_checks import check_frame_count
from real2sim.recording import ObserverView, RecordedTrack, Recording

GAP_STEPS = 1.5
"""A step longer than this many usual ones is a gap: at least one frame is missing."""
EXACT_STEPS = 0.1
"""A frame this near to a time of the source, in steps, has the states of that time where one beside it is missing."""
LISTED_GAPS = 8
"""At most so many gaps are named in a note: more would hide the other notes."""
TimeWindow = tuple[float, float]
"""Start and end [s] since the first frame of the log, both inclusive."""


@dataclass(frozen=True)
class TimeGrid:
    """Frames of equal steps over the times (N,) [s] of a source."""

    dt_s: float
    times: Float
    """(T,) [s] of the frames, from the first time of the source on."""
    source: Float
    """(N,) [s] times of the source, from 0 on."""
    gaps: tuple[tuple[float, float], ...]
    """Begin and end [s] of every gap."""

    @property
    def is_source(self) -> bool:
        """Whether the frames are those of the source: no gap, and no time further than half a step from its frame."""
        off = len(self.times) != len(self.source) or np.abs(self.times - self.source).max() > self.dt_s / 2
        return not self.gaps and not off

    def describe(self) -> tuple[str, ...]:
        """Return notes about gaps and a clock that is uneven."""
        if self.gaps:
            listed = ", ".join(
                f"{after - before:g} s from {before:g} s to {after:g} s" for before, after in self.gaps[:LISTED_GAPS]
            )
            more = f" and {len(self.gaps) - LISTED_GAPS} more" if len(self.gaps) > LISTED_GAPS else ""
            return (
                f"gaps in the clock of the source: {listed}{more}; resampled on its true times, frames of"
                f" {self.dt_s:g} s, nothing is observed in the gaps",
            )
        off = float(np.abs(np.diff(self.source) - self.dt_s).max())
        if not self.is_source:
            return (
                f"resampled on the true times of the source, frames of {self.dt_s:g} s;"
                f" its steps are off by up to {off:.3f} s",
            )
        return (
            (f"frames are taken as {self.dt_s:g} s apart; the clock of the source is off by up to {off:.3f} s",)
            if off > 0.1 * self.dt_s
            else ()
        )

    def resample(self, track: RecordedTrack) -> RecordedTrack:
        """Return the track in the frames of the grid, interpolated between the two times around each of them."""
        if self.is_source:
            return track
        after = np.clip(np.searchsorted(self.source, self.times), 1, len(self.source) - 1)
        before = after - 1
        step = self.source[after] - self.source[before]
        share = np.clip((self.times - self.source[before]) / step, 0.0, 1.0)
        both = track.valid[before] & track.valid[after] & (step <= GAP_STEPS * self.dt_s)
        exact = np.where(share < 0.5, before, after)
        is_exact = np.abs(self.times - self.source[exact]) <= EXACT_STEPS * self.dt_s
        valid = np.where(is_exact, track.valid[exact], both)
        yaw = _interpolate_yaw(track.yaw, before, after, share)
        columns = {name: _mix(getattr(track, name), before, after, share) for name in ("x", "y")}
        sizes = {name: getattr(track, name)[exact] for name in ("length", "width")}
        at_source = {"x": track.x[exact], "y": track.y[exact], "yaw": track.yaw[exact]}
        moved = {name: np.where(both, values, at_source[name]) for name, values in (*columns.items(), ("yaw", yaw))}
        absent = ~valid
        for values in (*moved.values(), *sizes.values()):
            values[absent] = np.nan
        return track.replace_columns(valid=valid, **moved, **sizes)


def _mix(values: Float, before: npt.NDArray[np.intp], after: npt.NDArray[np.intp], share: Float) -> Float:
    return values[before] + (values[after] - values[before]) * share


def _interpolate_yaw(yaw: Float, before: npt.NDArray[np.intp], after: npt.NDArray[np.intp], share: Float) -> Float:
    turn = np.angle(np.exp(1j * (yaw[after] - yaw[before])))
    return yaw[before] + turn * share


def build_time_grid(where: str, source: Float) -> TimeGrid:
    """Return the grid over growing times (N,) [s], N >= 2. Raises InputError for a span that is too long.

    Without gaps the step is the mean step of the source, to 1 ms; with gaps it is the median step.
    """
    source = source - source[0]
    steps = np.diff(source)
    usual = float(np.median(steps))
    long: Bool = steps > GAP_STEPS * usual
    gaps = tuple(
        (round(before, 3), round(after, 3))
        for (before, after), is_gap in zip(pairwise(source.tolist()), long.tolist(), strict=True)
        if is_gap
    )
    dt_s = round(usual if gaps else float(steps.mean()), 3)
    if not dt_s > 0:
        raise InputError(f"{where}: expected steps of at least 1 ms, found {usual:g} s")
    even = np.arange(len(source), dtype=np.float64) * dt_s
    if not gaps and np.abs(even - source).max() <= dt_s / 2:
        return TimeGrid(dt_s, even, source, ())
    count = check_frame_count(where, np.floor(float(source[-1]) / dt_s + EXACT_STEPS) + 1)
    return TimeGrid(dt_s, np.arange(count, dtype=np.float64) * dt_s, source, gaps)


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
    tracks = tuple(track.select_frames(rows) for track in view.tracks if track.valid[rows].any())
    return replace(view, tracks=tracks, pose=view.pose[rows])
