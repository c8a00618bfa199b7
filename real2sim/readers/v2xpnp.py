"""V2XPnP logs: read agent folders of 10 Hz YAML and a vector map (data_formats, sections 1 and 2).

Each agent has one view. The same object has the same id in every view, but its own size, box and label in each; a CAV
is missing in its own view and an ordinary car in the others. Views are not merged here.
"""

from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float
from real2sim.hd_map import HdMap
from real2sim.readers.input_checks import check_frame_count, find_gap
from real2sim.readers.map_fit import OFF_MAP_M, measure_map_fit, thin_points
from real2sim.readers.v2xpnp_frame import (
    V2xpnpFrame,
    find_category,
    find_category_by_length,
    list_agents,
    list_frames,
    read_frame,
)
from real2sim.readers.v2xpnp_map import read_vector_map
from real2sim.recording import COLUMNS, ObserverView, RecordedTrack, Recording

DT_S = 0.1
"""[s] The files have no times; the dataset is recorded at 10 Hz."""
MAX_MISSING_FRAMES = 19
"""A longer hole in the frames of one agent is refused: an interval of 2 s is the longest that cleaning fills
(`clean.track_joining.MAX_GAP_S`), and a folder that lacks more was not copied completely."""


def read_v2xpnp(folder: Path, maps: Path | Sequence[Path], agents: Sequence[str] | None = None) -> Recording:
    """Read a scenario folder, and the vector map of the given ones that fits it.

    `agents` names the folders to read, all by default. Without any map the recording has an empty HdMap and a note.
    The log lasts from the first to the last frame of any agent. Frames that an agent lacks, because it begins later or
    ends earlier or single files are missing, are not observed by it, with a note.
    Raises InputError for missing agent folders, long holes in the frames of one, unreadable files and maps of another
    place.
    """
    annotated = read_views(folder, agents)
    views = tuple(view for view, _ in annotated)
    hd_map, map_notes = _choose_map(folder, views, (maps,) if isinstance(maps, Path) else tuple(maps))
    return Recording(
        id=folder.resolve().name,
        source="v2xpnp",
        dt_s=DT_S,
        frame_count=len(views[0].pose),
        views=views,
        map=hd_map,
        cavs=tuple(view.observer for view in views if not view.is_infrastructure),
        notes=tuple(note for _, notes in annotated for note in notes) + map_notes,
    )


class AnnotatedView(NamedTuple):
    """What one agent has observed, with notes on reading it."""

    view: ObserverView
    notes: tuple[str, ...]


def read_views(folder: Path, agents: Sequence[str] | None = None) -> tuple[AnnotatedView, ...]:
    """Return every agent's view with its notes; raise InputError."""
    names = _list_agents(folder) if agents is None else list(agents)
    files = {name: _list_frames(folder / name) for name in names}
    numbers = range(
        min(min(numbered) for numbered in files.values()), max(max(numbered) for numbered in files.values()) + 1
    )
    check_frame_count(str(folder), len(numbers))
    return tuple(_read_view(folder / name, files[name], numbers) for name in names)


def _read_view(folder: Path, files: Mapping[int, Path], numbers: range) -> AnnotatedView:
    """Read the frames of one agent. `numbers`: those of the log, in which the agent's may be fewer."""
    annotated = _build_view(folder, [read_frame(path) for path in files.values()])
    if len(files) == len(numbers):
        return annotated
    view, notes = annotated
    rows = np.array(list(files)) - numbers.start
    tracks = tuple(_spread_rows(track, rows, len(numbers)) for track in view.tracks)
    pose = np.full((len(numbers), 3), np.nan)
    pose[rows] = view.pose
    notes = (*notes, *_note_missing_frames(folder.name, files, numbers))
    return AnnotatedView(replace(view, tracks=tracks, pose=pose), notes)


def _spread_rows(track: RecordedTrack, rows: npt.NDArray[np.intp], frames: int) -> RecordedTrack:
    """Return the track in the frames of the log, of which `rows` are those of the agent."""
    valid = np.zeros(frames, dtype=np.bool_)
    valid[rows] = track.valid
    columns: dict[str, Float] = {}
    for name in COLUMNS:
        columns[name] = np.full(frames, np.nan)
        columns[name][rows] = getattr(track, name)
    return track.replace_columns(valid=valid, **columns)


def _note_missing_frames(agent: str, files: Mapping[int, Path], numbers: range) -> Iterable[str]:
    first, last = min(files), max(files)
    if first > numbers.start:
        yield f"agent {agent} begins late, {(first - numbers.start) * DT_S:.1f} s after the log, with frame {first:06d}"
    if last < numbers[-1]:
        yield f"agent {agent} ends early, {(numbers[-1] - last) * DT_S:.1f} s before the log, with frame {last:06d}"
    missing = [number for number in range(first, last) if number not in files]
    if missing:
        listed = ", ".join(f"{number:06d}" for number in missing[:8]) + (", ..." if len(missing) > 8 else "")
        yield (
            f"agent {agent} lacks {len(missing)} frames: {listed}; its own pose and what no other agent sees"
            " are interpolated there"
        )


def _list_agents(folder: Path) -> list[str]:
    """Return the agent folders, CAVs first. They are numbered consecutively, so a missing one is detected."""
    numbers = list_agents(folder, "1, 2, ...")
    missing = find_gap((0, *numbers))
    if missing is not None:
        raise InputError(
            f"{folder}: expected agent folders without holes, found {sorted(numbers)} and no folder {missing}"
        )
    return [str(n) for n in numbers]


