"""FusionFrames: what detectors that share learn from. A frame is one tick of one car: scans, poses and true boxes.

docs/fusion-frames.md describes the arrays for those who write them.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt

from mdrive_sumo.agents.learned.fusion_spec import CLASSES, DELAYS_TICKS, FORECAST_S, GRID_REACH_M, MAX_CAVS
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
MOTION_S = (-0.5, *FORECAST_S[1:])
"""[s] After the tick of the frame: times of `box_motion`; the first one says how fast a box has been."""
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
        "box_motion": FrameArray("float32", ("frames", MAX_BOXES, len(MOTION_S), 3)),
    }
)
OPTIONAL = ("box_motion",)
"""Arrays that a data set may lack."""


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
    """(F, MAX_CAVS, delays) the scan of each car, DELAYS_TICKS before the frame's tick; -1: none. Frames may
    share scans."""
    true_pose: npt.NDArray[np.float32]
    """(F, MAX_CAVS, delays, 3) x, y [m], yaw [rad] of the car at each scan, in the own car's true frame at the tick of
    the frame; NaN where there is no scan."""
    estimated_pose: npt.NDArray[np.float32]
    """The same as a receiver gets it: the sender's estimated pose in the frame of the own car's estimated pose."""
    boxes: npt.NDArray[np.float32]
    """(F, MAX_BOXES, 5) x, y, yaw, length, width of road users in the own car's true frame, within the grid, without
    the own car; NaN in unused rows, which come last."""
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
    box_motion: npt.NDArray[np.float32] | None = None
    """(F, MAX_BOXES, len(MOTION_S), 3) x, y [m], yaw [rad] of each box at MOTION_S after the tick, in the
    frame of `boxes`, also outside of the grid; NaN where the road user is not in the world, after the end of the drive,
    and in unused rows. None: no forecast can learn from these frames."""

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self.tick)

    def get_scan(self, number: int) -> Cells:
        """Return the cells of a scan."""
        return self.cells[self.scan_starts[number] : self.scan_starts[number + 1]]

    def get_arrays(self) -> dict[str, Array]:
        """Return the arrays that there are, by name."""
        return {name: getattr(self, name) for name in ARRAYS if getattr(self, name) is not None}

    @property
    def is_target(self) -> npt.NDArray[np.bool_]:
        """(F, MAX_BOXES): whether any car has a point on the box. All detectors are measured on these."""
        return (self.box_class >= 0) & (self.box_points.sum(axis=2) > 0)


def concatenate_frames(parts: Sequence[FusionFrames]) -> FusionFrames:
    """Return the frames of several data sets, one after the other; places of one name become one.

    An array that one of them lacks is left out.
    """
    present = [name for name in ARRAYS if all(name in part.get_arrays() for part in parts)]
    places = tuple(dict.fromkeys(name for part in parts for name in part.places))
    first_scan = np.cumsum([0, *(len(part.scan_starts) - 1 for part in parts)])
    first_cell = np.cumsum([0, *(len(part.cells) for part in parts)])
    first_episode = np.cumsum([0, *(int(part.episode.max(initial=-1)) + 1 for part in parts)])
    arrays: dict[str, list[Array]] = {name: [] for name in present}
    for i, part in enumerate(parts):
        number = np.array([places.index(name) for name in part.places], np.int32)
        changed: dict[str, Array] = {
            "scan_starts": part.scan_starts[: -1 if i < len(parts) - 1 else None] + first_cell[i],
            "scan": np.where(part.scan >= 0, part.scan + np.int32(first_scan[i]), np.int32(-1)),
            "place": number[part.place],
            "episode": part.episode + np.int32(first_episode[i]),
        }
        for name in present:
            arrays[name].append(changed[name] if name in changed else getattr(part, name))
    return FusionFrames(places, **{name: np.concatenate(values) for name, values in arrays.items()})


def take_frames(frames: FusionFrames, rows: npt.NDArray[np.integer]) -> FusionFrames:
    """Return some frames; all scans stay."""
    by_frame = {name: array for name, array in frames.get_arrays().items() if ARRAYS[name].shape[0] == "frames"}
    return replace(frames, **{name: array[rows] for name, array in by_frame.items()})


def check_frames(frames: FusionFrames, where: str) -> None:
    """Raise InputError, beginning with `where`, for the first array that is not as `FusionFrames` describes it."""
    sizes = {
        "frames": len(frames.tick),
        "scans + 1": len(frames.scan_starts),
        "cells": len(frames.cells),
    }
    for name, found in frames.get_arrays().items():
        wanted = ARRAYS[name]
        shape = tuple(sizes[size] if isinstance(size, str) else size for size in wanted.shape)
        if found.dtype.name != wanted.dtype or found.shape != shape:
            raise InputError(
                f"{where}: {name}: expected {wanted.dtype} {shape}, found {found.dtype.name} {found.shape}"
            )
    for name, problem in _find_problems(frames):
        raise InputError(f"{where}: {name}: {problem}")


def _find_problems(frames: FusionFrames) -> Iterator[tuple[str, str]]:
    """Yield name and sentence of each array whose numbers are wrong."""
    starts, scans = frames.scan_starts, len(frames.scan_starts) - 1
    if (frames.cells >> 8 >= GRID_SIZE).any():
        yield "cells", f"expected cells below {GRID_SIZE}, found a larger one"
    if (frames.cells & 255 == 0).any():
        yield "cells", "expected counts from 1 to 255, found 0"
    if scans < 0 or starts[0] != 0 or starts[-1] != len(frames.cells) or (np.diff(starts) < 0).any():
        yield "scan_starts", f"expected ascending numbers from 0 to the {len(frames.cells)} cells, found others"
    low, high = int(frames.scan.min(initial=0)), int(frames.scan.max(initial=-1))
    if low < -1 or high >= scans:
        yield "scan", f"expected -1 to {scans - 1}, of {scans} scans, found {low} to {high}"
    if (frames.scan[:, 0, 0] < 0).any():
        yield "scan", "expected a scan of the own car in every frame, found none"
    for name, pose in (("true_pose", frames.true_pose), ("estimated_pose", frames.estimated_pose)):
        if not np.isfinite(pose[frames.scan >= 0]).all():
            yield name, "expected a pose of every scan, found numbers that are not finite"
        if pose[:, 0, 0].any():
            yield name, "expected 0, 0, 0 of the own car's newest scan, found others"
    yield from _find_box_problems(frames)
    if not ((frames.place >= 0) & (frames.place < len(frames.places))).all():
        yield "place", f"expected numbers of the {len(frames.places)} places, found others"


def _find_box_problems(frames: FusionFrames) -> Iterator[tuple[str, str]]:
    boxes = frames.boxes[frames.box_class >= 0]
    if not np.isfinite(boxes).all():
        yield "boxes", "expected finite numbers in used rows, found others"
    if (np.abs(boxes[:, :2]) > GRID_REACH_M).any() or (boxes[:, 3:] <= 0).any():
        yield "boxes", f"expected centres within {GRID_REACH_M} m and sides above 0, found others"
    if (frames.box_class >= len(CLASSES)).any():
        yield "box_class", f"expected classes below {len(CLASSES)}, found a larger one"
    if frames.box_motion is not None and np.isinf(frames.box_motion).any():
        yield "box_motion", "expected finite numbers, or NaN where a box is not in the world, found infinite ones"


def check_motion(frames: FusionFrames, where: str) -> None:
    """Raise InputError, beginning with `where`, unless the frames say where boxes go."""
    if frames.box_motion is None:
        raise InputError(
            f"{where}: expected frames with an array box_motion, which says where road users go, found none in at least"
            " one archive; collect them again with this version of mdrive-sumo"
        )


def check_places_differ(training: FusionFrames, judged: FusionFrames, split: str) -> None:
    """Raise InputError if a place of the split `split` is also one of the training set."""
    common = sorted({*training.places} & {*judged.places})
    if common:
        raise InputError(
            f"places of the {split} set: expected none of the training set, found {common[0]!r}"
            f"{f' and {len(common) - 1} more' if len(common) > 1 else ''}; networks that were trained on cannot judge"
        )
