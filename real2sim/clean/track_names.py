"""Ids of objects, and the changes that conflicting source ids reveal."""

from collections import Counter
from collections.abc import Iterator, Sequence

import numpy as np

from real2sim.clean.cleaning_report import ChangeReason, TrackChange
from real2sim.clean.ego_tracks import TrackedObject
from real2sim.clean.track_segments import TrackSegments
from real2sim.recording import Recording


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
