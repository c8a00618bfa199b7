"""What became of a known scene that was written as a V2XPnP log, read, cleaned and reconstructed."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from mdrive_sumo.core.geometry import Bool, Float
from mdrive_sumo.core.state import Kind
from real2sim.clean import CleanedRecording, clean_recording
from real2sim.readers.v2xpnp import read_v2xpnp
from real2sim.recording import ObjectCategory, ObserverView, RecordedTrack, Recording
from real2sim.tracks.reconstruct import reconstruct_tracks
from real2sim.tracks.stationary import has_moved
from real2sim.writers.observation_noise import ObservationNoise, assign_numbers, simulate_observers
from real2sim.writers.v2xpnp import write_views

NEAR_M = 1.0
"""A track whose median distance from a thing is less lies on it; of walkers `WALKER_M`."""
WALKER_M = 0.6
COVERED = 0.9
LONG_FRAMES = 10
"""A road user seen by any observer in fewer frames was not visible long enough."""
USUAL = ObservationNoise()


@dataclass(frozen=True)
class Trip:
    """There and back. `truth` has the numbers of the files as ids."""

    truth: tuple[RecordedTrack, ...]
    seen: dict[str, Bool]
    """Of every thing, in which frames anybody noted it (T,)."""
    read: Recording
    cleaned: CleanedRecording
    tracks: tuple[RecordedTrack, ...]

    @cached_property
    def owners(self) -> dict[str, str]:
        """Track of the result -> the thing that it lies on: the nearest one, if it is near."""
        found: dict[str, str] = {}
        for track in self.tracks:
            gaps = {thing.id: apart_m(track, thing) / reach_m(thing) for thing in self.truth}
            nearest = min(gaps, key=gaps.__getitem__)
            if gaps[nearest] < 1.0:
                found[track.id] = nearest
        return found

    def on(self, thing: RecordedTrack) -> list[RecordedTrack]:
        """Tracks of the result that lie on a thing."""
        return [track for track in self.tracks if self.owners.get(track.id) == thing.id]

    @property
    def visible(self) -> list[RecordedTrack]:
        """Vehicles that move and were seen long enough."""
        moving = (thing for thing in self.truth if thing.category.kind is Kind.VEHICLE and not thing.parked)
        return [thing for thing in moving if self.seen[thing.id].sum() >= LONG_FRAMES]

    @property
    def found(self) -> list[tuple[RecordedTrack, RecordedTrack]]:
        """Visible vehicles with one track alone that covers nine tenths of the frames in which they were seen."""
        pairs: list[tuple[RecordedTrack, RecordedTrack]] = []
        for thing in self.visible:
            on, seen = self.on(thing), self.seen[thing.id]
            if len(on) == 1 and (on[0].valid & seen).sum() >= COVERED * seen.sum():
                pairs.append((thing, on[0]))
        return pairs

    @property
    def missing(self) -> list[str]:
        """Visible vehicles that were not found."""
        there = {thing.id for thing, _ in self.found}
        return [thing.id for thing in self.visible if thing.id not in there]

    @property
    def ghosts(self) -> list[str]:
        """Tracks of the result that lie on nothing."""
        return [track.id for track in self.tracks if track.id not in self.owners]

    @property
    def duplicates(self) -> list[str]:
        """Things on which several tracks lie at the same time."""
        tracks = {thing.id: self.on(thing) for thing in self.truth}
        return [name for name, on in tracks.items() if on and np.sum([track.valid for track in on], axis=0).max() > 1]

    @property
    def errors(self) -> Float:
        """Distances [m] of found vehicles from the truth, in all frames in which they were seen."""
        gaps = [np.hypot(*(a.xy - b.xy).T)[b.valid & self.seen[a.id]] for a, b in self.found]
        return np.concatenate(gaps) if gaps else np.zeros(0)


def apart_m(track: RecordedTrack, thing: RecordedTrack) -> float:
    """Median distance [m] while both are there; infinite if they never are."""
    both = track.valid & thing.valid
    return float(np.median(np.hypot(*(track.xy - thing.xy)[both].T))) if both.any() else np.inf


def reach_m(thing: RecordedTrack) -> float:
    return WALKER_M if thing.category is ObjectCategory.PEDESTRIAN else NEAR_M


def there_and_back(
    truth: Recording, folder: Path, map_file: Path | None = None, noise: ObservationNoise | None = USUAL, seed: int = 0
) -> Trip:
    """Writes the log of a known scene (see `simulate_observers`), and makes tracks of it again."""
    views = simulate_observers(truth, noise, seed)
    write_views(views, folder)
    names = assign_numbers(truth)
    things = tuple(replace(track, id=names[track.id]) for track in truth.views[0].tracks)
    carried = {names[cav] for cav in truth.cavs}
    read = read_v2xpnp(folder, (map_file,) if map_file else ())
    cleaned = clean_recording(read)
    seen = {thing.id: _seen(views.views, thing, carried) for thing in things}
    return Trip(things, seen, read, cleaned, reconstruct_tracks(cleaned.tracks, read.dt_s))


def _seen(views: Sequence[ObserverView], thing: RecordedTrack, carried: set[str]) -> Bool:
    """(T,) whether any observer recorded it; an observer knows itself."""
    noted = [track.valid for view in views for track in view.tracks if track.id == thing.id]
    return np.any([*noted, np.full(len(thing.x), thing.id in carried)], axis=0)


def windowed(recording: Recording, frames: slice) -> Recording:
    """Some frames of a log."""

    def cut(track: RecordedTrack) -> RecordedTrack:
        columns = ("valid", "x", "y", "yaw", "length", "width")
        return track.replace_columns(**{name: getattr(track, name)[frames] for name in columns})

    views = tuple(
        replace(view, tracks=tuple(k for track in view.tracks if (k := cut(track)).valid.any()), pose=view.pose[frames])
        for view in recording.views
    )
    return replace(recording, frame_count=len(range(recording.frame_count)[frames]), views=views)


def as_truth(recording: Recording, stations: int = 2) -> Recording:
    """A log as a known scene: its cleaned, smooth tracks, two of them CAVs, and stations in its midst."""
    cleaned = clean_recording(recording)
    tracks = reconstruct_tracks(cleaned.tracks, recording.dt_s)
    tracks = tuple(replace(track, parked=not has_moved(track, recording.dt_s)) for track in tracks)
    whole = [t for t in tracks if t.valid.all() and t.category.kind is Kind.VEHICLE and np.nanmedian(t.length) < 6.5]
    movers = sorted(whole, key=lambda t: -float(np.ptp(t.xy, axis=0).max()))[:2]
    middle = np.nanmedian(np.concatenate([t.xy for t in tracks]), axis=0)
    posts = [
        ObserverView(f"post{n}", (), np.tile((*(middle + 20.0 * n), 0.0), (recording.frame_count, 1)), True)
        for n in range(stations)
    ]
    return replace(recording, dt_s=0.1, views=(ObserverView("log", tracks), *posts), cavs=tuple(t.id for t in movers))


def motions_of(tracks: Sequence[RecordedTrack]) -> list[Float]:
    """Poses (T, 3) of the vehicles that are not parked."""
    moving = (track for track in tracks if track.category.kind is Kind.VEHICLE and not track.parked)
    return [np.column_stack((track.x, track.y, track.yaw)) for track in moving]
