"""Cleaning: all observers' views of a log become one list of tracks, one a thing, with a report of every change."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import Kind
from real2sim.clean import track_repair as motion
from real2sim.clean.cleaning_report import Change, CleaningReport, Reason
from real2sim.clean.ego_tracks import Ego, egos_of
from real2sim.clean.object_attributes import label_of, size_of
from real2sim.clean.observer_fusion import Fused, fused, groups_of
from real2sim.clean.overlap_resolution import apart
from real2sim.clean.track_joining import LONGEST_GAP_S, joined, orphans
from real2sim.clean.track_names import named_changes, unique_names
from real2sim.clean.track_segments import Pieces, pieces_of, split
from real2sim.recording import Category, Recording, Track
from real2sim.tracks.kinematics import WINDOW
from real2sim.tracks.stationary import moves

LEAST_FRAMES = WINDOW
"""Shorter tracks have neither acceleration nor jerk (`tracks.motion`): no check could say anything about them."""


@dataclass(frozen=True)
class Cleaned:
    """One list of tracks for the whole log."""

    dt_s: float
    tracks: tuple[Track, ...]
    cavs: Mapping[str, str]
    """Connected automated vehicles: name in the recording (observer or track) -> track id."""
    report: CleaningReport
    successors: Mapping[str, frozenset[str]] = field(default_factory=dict[str, frozenset[str]])
    """Name in the source -> what the report or the tracks call the things that it showed."""


@dataclass
class _Work:
    """What is at hand while one log is cleaned."""

    recording: Recording
    pieces: Pieces
    changes: list[Change] = field(default_factory=list[Change])
    successors: dict[str, frozenset[str]] = field(default_factory=dict[str, frozenset[str]])

    def say(self, reason: Reason, track: str, frames: int, detail: str = "") -> None:
        self.changes.append(Change(reason, track, frames, detail))

    def follows(self, name: str, members: Sequence[int]) -> None:
        for id_ in {self.pieces.ids[i] for i in members}:
            self.successors[id_] = self.successors.get(id_, frozenset()) | {name}


def clean(recording: Recording) -> Cleaned:
    """Fuses, splits, joins, fills and straightens; raises InputError where a view does not fit the recording."""
    whole = pieces_of(recording)
    pieces, mistakes = split(whole, recording.dt_s)
    work = _Work(recording, pieces)
    for mistake in mistakes:
        observer = recording.views[whole.observer[mistake.track]].observer
        work.say(Reason.TELEPORT, whole.ids[mistake.track], mistake.frames, f"{mistake.detail}, for {observer}")
    groups = [group for group in groups_of(pieces) if pieces.valid[group].any()]
    egos, groups = egos_of(recording, pieces, groups)
    groups = joined(pieces, groups, recording.dt_s)
    lone = orphans(pieces, groups)
    for a in lone:
        _say_mistake(work, groups[a])
    things = [Ego("", (), group) for a, group in enumerate(groups) if a not in lone]
    tracks, cavs = _tracks(work, [*egos, *things])
    tracks, changes = apart(tracks, set(cavs.values()) | set(recording.cavs), recording.dt_s)
    work.changes += changes
    cavs |= {name: name for name in recording.cavs if name in {track.id for track in tracks} and name not in cavs}
    return Cleaned(recording.dt_s, tracks, cavs, CleaningReport(tuple(work.changes)), work.successors)


def _say_mistake(work: _Work, group: Sequence[int]) -> None:
    frames = int(work.pieces.valid[group].sum())
    observers = sorted({work.recording.views[work.pieces.observer[i]].observer for i in group})
    name = work.pieces.ids[group[0]]
    work.changes.append(Change(Reason.TELEPORT, name, frames, f"left out of {', '.join(observers)}", whole=True))
    work.follows(name, group)


def _tracks(work: _Work, things: Sequence[Ego]) -> tuple[tuple[Track, ...], dict[str, str]]:
    """The tracks of all things that are long enough, and the ids of the CAVs among them."""
    tracks: list[Track] = []
    cavs: dict[str, str] = {}
    for thing, name in zip(things, unique_names(work.pieces, things), strict=True):
        work.follows(name, (*thing.members, *thing.own))
        seen = thing.seen if thing.observer else fused(work.pieces, thing.members)
        if seen.valid.sum() < min(LEAST_FRAMES, work.recording.frames):
            work.say(Reason.TOO_SHORT, name, int(seen.valid.sum()), f"seen in {int(seen.valid.sum())} frames only")
            continue
        for change in named_changes(work.recording, work.pieces, thing, name):
            work.changes.append(change)
        tracks.append(_track(work, thing, name, seen))
        if thing.observer:
            cavs[thing.observer] = name
    return tuple(tracks), cavs


def _track(work: _Work, thing: Ego, name: str, seen: Fused) -> Track:
    dt_s, members = work.recording.dt_s, list(thing.members)
    longest = round(LONGEST_GAP_S / dt_s)
    valid, x, y = motion.filled(seen.valid, seen.x, seen.y, longest)
    x, y, steps = motion.spread_steps(valid, x, y, dt_s)
    _say_filled(work, name, seen.valid, valid)
    for frame, size in steps:
        work.say(Reason.TELEPORT, name, 1, f"step of {size:.2f} m at frame {frame} spread over the time around it")
    x, y, held = motion.strayed(valid, x, y, dt_s)
    if held:
        work.say(Reason.TELEPORT, name, held, "left its place and came back faster than anything can: held there")
    category, said = label_of(work.pieces, members)
    length, width, told = size_of(work.pieces, members, category)
    full = np.where(valid, 1.0, np.nan)
    track = Track(name, category, valid, x, y, seen.axis, length * full, width * full)
    moving = moves(track, dt_s)
    if category is Category.STATIC and (moving or length > 3.0):
        category = Category.CAR if length > 2.5 else Category.BICYCLE if moving and length > 1.3 else category
        category = Category.PEDESTRIAN if moving and category is Category.STATIC else category
        said = f"static by its label, {'moves' if moving else f'{length:.1f} m long'}: {category.value}"
    if said:
        work.say(Reason.LABEL, name, int(valid.sum()), said)
    if told:
        work.say(Reason.SIZE, name, int(valid.sum()), told)
    parked = not moving if valid.sum() > 1 else _called_parked(work.pieces, members)
    if parked:
        work.say(Reason.STATIC, name, int(valid.sum()), "by label" if _called_parked(work.pieces, members) else "")
    track = replace(track, category=category, parked=parked)
    return replace(track, yaw=_heading(work, thing, track, seen))


def _called_parked(pieces: Pieces, members: Sequence[int]) -> bool:
    return bool(len(members) and pieces.parked[list(members)].any())


def _say_filled(work: _Work, name: str, before: np.ndarray, after: np.ndarray) -> None:
    if after.sum() > before.sum():
        work.say(Reason.GAP, name, int(after.sum() - before.sum()), "filled by motion")
    frames = np.flatnonzero(after)
    left = int(frames[-1] - frames[0] + 1 - len(frames))
    if left:
        work.say(Reason.LONG_GAP, name, left, f"longer than {LONGEST_GAP_S:g} s")


def _heading(work: _Work, thing: Ego, track: Track, seen: Fused) -> Float:
    """Heading of the track; frames in which boxes looked elsewhere are reported."""
    pieces, members = work.pieces, list(thing.members)
    course, speed = motion.directions(track.valid, track.x, track.y, work.recording.dt_s)
    yaws = pieces.yaw[members] if members else np.full((1, len(track.x)), np.nan)
    if track.category.kind is Kind.PEDESTRIAN:
        box = np.where(np.isfinite(seen.axis), seen.axis, np.nan)
        how = "stands, as its box" if track.parked else "from motion"
        work.say(Reason.HEADING, track.id, int(track.valid.sum()), f"walker: {how}")
        return motion.walker_heading(course, speed, track.valid, box)
    votes = np.nan_to_num(np.cos(yaws - seen.axis)).sum(axis=0)
    heading = motion.vehicle_heading(seen.axis, votes, (course, speed, track.valid), work.recording.dt_s)
    turned = np.nan_to_num(np.cos(yaws - heading), nan=1.0) < 0
    for row in np.flatnonzero(turned.any(axis=1)):
        observer = work.recording.views[pieces.observer[members[row]]].observer
        work.say(Reason.HEADING, track.id, int(turned[row].sum()), f"turned round, seen by {observer}")
    if not np.isfinite(yaws).any() and not thing.observer:
        work.say(Reason.HEADING, track.id, int(track.valid.sum()), "from motion: the source tells none")
    return heading
