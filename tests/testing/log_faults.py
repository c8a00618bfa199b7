"""Faults planted into made-up logs.

Each `plant_*` function takes a log and returns it with some faults and the list of what was planted, so that a test can
look at each one after cleaning.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mdrive_sumo.core.geometry import wrap_angles
from real2sim.recording import ObjectCategory, ObserverView, RecordedTrack
from testing.log_truth import Log


@dataclass(frozen=True)
class Fault:
    """What was planted: the kind, which true thing, which frames, in which view."""

    kind: str
    thing: int
    frames: tuple[int, ...]
    observer: str


def with_tracks(log: Log, observer: int, tracks: Sequence[RecordedTrack]) -> Log:
    views = list(log.recording.views)
    views[observer] = replace(views[observer], tracks=tuple(tracks))
    return replace(log, recording=replace(log.recording, views=tuple(views)))


def without(track: RecordedTrack, frames: np.ndarray) -> RecordedTrack:
    """The track, not there in some frames."""
    gone = np.zeros(len(track.x), dtype=np.bool_)
    gone[frames] = True
    hidden = {name: np.where(gone, np.nan, getattr(track, name)) for name in ("x", "y", "yaw", "length", "width")}
    return replace(track, valid=track.valid & ~gone, **hidden)


def number_of(track: RecordedTrack) -> int:
    return int(track.id) - 100


Planted = tuple[Log, list[Fault]]
Avoid = frozenset[int]
NOTHING: Avoid = frozenset()


def picked(
    log: Log, rng: np.random.Generator, count: int, suits: Callable[[RecordedTrack], bool], avoid: Avoid
) -> list[tuple[int, int]]:
    """(view, track) of some different true things that suit."""
    found = [
        (v, t)
        for v, view in enumerate(log.recording.views)
        for t, track in enumerate(view.tracks)
        if number_of(track) < len(log.truth) and number_of(track) not in avoid and suits(track)
    ]
    rng.shuffle(found)
    chosen: dict[str, tuple[int, int]] = {}
    for v, t in found:
        chosen.setdefault(log.recording.views[v].tracks[t].id, (int(v), int(t)))
    return list(chosen.values())[:count]


def plant_duplicates(log: Log, seed: int, avoid: Avoid = NOTHING, count: int = 5) -> Planted:
    """A second track of the same thing under another name, a little beside it, for a part of the time."""
    rng = np.random.default_rng(seed)
    faults: list[Fault] = []
    for v, t in picked(log, rng, count, lambda track: track.valid.sum() > 40, avoid):
        view = log.recording.views[v]
        track = view.tracks[t]
        frames = track.valid_frames[: int(rng.integers(20, track.valid.sum()))]
        off = rng.normal(0, 0.08, 2) if track.category is ObjectCategory.PEDESTRIAN else rng.normal(0, 0.2, 2)
        copy = without(track, np.setdiff1d(np.arange(len(track.x)), frames))
        copy = replace(copy, id=f"{9000 + len(faults)}", x=copy.x + off[0], y=copy.y + off[1])
        log = with_tracks(log, v, [*view.tracks, copy])
        faults.append(Fault("duplicate", number_of(track), tuple(frames.tolist()), view.observer))
    return log, faults


def plant_id_flips(log: Log, seed: int, avoid: Avoid = NOTHING, count: int = 5) -> Planted:
    """From one frame on two things of one observer have each other's names."""
    rng = np.random.default_rng(seed)
    faults: list[Fault] = []
    used: set[str] = set()
    for v, t in picked(log, rng, 10 * count, lambda track: track.valid.all(), avoid):
        view = log.recording.views[v]
        a = view.tracks[t]
        frame = int(rng.integers(15, len(a.x) - 15))
        others = [b for b in view.tracks if b.valid.all() and b.category is a.category and b.id not in used | {a.id}]
        others = [b for b in others if number_of(b) < len(log.truth) and number_of(b) not in avoid]
        far = [b for b in others if 2.0 < np.hypot(a.x[frame] - b.x[frame], a.y[frame] - b.y[frame]) < 60]
        if not far or a.id in used or len(faults) >= 2 * count:
            continue
        b = far[int(rng.integers(len(far)))]
        used |= {a.id, b.id}
        log = with_tracks(log, v, [swapped(track, a, b, frame) for track in view.tracks])
        rest = tuple(range(frame, len(a.x)))
        faults += [Fault("id flip", number_of(thing), rest, view.observer) for thing in (a, b)]
    return log, faults


def swapped(track: RecordedTrack, a: RecordedTrack, b: RecordedTrack, frame: int) -> RecordedTrack:
    if track.id not in (a.id, b.id):
        return track
    other = b if track.id == a.id else a
    later = np.arange(len(track.x)) >= frame
    columns = {
        name: np.where(later, getattr(other, name), getattr(track, name))
        for name in ("x", "y", "yaw", "length", "width")
    }
    return replace(track, **columns)


