"""OPV2V and data sets in its layout (V2XSet, V2X-Real, V2V4Real): read agent folders of YAML frames.

Source: Xu et al., OPV2V, ICRA 2022, and the data introduction of OpenCOOD: a folder an agent, named by its id (of
infrastructure negative), a file a frame, 10 Hz, numbered by the ticks of the simulation (mostly in steps of 2); poses
are x, y, z [m], roll, yaw, pitch [degrees], boxes half sizes. CARLA's frame is left-handed. Objects may have no types.

V2V4Real (Xu et al., CVPR 2023; loaders of ucla-mobility/V2V4Real): `lidar_pose` is a matrix (4, 4) from the LiDAR to
the world, both taken as right-handed; boxes are in the frame of the LiDAR of their file (`transformation_matrix` of
`reform_param` and `generate_object_center`), at `location` + `center`. Ids are those of the agent, `ass_id` is the
common one or -1.
"""

import math
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float
from real2sim.hd_map import HdMap
from real2sim.readers.input_checks import check_frame_count
from real2sim.readers.map_fit import check_place, measure_view_fit
from real2sim.readers.v2xpnp_frame import (
    V2xpnpFrame,
    find_category,
    find_category_by_length,
    list_agents,
    list_frames,
    read_frame,
)
from real2sim.recording import ObjectCategory, ObserverView, RecordedTrack, Recording

DT_S = 0.1
"""[s] Files have no times; all data sets of this layout are recorded at 10 Hz."""


@dataclass(frozen=True)
class LogFrame:
    """How the coordinates of a log lie in those of its map."""

    is_carla: bool = False
    """Whether y points to the right, as in CARLA; never so for poses that are matrices."""
    offset: tuple[float, float] = (0.0, 0.0)
    """Offset [m] that is added to the coordinates after they are mirrored."""


