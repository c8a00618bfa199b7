"""FusionFrames: what detectors that share learn from. A frame is one tick of one car: scans, poses and true boxes.

docs/fusion-frames.md describes the arrays for those who write them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt

from mdrive_sumo.agents.learned.fusion_spec import CLASSES, DELAYS_TICKS, GRID_REACH_M, MAX_CAVS
from mdrive_sumo.agents.learned.point_grid import GRID_SIZE, Cells
from mdrive_sumo.core.errors import InputError

MAX_BOXES = 64
"""Rows for the true boxes of a frame; the nearest ones are kept."""
Array = npt.NDArray[Any]


@dataclass(frozen=True, slots=True)
class FrameArray:
    """Type and shape of an array of `FusionFrames`."""

    dtype: str
    shape: tuple[int | str, ...]
    """Texts are sizes: "frames", "scans + 1", "cells", "places"."""


SLOTS = (MAX_CAVS, len(DELAYS_TICKS))
ARRAYS: Mapping[str, FrameArray] = MappingProxyType(
    {
        "cells": FrameArray("uint32", ("cells",)),
        "scan_starts": FrameArray("int64", ("scans + 1",)),
        "scan": FrameArray("int32", ("frames", *SLOTS)),
        "true_pose": FrameArray("float32", ("frames", *SLOTS, 3)),
        "estimated_pose": FrameArray("float32", ("frames", *SLOTS, 3)),
        "boxes": FrameArray("float32", ("frames", MAX_BOXES, 5)),
        "box_class": FrameArray("int8", ("frames", MAX_BOXES)),
        "box_points": FrameArray("uint16", ("frames", MAX_BOXES, MAX_CAVS)),
        "box_id": FrameArray("int32", ("frames", MAX_BOXES)),
        "place": FrameArray("int32", ("frames",)),
        "episode": FrameArray("int32", ("frames",)),
        "tick": FrameArray("int32", ("frames",)),
    }
)


@dataclass(frozen=True, slots=True)
class FusionFrames:
    """Frames of any number of drives, as arrays. Slot 0 of the cars is the own car, the others are senders."""

    places: tuple[str, ...]
    """Names of the networks; `place` counts in them."""
    cells: Cells
    """(K,) the cells of all scans (`point_grid`), one scan after the other."""
    scan_starts: npt.NDArray[np.int64]
    """(scans + 1,) where in `cells` each scan begins, and its end."""
    scan: npt.NDArray[np.int32]
    """(F, MAX_CAVS, delays) the scan of each car, DELAYS_TICKS before the frame's tick; -1: none. Frames share scans."""
    true_pose: npt.NDArray[np.float32]
    """(F, MAX_CAVS, delays, 3) x, y [m], yaw [rad] of the car at each scan, in the own car's true frame at the tick of
    the frame; NaN where there is no scan."""
    estimated_pose: npt.NDArray[np.float32]
    """The same as a receiver gets it: the sender's estimated pose in the frame of the own car's estimated pose."""
    boxes: npt.NDArray[np.float32]
    """(F, MAX_BOXES, 5) x, y, yaw, length, width of road users in the own car's true frame, within the grid, without the
    own car; NaN in unused rows, which come last."""
    box_class: npt.NDArray[np.int8]
    """(F, MAX_BOXES) index into `fusion_spec.CLASSES`; -1 in unused rows."""
    box_points: npt.NDArray[np.uint16]
    """(F, MAX_BOXES, MAX_CAVS) points on each box in the newest scan of each car."""
    box_id: npt.NDArray[np.int32]
    """(F, MAX_BOXES) constant over an episode; -1 in unused rows."""
    place: npt.NDArray[np.int32]
    """(F,) index into `places`."""
    episode: npt.NDArray[np.int32]
    """(F,) number of the drive."""
    tick: npt.NDArray[np.int32]
    """(F,)"""

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self.tick)

    def get_scan(self, number: int) -> Cells:
        """Return the cells of a scan."""
        return self.cells[self.scan_starts[number] : self.scan_starts[number + 1]]

    @property
    def is_target(self) -> npt.NDArray[np.bool_]:
        """(F, MAX_BOXES): whether any car has a point on the box. All detectors are measured on these."""
        return (self.box_class >= 0) & (self.box_points.sum(axis=2) > 0)


