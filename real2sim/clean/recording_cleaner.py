"""Clean a recording: merge all observers' views into one list of tracks, one per object, and report every change."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import Kind
from real2sim.clean import track_repair as motion
from real2sim.clean.cleaning_report import ChangeReason, CleaningReport, TrackChange
from real2sim.clean.ego_tracks import TrackedObject, extract_cavs
from real2sim.clean.object_attributes import vote_category, vote_size
from real2sim.clean.observer_fusion import FusedTrack, fuse_segments, group_segments
from real2sim.clean.overlap_resolution import resolve_overlaps
from real2sim.clean.track_joining import MAX_GAP_S, find_orphans, join_groups
from real2sim.clean.track_segments import TrackSegments, collect_segments, split_at_jumps
from real2sim.recording import ObjectCategory, RecordedTrack, Recording
from real2sim.tracks.kinematics import WINDOW
from real2sim.tracks.stationary import has_moved

MIN_FRAMES = WINDOW
"""Shorter tracks have neither acceleration nor jerk (`tracks.motion`), so they cannot be checked."""


@dataclass(frozen=True)
class CleanedRecording:
    """One list of tracks for the whole log."""

    dt_s: float
    tracks: tuple[RecordedTrack, ...]
    cavs: Mapping[str, str]
    """Connected automated vehicles: name in the recording (observer or track) -> track id."""
    report: CleaningReport
    successors: Mapping[str, frozenset[str]] = field(default_factory=dict[str, frozenset[str]])
    """Source id -> ids of the result or of the report for the objects that it showed."""


@dataclass
class _CleaningState:
    """Working state while one log is cleaned."""

    recording: Recording
    segments: TrackSegments
    changes: list[TrackChange] = field(default_factory=list[TrackChange])
    successors: dict[str, frozenset[str]] = field(default_factory=dict[str, frozenset[str]])

    def add_change(self, reason: ChangeReason, track: str, frames: int, detail: str = "") -> None:
        self.changes.append(TrackChange(reason, track, frames, detail))

    def add_successor(self, name: str, members: Sequence[int]) -> None:
        for id_ in {self.segments.ids[i] for i in members}:
            self.successors[id_] = self.successors.get(id_, frozenset()) | {name}


def clean_recording(recording: Recording) -> CleanedRecording:
    """Fuse, split, join, fill and align the tracks; raise InputError if a view does not fit the recording."""
    unsplit = collect_segments(recording)
    segments, removals = split_at_jumps(unsplit, recording.dt_s)
    state = _CleaningState(recording, segments)
    for removed in removals:
        observer = recording.views[unsplit.observer[removed.track]].observer
        state.add_change(
            ChangeReason.TELEPORT, unsplit.ids[removed.track], removed.frames, f"{removed.detail}, for {observer}"
        )
    groups = [group for group in group_segments(segments) if segments.valid[group].any()]
    egos, groups = extract_cavs(recording, segments, groups)
    groups = join_groups(segments, groups, recording.dt_s)
    lone = find_orphans(segments, groups)
    for a in lone:
        _report_orphan(state, groups[a])
    tracked_objects = [TrackedObject("", (), group) for a, group in enumerate(groups) if a not in lone]
    tracks, cavs = _build_tracks(state, [*egos, *tracked_objects])
    tracks, changes = resolve_overlaps(tracks, set(cavs.values()) | set(recording.cavs), recording.dt_s)
    state.changes += changes
    cavs |= {name: name for name in recording.cavs if name in {track.id for track in tracks} and name not in cavs}
    return CleanedRecording(recording.dt_s, tracks, cavs, CleaningReport(tuple(state.changes)), state.successors)


def _report_orphan(state: _CleaningState, group: Sequence[int]) -> None:
    frames = int(state.segments.valid[group].sum())
    observers = sorted({state.recording.views[state.segments.observer[i]].observer for i in group})
    name = state.segments.ids[group[0]]
    state.changes.append(
        TrackChange(ChangeReason.TELEPORT, name, frames, f"left out of {', '.join(observers)}", is_whole_track=True)
    )
    state.add_successor(name, group)


def _build_tracks(
    state: _CleaningState, tracked_objects: Sequence[TrackedObject]
) -> tuple[tuple[RecordedTrack, ...], dict[str, str]]:
    """Build the tracks of all objects that are long enough, and the ids of the CAVs among them."""
    tracks: list[RecordedTrack] = []
    cavs: dict[str, str] = {}
    for tracked, name in zip(tracked_objects, assign_names(state.segments, tracked_objects), strict=True):
        state.add_successor(name, (*tracked.members, *tracked.ghost_members))
        seen = tracked.fused if tracked.observer else fuse_segments(state.segments, tracked.members)
        if seen.valid.sum() < min(MIN_FRAMES, state.recording.frame_count):
            state.add_change(
                ChangeReason.TOO_SHORT, name, int(seen.valid.sum()), f"seen in {int(seen.valid.sum())} frames only"
            )
            continue
        for change in report_id_changes(state.recording, state.segments, tracked, name):
            state.changes.append(change)
        tracks.append(_build_track(state, tracked, name, seen))
        if tracked.observer:
            cavs[tracked.observer] = name
    return tuple(tracks), cavs


def _build_track(state: _CleaningState, tracked: TrackedObject, name: str, seen: FusedTrack) -> RecordedTrack:
    dt_s, members = state.recording.dt_s, list(tracked.members)
    longest = round(MAX_GAP_S / dt_s)
    valid, x, y = motion.fill_gaps(seen.valid, seen.x, seen.y, longest)
    x, y, steps = motion.spread_steps(valid, x, y, dt_s)
    _report_gaps(state, name, seen.valid, valid)
    for frame, size in steps:
        state.add_change(
            ChangeReason.TELEPORT, name, 1, f"step of {size:.2f} m at frame {frame} spread over the time around it"
        )
    x, y, held = motion.remove_excursions(valid, x, y, dt_s)
    if held:
        state.add_change(
            ChangeReason.TELEPORT, name, held, "left its place and came back faster than anything can: held there"
        )
    category, category_note = vote_category(state.segments, members)
    length, width, size_note = vote_size(state.segments, members, category)
    full = np.where(valid, 1.0, np.nan)
    track = RecordedTrack(name, category, valid, x, y, seen.axis, length * full, width * full)
    moving = has_moved(track, dt_s)
    if category is ObjectCategory.STATIC and (moving or length > 3.0):
        category = (
            ObjectCategory.CAR if length > 2.5 else ObjectCategory.BICYCLE if moving and length > 1.3 else category
        )
        category = ObjectCategory.PEDESTRIAN if moving and category is ObjectCategory.STATIC else category
        category_note = f"static by its label, {'moves' if moving else f'{length:.1f} m long'}: {category.value}"
    if category_note:
        state.add_change(ChangeReason.LABEL, name, int(valid.sum()), category_note)
    if size_note:
        state.add_change(ChangeReason.SIZE, name, int(valid.sum()), size_note)
    parked = not moving if valid.sum() > 1 else _is_labelled_parked(state.segments, members)
    if parked:
        state.add_change(
            ChangeReason.STATIC,
            name,
            int(valid.sum()),
            "by label" if _is_labelled_parked(state.segments, members) else "",
        )
    track = replace(track, category=category, parked=parked)
    return replace(track, yaw=_resolve_heading(state, tracked, track, seen))


def _is_labelled_parked(segments: TrackSegments, members: Sequence[int]) -> bool:
    return bool(len(members) and segments.parked[list(members)].any())


def _report_gaps(state: _CleaningState, name: str, before: np.ndarray, after: np.ndarray) -> None:
    if after.sum() > before.sum():
        state.add_change(ChangeReason.GAP, name, int(after.sum() - before.sum()), "filled by motion")
    frames = np.flatnonzero(after)
    left = int(frames[-1] - frames[0] + 1 - len(frames))
    if left:
        state.add_change(ChangeReason.LONG_GAP, name, left, f"longer than {MAX_GAP_S:g} s")


def _resolve_heading(state: _CleaningState, tracked: TrackedObject, track: RecordedTrack, seen: FusedTrack) -> Float:
    """Return the heading of a track; report the frames in which boxes disagree."""
    segments, members = state.segments, list(tracked.members)
    course, speed = motion.compute_motion_directions(track.valid, track.x, track.y, state.recording.dt_s)
    yaws = segments.yaw[members] if members else np.full((1, len(track.x)), np.nan)
    if track.category.kind is Kind.PEDESTRIAN:
        box = np.where(np.isfinite(seen.axis), seen.axis, np.nan)
        how = "stands, as its box" if track.parked else "from motion"
        state.add_change(ChangeReason.HEADING, track.id, int(track.valid.sum()), f"walker: {how}")
        return motion.compute_pedestrian_heading(course, speed, track.valid, box)
    votes = np.nan_to_num(np.cos(yaws - seen.axis)).sum(axis=0)
    heading = motion.compute_vehicle_heading(seen.axis, votes, (course, speed, track.valid), state.recording.dt_s)
    turned = np.nan_to_num(np.cos(yaws - heading), nan=1.0) < 0
    for row in np.flatnonzero(turned.any(axis=1)):
        observer = state.recording.views[segments.observer[members[row]]].observer
        state.add_change(ChangeReason.HEADING, track.id, int(turned[row].sum()), f"turned round, seen by {observer}")
    if not np.isfinite(yaws).any() and not tracked.observer:
        state.add_change(ChangeReason.HEADING, track.id, int(track.valid.sum()), "from motion: the source gives none")
    return heading


def assign_names(segments: TrackSegments, tracked_objects: Sequence[TrackedObject]) -> list[str]:
    """Return one id per object: that of most of its frames, longest track first; `cav_<observer>` for CAVs.

    Ids already in use get a suffix: 7, 7_2, 7_3.
    """
    names: dict[int, str] = {}
    taken: set[str] = set()
    size = [int(segments.valid[list(tracked.members)].sum()) if tracked.members else 0 for tracked in tracked_objects]
    for n in sorted(range(len(tracked_objects)), key=lambda n: (not tracked_objects[n].observer, -size[n], n)):
        wanted = (
            f"cav_{tracked_objects[n].observer}"
            if tracked_objects[n].observer
            else _find_main_id(segments, tracked_objects[n].members)
        )
        name, number = wanted, 1
        while name in taken:
            number += 1
            name = f"{wanted}_{number}"
        taken.add(name)
        names[n] = name
    return [names[n] for n in range(len(tracked_objects))]


def _find_main_id(segments: TrackSegments, members: Sequence[int]) -> str:
    votes: Counter[str] = Counter()
    for i in members:
        votes[segments.ids[i]] += int(segments.valid[i].sum())
    return max(votes, key=lambda name: (votes[name], name))


def report_id_changes(
    recording: Recording, segments: TrackSegments, tracked: TrackedObject, name: str
) -> Iterator[TrackChange]:
    """Report what the source ids of one object reveal: ego ghosts, duplicates, id flips and gaps filled by others."""
    if tracked.observer:
        for observer, ids, frames in _group_by_observer(recording, segments, tracked.ghost_members):
            yield TrackChange(ChangeReason.EGO_GHOST, name, frames, f"{', '.join(ids)} of {observer}")
    main = _find_main_id(segments, tracked.members) if tracked.members else ""
    for observer, ids, _ in _group_by_observer(recording, segments, tracked.members):
        rows = [i for i in tracked.members if recording.views[segments.observer[i]].observer == observer]
        usual = main if main in ids else ids[0]
        for other in ids:
            if other != usual or (other != main and len(ids) == 1):
                yield _classify_id_change(segments, rows, (usual, other, observer), name)
        seen = np.flatnonzero(segments.valid[rows].any(axis=0))
        if (hidden := int(seen[-1] - seen[0] + 1 - len(seen))) and len(tracked.members) > len(rows):
            yield TrackChange(ChangeReason.GAP, name, hidden, f"unseen by {observer}, filled from others or by motion")


def _classify_id_change(
    segments: TrackSegments, rows: Sequence[int], names: tuple[str, str, str], track: str
) -> TrackChange:
    """Report two ids of one observer: simultaneous ids are duplicates, successive ids are flips."""
    usual, other, observer = names
    here = segments.valid[[i for i in rows if segments.ids[i] == usual]].any(axis=0)
    there = segments.valid[[i for i in rows if segments.ids[i] == other]].any(axis=0)
    twice = usual == other or bool((here & there).any())
    reason = ChangeReason.DUPLICATE if twice else ChangeReason.ID_FLIP
    return TrackChange(reason, track, int(there.sum()), f"called {other} by {observer}")


def _group_by_observer(
    recording: Recording, segments: TrackSegments, members: Sequence[int]
) -> Iterator[tuple[str, list[str], int]]:
    for number in sorted({int(segments.observer[i]) for i in members}):
        rows = [i for i in members if segments.observer[i] == number]
        frames = int(segments.valid[rows].any(axis=0).sum())
        yield recording.views[number].observer, sorted({segments.ids[i] for i in rows}), frames