def plant_jumps(log: Log, seed: int, avoid: Avoid = NOTHING, count: int = 6, longest: int = 8) -> Planted:
    """For some frames a thing is 2 m (to 3 m) elsewhere, for one observer."""
    rng = np.random.default_rng(seed)
    faults: list[Fault] = []
    for v, t in picked(log, rng, count, lambda track: track.valid.all(), avoid):
        view = log.recording.views[v]
        track = view.tracks[t]
        begin = int(rng.integers(12, len(track.x) - 25))
        frames = np.arange(begin, begin + int(rng.integers(1, longest + 1)))
        angle, size = rng.uniform(-np.pi, np.pi), rng.uniform(2, 3)
        x, y = track.x.copy(), track.y.copy()
        x[frames] += size * np.cos(angle)
        y[frames] += size * np.sin(angle)
        log = with_tracks(
            log, v, [replace(track, x=x, y=y) if n == t else other for n, other in enumerate(view.tracks)]
        )
        faults.append(Fault("jump", number_of(track), tuple(frames.tolist()), view.observer))
    return log, faults


def plant_ego_ghosts(log: Log, seed: int, avoid: Avoid = NOTHING) -> Planted:
    """A CAV lists itself as another vehicle."""
    rng = np.random.default_rng(seed)
    faults: list[Fault] = []
    for v, view in enumerate(log.recording.views):
        own = [thing for thing in log.truth if len(view.pose) and not view.is_infrastructure and is_own(thing, view)]
        for thing in own:
            off = rng.normal(0, 0.15, 2)
            ghost = replace(thing, id=f"{8000 + v}", x=thing.x + off[0], y=thing.y + off[1])
            log = with_tracks(log, v, [*view.tracks, ghost])
            faults.append(Fault("ego ghost", number_of(thing), tuple(range(len(thing.x))), view.observer))
    return log, faults


def is_own(thing: RecordedTrack, view: ObserverView) -> bool:
    away = np.hypot(thing.x - view.pose[:, 0], thing.y - view.pose[:, 1])
    return bool(np.median(away) < 1.0)


def plant_headings(log: Log, seed: int, avoid: Avoid = NOTHING, count: int = 6) -> Planted:
    """Boxes look backwards for some frames."""
    rng = np.random.default_rng(seed)
    faults: list[Fault] = []
    for v, t in picked(
        log, rng, count, lambda track: track.valid.all() and track.category is not ObjectCategory.PEDESTRIAN, avoid
    ):
        view = log.recording.views[v]
        track = view.tracks[t]
        begin = int(rng.integers(0, len(track.x) - 40))
        frames = np.arange(begin, begin + int(rng.integers(1, 40)))
        yaw = track.yaw.copy()
        yaw[frames] = wrap_angles(yaw[frames] + np.pi)
        log = with_tracks(log, v, [replace(track, yaw=yaw) if n == t else other for n, other in enumerate(view.tracks)])
        faults.append(Fault("heading", number_of(track), tuple(frames.tolist()), view.observer))
    return log, faults


def plant_gaps(log: Log, seed: int, avoid: Avoid = NOTHING, count: int = 6, longest: int = 15) -> Planted:
    """For some frames no observer sees a road user."""
    rng = np.random.default_rng(seed)
    faults: list[Fault] = []
    everywhere = {log.truth[n].id for n in range(len(log.truth)) if n not in (0, 7)}
    for v, t in picked(log, rng, count, lambda track: bool(track.valid.all()) and track.id in everywhere, avoid):
        track = log.recording.views[v].tracks[t]
        begin = int(rng.integers(12, len(track.x) - 12 - longest))
        frames = np.arange(begin, begin + int(rng.integers(1, longest + 1)))
        for w, view in enumerate(log.recording.views):
            tracks = [without(other, frames) if other.id == track.id else other for other in view.tracks]
            log = with_tracks(log, w, tracks)
        faults.append(Fault("gap", number_of(track), tuple(frames.tolist()), "all"))
    return log, faults


PLANTS: dict[str, Callable[[Log, int, Avoid], Planted]] = {
    "duplicate": plant_duplicates,
    "id flip": plant_id_flips,
    "jump": plant_jumps,
    "ego ghost": plant_ego_ghosts,
    "heading": plant_headings,
    "gap": plant_gaps,
}


def tracks_of(tracks: Sequence[RecordedTrack], thing: RecordedTrack) -> list[RecordedTrack]:
    """All tracks of the result that lie on a true thing."""
    reach = 0.4 if thing.category is ObjectCategory.PEDESTRIAN else 1.0
    found: list[RecordedTrack] = []
    for track in tracks:
        both = track.valid & thing.valid
        if both.any() and np.median(np.hypot(track.x - thing.x, track.y - thing.y)[both]) < reach:
            found.append(track)
    return found


def planted(log: Log, seed: int, kinds: Sequence[str] = tuple(PLANTS)) -> tuple[Log, list[Fault]]:
    """The log with faults of all kinds, each thing with one kind only: else one may hide the other."""
    faults: list[Fault] = []
    for number, kind in enumerate(kinds):
        log, more = PLANTS[kind](log, 100 * seed + number, frozenset(fault.thing for fault in faults))
        faults += more
    return log, faults