def concatenate_frames(parts: Sequence[FusionFrames]) -> FusionFrames:
    """Return the frames of several data sets, one after the other; places of one name become one."""
    places = tuple(dict.fromkeys(name for part in parts for name in part.places))
    first_scan = np.cumsum([0, *(len(part.scan_starts) - 1 for part in parts)])
    first_cell = np.cumsum([0, *(len(part.cells) for part in parts)])
    first_episode = np.cumsum([0, *(int(part.episode.max(initial=-1)) + 1 for part in parts)])
    arrays: dict[str, list[Array]] = {name: [] for name in ARRAYS}
    for i, part in enumerate(parts):
        number = np.array([places.index(name) for name in part.places], np.int32)
        changed: dict[str, Array] = {
            "scan_starts": part.scan_starts[: -1 if i < len(parts) - 1 else None] + first_cell[i],
            "scan": np.where(part.scan >= 0, part.scan + np.int32(first_scan[i]), np.int32(-1)),
            "place": number[part.place],
            "episode": part.episode + np.int32(first_episode[i]),
        }
        for name in ARRAYS:
            arrays[name].append(changed.get(name, getattr(part, name)))
    return FusionFrames(places, **{name: np.concatenate(values) for name, values in arrays.items()})


def check_frames(frames: FusionFrames, where: str) -> None:
    """Raise InputError, beginning with `where`, for the first array that is not as `FusionFrames` describes it."""
    sizes = {
        "frames": len(frames.tick),
        "scans + 1": len(frames.scan_starts),
        "cells": len(frames.cells),
    }
    for name, wanted in ARRAYS.items():
        found = getattr(frames, name)
        shape = tuple(sizes[size] if isinstance(size, str) else size for size in wanted.shape)
        if found.dtype.name != wanted.dtype or found.shape != shape:
            raise InputError(
                f"{where}: {name}: expected {wanted.dtype} {shape}, found {found.dtype.name} {found.shape}"
            )
    for name, problem in _find_problems(frames):
        raise InputError(f"{where}: {name}: {problem}")


OWN_POSE = "expected 0, 0, 0 of the own car's newest scan, found others"


def _find_problems(frames: FusionFrames) -> list[tuple[str, str]]:
    """Return name and sentence of each array whose numbers are wrong, in the order of `ARRAYS`."""
    starts, scans = frames.scan_starts, len(frames.scan_starts) - 1
    has_scan, is_box = frames.scan >= 0, frames.box_class >= 0
    used_poses = [pose[has_scan] for pose in (frames.true_pose, frames.estimated_pose)]
    boxes = frames.boxes[is_box]
    checks: tuple[tuple[str, bool, str], ...] = (
        ("cells", not bool((frames.cells >> 8 >= GRID_SIZE).any()), f"expected cells below {GRID_SIZE}, found a larger one"),
        ("cells", not bool((frames.cells & 255 == 0).any()), "expected counts from 1 to 255, found 0"),
        (
            "scan_starts",
            scans >= 0 and int(starts[0]) == 0 and int(starts[-1]) == len(frames.cells) and bool((np.diff(starts) >= 0).all()),
            f"expected ascending numbers from 0 to the {len(frames.cells)} cells, found others",
        ),
        (
            "scan",
            bool(((frames.scan >= -1) & (frames.scan < scans)).all()),
            f"expected -1 to {scans - 1}, of {scans} scans, found {frames.scan.min(initial=0)} to {frames.scan.max(initial=-1)}",
        ),
        ("scan", bool(has_scan[:, 0, 0].all()), "expected a scan of the own car in every frame, found none"),
        ("true_pose", bool(np.isfinite(used_poses[0]).all()), "expected a pose of every scan, found numbers that are not finite"),
        ("true_pose", not bool(frames.true_pose[:, 0, 0].any()), OWN_POSE),
        (
            "estimated_pose",
            bool(np.isfinite(used_poses[1]).all()),
            "expected a pose of every scan, found numbers that are not finite",
        ),
        ("estimated_pose", not bool(frames.estimated_pose[:, 0, 0].any()), OWN_POSE),
        ("boxes", bool(np.isfinite(boxes).all()), "expected finite numbers in used rows, found others"),
        (
            "boxes",
            bool((np.abs(boxes[:, :2]) <= GRID_REACH_M).all() and (boxes[:, 3:] > 0).all()),
            f"expected centres within {GRID_REACH_M} m and sides above 0, found others",
        ),
        ("box_class", bool((frames.box_class < len(CLASSES)).all()), f"expected classes below {len(CLASSES)}, found a larger one"),
        (
            "place",
            bool(((frames.place >= 0) & (frames.place < len(frames.places))).all()),
            f"expected numbers of the {len(frames.places)} places, found others",
        ),
    )  # fmt: skip
    return [(name, sentence) for name, is_right, sentence in checks if not is_right]


def check_places_differ(training: FusionFrames, judged: FusionFrames, split: str) -> None:
    """Raise InputError if a place of the split `split` is also one of the training set."""
    common = sorted({*training.places} & {*judged.places})
    if common:
        raise InputError(
            f"places of the {split} set: expected none of the training set, found {common[0]!r}"
            f"{f' and {len(common) - 1} more' if len(common) > 1 else ''}; networks that were trained on cannot judge"
        )