def read_opv2v(folder: Path, hd_map: HdMap, frame: LogFrame, agents: Sequence[str] | None = None) -> Recording:
    """Read a scenario folder; raise InputError, also if its tracks are not on the lanes of the map.

    `agents` names the folders to read, all by default. Frames that an agent lacks are not observed by it. An agent's
    pose is that of its LiDAR.
    """
    names = agents or [str(number) for number in list_agents(folder, "named by the ids")]
    files = {name: list_frames(folder / name, "[0-9]{1,9}", "such as 000068.yaml") for name in names}
    step = _find_step(folder, files)
    first = min(min(numbers) for numbers in files.values())
    last = max(max(numbers) for numbers in files.values())
    frames = check_frame_count(str(folder), (last - first) // step + 1)
    numbers = range(first, last + 1, step)
    views_and_untyped = [_read_view(folder / name, files[name], numbers, frame) for name in files]
    views, untyped = tuple(view for view, _ in views_and_untyped), sum(count for _, count in views_and_untyped)
    check_place(str(folder), measure_view_fit(views, hd_map))
    return Recording(
        id=folder.resolve().name,
        source="opv2v",
        dt_s=DT_S,
        frame_count=frames,
        views=views,
        map=hd_map,
        cavs=tuple(view.observer for view in views if not view.is_infrastructure),
        notes=(
            f"frames are numbered in steps of {step} and taken as {DT_S:g} s apart",
            *(["objects without types, classed by their size"] if untyped else []),
            *_note_missing_frames(files, numbers),
        ),
    )


def _find_step(folder: Path, files: Mapping[str, Mapping[int, Path]]) -> int:
    """Return the usual step of the numbers; raise InputError if others are no multiples of it."""
    steps = Counter(after - before for numbers in files.values() for before, after in pairwise(numbers))
    if not steps:
        raise InputError(f"{folder}: expected at least two frames of one agent, found one of each")
    step = steps.most_common(1)[0][0]
    first = min(min(numbers) for numbers in files.values())
    for numbers in files.values():
        for number, path in numbers.items():
            if (number - first) % step:
                raise InputError(f"{path}: expected a frame number in steps of {step} from {first}, found {number}")
    return step


def _note_missing_frames(files: Mapping[str, Mapping[int, Path]], numbers: range) -> tuple[str, ...]:
    lacking = {name: len(numbers) - len(frames) for name, frames in files.items()}
    return tuple(
        f"agent {name} lacks {count} of {len(numbers)} frames: nothing is observed by it there"
        for name, count in lacking.items()
        if count
    )


def _read_view(folder: Path, files: Mapping[int, Path], numbers: range, frame: LogFrame) -> tuple[ObserverView, int]:
    """Return a view, and the number of its objects without a known type."""
    pose = np.full((len(numbers), 3), np.nan)
    boxes: defaultdict[str, Float] = defaultdict(lambda: np.full((len(numbers), 5), np.nan))
    labels: defaultdict[str, Counter[str]] = defaultdict(Counter)
    shared: defaultdict[str, Counter[str]] = defaultdict(Counter)
    for number, path in files.items():
        row, content = numbers.index(number), read_frame(path, typed=False)
        here = frame if content.matrix is None else replace(frame, is_carla=False)
        pose[row] = _place(np.array([[content.sensor[0], content.sensor[1], math.radians(content.sensor[4])]]), here)
        for id_, label, box in zip(content.ids, content.labels, _build_boxes(content, here), strict=True):
            boxes[id_][row] = box
            labels[id_][label] += 1
        for id_, name in zip(content.ids, content.shared_ids, strict=False):
            shared[id_][name] += 1
        check_frame_count(str(path), len(numbers), len(boxes))
    names = _name_objects(folder.name, list(boxes), shared)
    categories = {id_: find_category(labels[id_].most_common(1)[0][0]) for id_ in boxes}
    tracks = tuple(_build_track(names[id_], table, categories[id_]) for id_, table in boxes.items())
    view = ObserverView(folder.name, tracks, pose, is_infrastructure=folder.name.startswith("-"))
    return view, sum(category is None for category in categories.values())


def _name_objects(agent: str, ids: Sequence[str], shared: Mapping[str, Counter[str]]) -> dict[str, str]:
    """Return names that mean the same object for all agents.

    An object of V2V4Real may change its common id; the most frequent one names all of their frames. An object whose
    common id another one of the agent has, or that has none, is named after the agent.
    """
    names: dict[str, str] = {}
    for id_ in ids:
        if id_ not in shared:
            names[id_] = id_
            continue
        free_names = [name for name, _ in shared[id_].most_common() if name and name not in names.values()]
        names[id_] = free_names[0] if free_names else f"{agent}_{id_}"
    return names


def _build_boxes(content: V2xpnpFrame, frame: LogFrame) -> Float:
    """Return x, y, yaw, length and width (N, 5) of the boxes of a file, in the frame of the map."""
    angle, centre, extent, location = (content.boxes[:, k : k + 3] for k in (0, 3, 6, 9))
    yaw = np.radians(angle[:, 1])
    if content.matrix is None:
        x = location[:, 0] + centre[:, 0] * np.cos(yaw) - centre[:, 1] * np.sin(yaw)
        y = location[:, 1] + centre[:, 0] * np.sin(yaw) + centre[:, 1] * np.cos(yaw)
    else:
        turn, pitch = content.matrix[:3, :3], np.radians(angle[:, 2])
        x, y, _ = turn @ (location + centre).T + content.matrix[:3, 3:]
        east, north, _ = turn @ np.array([np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), np.sin(pitch)])
        yaw = np.arctan2(north, east)
    size = 2 * np.where(extent[:, :2] > 0, extent[:, :2], np.nan)
    return np.column_stack((_place(np.column_stack((x, y, yaw)), frame), size))


def _place(poses: Float, frame: LogFrame) -> Float:
    """Return poses (N, 3) in the frame of the map."""
    up = -1.0 if frame.is_carla else 1.0
    x, y, yaw = poses.T
    yaw = (up * yaw + math.pi) % (2 * math.pi) - math.pi
    return np.column_stack((x + frame.offset[0], up * y + frame.offset[1], yaw))


def _build_track(id_: str, table: Float, category: ObjectCategory | None) -> RecordedTrack:
    """Build a track; without a category that of its length."""
    x, y, yaw, length, width = table.T
    category = category or find_category_by_length(float(np.nanmax(length, initial=0.0)))
    return RecordedTrack(id_, category, np.isfinite(x), x, y, yaw, length, width)