def _list_frames(folder: Path) -> dict[int, Path]:
    """Return frame files by number, in order; raise InputError if there is none or the hole between two is long."""
    if not folder.is_dir():
        raise InputError(f"{folder}: expected an agent folder with frames, found none")
    files = list_frames(folder, "[0-9]+", "000000.yaml, 000001.yaml, ...")
    for before, after in pairwise(files):
        if after - before - 1 > MAX_MISSING_FRAMES:
            raise InputError(
                f"{folder}: expected at most {MAX_MISSING_FRAMES} missing frames in a row, found none between"
                f" {before:06d}.yaml and {after:06d}.yaml"
            )
    return files


def _build_view(folder: Path, frames: Sequence[V2xpnpFrame]) -> AnnotatedView:
    sensor = np.array([frame.sensor for frame in frames])
    names, rows = _index_objects(frames)
    frame_numbers = np.repeat(np.arange(len(frames)), [len(frame.ids) for frame in frames])
    check_frame_count(str(folder), len(frames), len(names))
    boxes = np.full((len(names), len(frames), 12), np.nan)
    boxes[rows, frame_numbers] = np.concatenate([frame.boxes for frame in frames])
    labels, static = _count_labels(frames)
    notes = [f"agent {folder.name}: {note}" for note in _note_labels(labels)]
    tracks = tuple(_build_track(name, box, labels[name], static[name]) for name, box in zip(names, boxes, strict=True))
    pose = np.column_stack((sensor[:, 0], sensor[:, 1], np.radians(sensor[:, 4])))
    view = ObserverView(folder.name, tracks, pose, is_infrastructure=folder.name.startswith("-"))
    return AnnotatedView(view, tuple(notes))


def _index_objects(frames: Sequence[V2xpnpFrame]) -> tuple[list[str], list[int]]:
    """Return all ids in order of appearance, and for every object of every frame the index of its id."""
    places: dict[str, int] = {}
    rows = [places.setdefault(name, len(places)) for frame in frames for name in frame.ids]
    return list(places), rows


def _count_labels(frames: Sequence[V2xpnpFrame]) -> tuple[dict[str, Counter[str]], dict[str, Counter[bool]]]:
    labels: dict[str, Counter[str]] = defaultdict(Counter)
    static: dict[str, Counter[bool]] = defaultdict(Counter)
    for frame in frames:
        for name, label, still in zip(frame.ids, frame.labels, frame.static, strict=True):
            labels[name][label] += 1
            static[name][still] += 1
    return labels, static


def _note_labels(labels: Mapping[str, Counter[str]]) -> list[str]:
    unknown = Counter(label for count in labels.values() if find_category(label := _find_most_frequent(count)) is None)
    changing = sorted(name for name, count in labels.items() if len(count) > 1)
    notes = [f"{n} objects of unknown type {label!r} classed by size" for label, n in sorted(unknown.items())]
    return notes + [f"object {name} changes its type: {dict(labels[name])}" for name in changing]


def _find_most_frequent(votes: Counter[str]) -> str:
    """Return the most frequent value, the first one of equals."""
    return votes.most_common(1)[0][0]


def _build_track(name: str, boxes: Float, labels: Counter[str], static: Counter[bool]) -> RecordedTrack:
    """Build a track from boxes (T, 12) as in `V2xpnpFrame.boxes`, NaN where it is not observed."""
    angle, centre, extent, location = (boxes[:, i : i + 3] for i in (0, 3, 6, 9))
    size = 2 * np.where(extent > 0, extent, np.nan)
    valid = np.isfinite(location[:, 0])
    longest = float(np.nanmax(size[:, 0], initial=0.0))
    return RecordedTrack(
        id=name,
        category=find_category(_find_most_frequent(labels)) or find_category_by_length(longest),
        valid=valid,
        x=location[:, 0] + centre[:, 0],
        y=location[:, 1] + centre[:, 1],
        yaw=np.radians(angle[:, 1]),
        length=size[:, 0],
        width=size[:, 1],
        parked=static[True] > static[False],
    )


def _choose_map(folder: Path, views: Sequence[ObserverView], paths: Sequence[Path]) -> tuple[HdMap, tuple[str, ...]]:
    if not paths:
        return HdMap(), ("no vector map given",)
    points = _list_probes(views)
    candidates = [(path, *read_vector_map(path)) for path in paths]
    fits = [measure_map_fit(points, hd_map.lanes.values()) for _, hd_map, _ in candidates]
    fit, (path, hd_map, notes) = min(zip(fits, candidates, strict=True), key=lambda pair: pair[0])
    if not fit.is_same_place:
        raise InputError(
            f"{folder}: expected tracks on the lanes of {path}, found {fit.off_share:.0%} of their points more than "
            f"{OFF_MAP_M:g} m off (median {fit.median_m:.0f} m): it is the map of another place"
        )
    note = f"map: {path.name}, {fit.off_share:.1%} of track points more than {OFF_MAP_M:g} m from any lane"
    return hd_map, (*notes, note)


def _list_probes(views: Sequence[ObserverView]) -> Float:
    """Return track points (N, 2), evenly thinned; the sensor positions if there are no tracks."""
    points = [track.xy[track.valid] for view in views for track in view.tracks]
    return thin_points(np.concatenate(points if sum(map(len, points)) else [view.pose[:, :2] for view in views]))
